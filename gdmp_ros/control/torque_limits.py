"""Limits of the torque that is sent to the motors."""
from __future__ import annotations

import math

import numpy as np

from gdmp_ros.control.limits import JOINT_POSITION, JOINT_SPEED, TORQUE, TORQUE_RATE
from gdmp_ros.control.measurement import JointLimits
from gdmp_ros.control.settings import LIMIT_NUMBERS, LimitSettings
from gdmp_ros.kernels import kernel, records_at
from gdmp_ros.util.settings import numbers

#: A joint is braked from this fraction of its speed limit on.
SPEED_MARGIN = 0.9


@kernel
def limit_torque(position, velocity, bias, last, lower, upper, largest, limit_numbers,
                 torque, violation):
    """
    Apply joint-limit repulsion, joint speed, torque rate and torque limit, in this order.

    A joint that is too fast gets no torque that would accelerate it, and is damped; gravity and
    Coriolis torque are not reduced.

    :param last: torque of the last tick [Nm]
    :param largest: torque limits [Nm]
    :param limit_numbers: `LimitSettings` as numbers
    :param torque: requested; changed to what may be sent [Nm]
    :param violation: written: by how much each limit was exceeded (`LIMITS`)
    """
    limits = records_at(limit_numbers, 0, 1, LIMIT_NUMBERS)[0]
    margin, rate, fastest = limits.joint_margin, limits.torque_rate, limits.joint_speed
    slow = SPEED_MARGIN * fastest
    for i in range(torque.size):
        below = max(lower[i] + margin - position[i], 0.0)
        above = max(position[i] - upper[i] + margin, 0.0)
        if below + above > 0.0:
            violation[JOINT_POSITION] = max(violation[JOINT_POSITION], below, above)
            torque[i] += limits.joint_repulsion * (min(below / margin, 1.0)
                                                   - min(above / margin, 1.0))
        too_fast = abs(velocity[i]) - slow
        if too_fast > 0.0:
            violation[JOINT_SPEED] = max(violation[JOINT_SPEED], too_fast)
            active = torque[i] - bias[i]
            if active * velocity[i] > 0.0:
                active *= max(1.0 - too_fast / (fastest - slow), 0.0)
            brake = math.copysign(limits.joint_brake * too_fast, velocity[i])
            torque[i] = bias[i] + active - brake
        if abs(torque[i]) > largest[i]:
            violation[TORQUE] = max(violation[TORQUE], abs(torque[i]) - largest[i])
        change = torque[i] - last[i]
        if abs(change) > rate:
            violation[TORQUE_RATE] = max(violation[TORQUE_RATE], abs(change) - rate)
            torque[i] = last[i] + math.copysign(rate, change)
        if abs(torque[i]) > largest[i]:
            torque[i] = math.copysign(largest[i], torque[i])


class TorqueLimiter:
    """Limits the torque tick by tick."""

    def __init__(self, joints: JointLimits, settings: LimitSettings):
        self._joints = joints
        self._torque = settings.torque_share * joints.torque
        self._limits = numbers(settings)
        self._last = np.zeros_like(joints.torque)

    @property
    def last(self) -> np.ndarray:
        """Torque that was sent last [Nm]."""
        return self._last.copy()

    def reset(self, torque: np.ndarray) -> None:
        """Begin at ``torque``: the next one may differ from it by the rate."""
        self._last = np.clip(torque, -self._torque, self._torque)

    def apply(self, position: np.ndarray, velocity: np.ndarray, bias: np.ndarray,
              torque: np.ndarray, violation: np.ndarray) -> np.ndarray:
        """
        Return the torque to send [Nm]; see `limit_torque`.

        :param bias: gravity and Coriolis torque [Nm]
        """
        joints, sent = self._joints, torque.copy()
        limit_torque(position, velocity, bias, self._last, joints.lower, joints.upper,
                     self._torque, self._limits, sent, violation)
        self._last = sent
        return sent.copy()
