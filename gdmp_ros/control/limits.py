"""Limits of a motion: what they are called, their values, and those on what the motors get."""
from __future__ import annotations

from dataclasses import dataclass
import math
from typing import NamedTuple

import numpy as np

from gdmp_ros.compilation import compiled
from gdmp_ros.control.measurement import JointLimits
from gdmp_ros.errors import ParameterError


class Limit(NamedTuple):
    """A limit: name and unit of the amount by which it has been exceeded by what was wanted."""

    name: str
    unit: str


#: In the order of ``gdmp_msgs/RobotState.limited``; the indices below follow it.
LIMITS = (
    Limit('torque', 'Nm'), Limit('torque_rate', 'Nm'), Limit('joint_position', 'rad'),
    Limit('joint_speed', 'rad/s'), Limit('speed', 'm/s'), Limit('turn_speed', 'rad/s'),
    Limit('acceleration', 'm/s^2'), Limit('turn_acceleration', 'rad/s^2'),
    Limit('workspace', 'm'), Limit('stiffness', 'log of the ratio'),
    Limit('stiffness_rate', '1/s'), Limit('position_error', 'm'), Limit('rotation_error', 'rad'),
    Limit('singularity', 'share of the speed'), Limit('energy', 'J'))
(TORQUE, TORQUE_RATE, JOINT_POSITION, JOINT_SPEED, SPEED, TURN_SPEED, ACCELERATION_LIMIT,
 TURN_ACCELERATION, WORKSPACE, STIFFNESS_BOUNDS, STIFFNESS_RATE, POSITION_ERROR, ROTATION_ERROR,
 SINGULARITY, ENERGY) = range(len(LIMITS))
#: The joint-speed limit begins to act at this share of it.
SPEED_MARGIN = 0.9


@dataclass(frozen=True)
class LimitSettings:
    """
    Values of the limits; the defaults are those of a Franka Emika Panda where it states one.

    :ivar torque_share: of the motors' torque limits
    :ivar torque_rate: largest change of a joint torque per tick [Nm]
    :ivar joint_margin: distance from a joint limit at which repulsion begins [rad]
    :ivar joint_repulsion: at the joint limit itself [Nm]
    :ivar joint_speed: of every joint [rad/s]
    :ivar joint_brake: damping of a joint that is too fast [Nm s/rad]
    :ivar speed: of the reference [m/s]
    :ivar turn_speed: of the reference [rad/s]
    :ivar acceleration: of the reference [m/s²]
    :ivar turn_acceleration: of the reference [rad/s²]
    :ivar catch_up_speed: at which an interrupted or delayed reference is caught up with [m/s]
    :ivar catch_up_turn_speed: the same for the rotation [rad/s]
    :ivar workspace_min: lowest reference position [m]
    :ivar workspace_max: highest reference position [m]
    :ivar stiffness_min: smallest eigenvalue, translational and rotational [N/m, Nm/rad]
    :ivar stiffness_max: largest eigenvalue, translational and rotational [N/m, Nm/rad]
    :ivar stiffness_rate: relative change of the stiffness in any direction [1/s]
    :ivar singularity_start: smallest singular value of the Jacobian (rotations times
        `SINGULAR_LENGTH`) below which motions that lower it are slowed down [m]
    :ivar singularity_stop: … and at which they end [m]
    """

    torque_share: float = 1.0
    torque_rate: float = 1.0
    joint_margin: float = 0.3
    joint_repulsion: float = 5.0
    joint_speed: float = 2.175
    joint_brake: float = 20.0
    speed: float = 1.7
    turn_speed: float = 2.5
    acceleration: float = 13.0
    turn_acceleration: float = 25.0
    catch_up_speed: float = 0.25
    catch_up_turn_speed: float = 1.0
    workspace_min: tuple[float, float, float] = (-1.0, -1.0, 0.0)
    workspace_max: tuple[float, float, float] = (1.0, 1.0, 1.3)
    stiffness_min: tuple[float, float] = (1.0, 0.1)
    stiffness_max: tuple[float, float] = (5000.0, 500.0)
    stiffness_rate: float = 20.0
    singularity_start: float = 0.06
    singularity_stop: float = 0.015

    def __post_init__(self) -> None:
        """:raises ParameterError: if two limits contradict each other"""
        for low, high in (('workspace_min', 'workspace_max'), ('stiffness_min', 'stiffness_max'),
                          ('singularity_stop', 'singularity_start')):
            least, most = getattr(self, low), getattr(self, high)
            if not np.less(least, most).all():
                raise ParameterError(f'{low} is {least}, expected less than {high}, {most}')


class Bites:
    """How often each limit has bitten, and the most that was wanted beyond it."""

    def __init__(self) -> None:
        self.ticks = np.zeros(len(LIMITS), dtype=np.int64)
        self.most = np.zeros(len(LIMITS))
        self._recent = np.zeros(len(LIMITS))

    def add(self, excess: np.ndarray) -> None:
        """Count a tick."""
        self.ticks += excess > 0.0
        np.fmax(self._recent, excess, out=self._recent)

    def recent(self) -> str:
        """Say which limits have bitten since the last call, and by how much; empty: none."""
        words = [f'{limit.name} by {value:.3g} {limit.unit}'
                 for limit, value in zip(LIMITS, self._recent) if value > 0.0]
        np.maximum(self.most, self._recent, out=self.most)
        self._recent[:] = 0.0
        return ', '.join(words)


@compiled
def limit_torque(position, velocity, bias, last, lower, upper, largest, numbers, torque, excess):
    """
    Joint-limit repulsion, joint speed, then torque rate, then torque.

    From a joint that is too fast is taken what would make it faster, and it is damped; gravity and
    Coriolis torque are left to it.

    :param last: torque of the last tick [Nm]
    :param largest: torques [Nm]
    :param numbers: rate, margin, repulsion, joint speed, brake (`LimitSettings`)
    :param torque: wanted, changed to what may be sent [Nm]
    :param excess: written: by how much each limit has bitten (`LIMITS`)
    """
    rate, margin, repulsion, fastest, brake = (numbers[0], numbers[1], numbers[2], numbers[3],
                                               numbers[4])
    slow = SPEED_MARGIN * fastest
    for i in range(torque.size):
        depth = max(lower[i] + margin - position[i], 0.0)
        height = max(position[i] - upper[i] + margin, 0.0)
        if depth + height > 0.0:
            excess[JOINT_POSITION] = max(excess[JOINT_POSITION], depth, height)
            torque[i] += repulsion * (min(depth / margin, 1.0) - min(height / margin, 1.0))
        above = abs(velocity[i]) - slow
        if above > 0.0:
            excess[JOINT_SPEED] = max(excess[JOINT_SPEED], above)
            driving = torque[i] - bias[i]
            if driving * velocity[i] > 0.0:
                driving *= max(1.0 - above / (fastest - slow), 0.0)
            torque[i] = bias[i] + driving - math.copysign(brake * above, velocity[i])
        if abs(torque[i]) > largest[i]:
            excess[TORQUE] = max(excess[TORQUE], abs(torque[i]) - largest[i])
        change = torque[i] - last[i]
        if abs(change) > rate:
            excess[TORQUE_RATE] = max(excess[TORQUE_RATE], abs(change) - rate)
            torque[i] = last[i] + math.copysign(rate, change)
        if abs(torque[i]) > largest[i]:
            torque[i] = math.copysign(largest[i], torque[i])


class TorqueLimiter:
    """What is sent to the motors, tick by tick."""

    def __init__(self, joints: JointLimits, settings: LimitSettings):
        self._joints = joints
        self._torque = settings.torque_share * joints.torque
        self._numbers = np.array([settings.torque_rate, settings.joint_margin,
                                  settings.joint_repulsion, settings.joint_speed,
                                  settings.joint_brake])
        self._last = np.zeros_like(joints.torque)

    @property
    def last(self) -> np.ndarray:
        """Torque that was sent last [Nm]."""
        return self._last.copy()

    def reset(self, torque: np.ndarray) -> None:
        """Begin at ``torque``: the next one may differ from it by the rate."""
        self._last = np.clip(torque, -self._torque, self._torque)

    def apply(self, position: np.ndarray, velocity: np.ndarray, bias: np.ndarray,
              torque: np.ndarray, excess: np.ndarray) -> np.ndarray:
        """
        Return the torque to send [Nm]; see `limit_torque`.

        :param bias: gravity and Coriolis torque [Nm]
        """
        joints, sent = self._joints, torque.copy()
        limit_torque(position, velocity, bias, self._last, joints.lower, joints.upper,
                     self._torque, self._numbers, sent, excess)
        self._last = sent
        return sent.copy()
