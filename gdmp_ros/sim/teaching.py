"""Kinesthetic teaching in simulation: a hand guides a compliant arm; its forces are recorded."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
import math
from typing import NamedTuple

import mujoco
import numpy as np
from scipy.signal import butter, sosfilt

from gdmp_ros.kernels import kernel, local_zeros
from gdmp_ros.manifolds.linalg import limit_norm
from gdmp_ros.manifolds.quaternion import rotation_between
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.native import push
from gdmp_ros.util.settings import setting

#: Damping at the default stiffness [N s/m].
_DAMPING, _STIFFNESS = 110.0, 800.0
#: Time for which the hand holds the tool before and after the motion [s].
REST_S = 0.5


@dataclass(frozen=True)
class HandSettings:
    """
    How the hand holds the tool.

    :ivar rotational_stiffness: [Nm/rad]
    :ivar rotational_damping: [Nm s/rad]
    :ivar torque: largest [Nm]
    """

    stiffness: float = setting(
        _STIFFNESS, 'stiffness with which a guiding hand pulls the tool to ~/hand_pose', 'N/m',
        1.0, 5000.0)
    force: float = setting(40.0, 'largest force of that hand', 'N', 0.1, 200.0)
    rotational_stiffness: float = 40.0
    rotational_damping: float = 4.0
    torque: float = 6.0

    @property
    def damping(self) -> float:
        """Damping that keeps the damping ratio at every stiffness [N s/m]."""
        return float(_DAMPING * (self.stiffness / _STIFFNESS) ** 0.5)


class HandView(NamedTuple):
    """
    A hand, for kernels.

    :ivar pose: of the hand (x, y, z, qw, qx, qy, qz)
    :ivar gains: stiffness, damping, largest force and the same of rotations, shape (2, 3)
    :ivar left: time for which it still holds the tool, shape (1,) [s]; empty without a hand
    """

    pose: np.ndarray
    gains: np.ndarray
    left: np.ndarray


#: A tool that no hand holds.
NO_HAND = HandView(np.zeros(7), np.zeros((2, 3)), np.zeros(0))


@kernel
def pull(hand, touched, pose, twist, dt):
    """
    Let a hand pull from now on.

    :param hand: `NO_HAND`: nothing is done
    :param touched: body of the tool (`gdmp_ros.sim.native.TouchedBody`)
    :param pose: of the tool, as ``twist``
    :param dt: until the next call [s]
    """
    if hand.left.size == 0:
        return
    wrench = local_zeros(6)
    if hand.left[0] > 0.0:
        hand.left[0] -= dt
        _compute_wrench(hand, pose, twist, wrench)
    push(touched, wrench)


@kernel
def _compute_wrench(hand, pose, twist, wrench):
    """Write the wrench of a hand on the tool in the base frame [N, Nm]."""
    rotation_between(pose[3:], hand.pose[3:], wrench[3:])
    for i in range(3):
        wrench[i] = hand.pose[i] - pose[i]
    for part in range(2):
        gains, half = hand.gains[part], wrench[3 * part:3 * part + 3]
        for i in range(3):
            half[i] = gains[0] * half[i] - gains[1] * twist[3 * part + i]
        limit_norm(3, half, gains[2])


class Hand:
    """
    Pulls the tool towards the pose of the hand.

    :ivar view: for kernels
    """

    def __init__(self, pose: np.ndarray, settings: HandSettings | None = None,
                 seconds: float = math.inf):
        """
        Take hold.

        :param pose: of the hand (x, y, z, qw, qx, qy, qz)
        :param seconds: time for which it holds the tool
        """
        s = settings or HandSettings()
        self.view = HandView(np.array(pose, dtype=float), np.array([
            [s.stiffness, s.damping, s.force],
            [s.rotational_stiffness, s.rotational_damping, s.torque]]), np.array([seconds], float))

    @property
    def pose(self) -> np.ndarray:
        """Pose of the hand (x, y, z, qw, qx, qy, qz)."""
        return self.view.pose

    @pose.setter
    def pose(self, pose: np.ndarray) -> None:
        self.view.pose[:] = pose

    @property
    def holds(self) -> bool:
        """Whether its time is not over."""
        return bool(self.view.left[0] > 0.0)


@dataclass(frozen=True)
class GuidingHand:
    """
    How a person guides a tool.

    :ivar intended_pose: (x, y, z, qw, qx, qy, qz) of the guided body at a progress from 0 to 1
    :ivar stiffness: at a progress, 3×3 [N/m]
    :ivar damping: [N s/m]
    :ivar rotational_stiffness: [Nm/rad]
    :ivar rotational_damping: [Nm s/rad]
    :ivar tremor: standard deviation of the force noise from 6 to 10 Hz [N]
    :ivar elbow_torque: joint torque [Nm] at a progress, position and velocity: the other hand
    """

    intended_pose: Callable[[float], np.ndarray]
    stiffness: Callable[[float], np.ndarray]
    damping: float = 40.0
    rotational_stiffness: float = 60.0
    rotational_damping: float = 5.0
    tremor: float = 0.5
    elbow_torque: Callable[[float, np.ndarray, np.ndarray], np.ndarray] | None = None


@dataclass(frozen=True)
class Timing:
    """
    Timing and disturbance of one demonstration.

    :ivar duration: of the motion [s]
    :ivar warp: amplitude of ``s = t + warp sin(2π t)/(2π)``: faster at first, or at the end
    :ivar disturbance: standard deviation of the arm's disturbing torques, 0.4 to 2 Hz [Nm]
    """

    duration: float
    warp: float = 0.0
    disturbance: float = 2.0


@dataclass(frozen=True)
class GuidedMotion:
    """
    Recording of one demonstration, one row per tick.

    :ivar times: [s]
    :ivar joints: [rad]
    :ivar tool: pose of the site ``tcp``
    :ivar positions: of the guided body's centre of mass [m]
    :ivar velocities: of the same [m/s]
    :ivar forces: of the arm on the guided body, without its weight [N]; NaN without a sensor
    :ivar progress: of the hand; only for comparison
    """

    times: np.ndarray
    joints: np.ndarray
    tool: np.ndarray
    positions: np.ndarray
    velocities: np.ndarray
    forces: np.ndarray
    progress: np.ndarray


def demonstrate(arm: Arm, body: str, hand: GuidingHand, timing: Timing,
                rng: np.random.Generator) -> GuidedMotion:
    """
    Guide ``body`` from the present posture of the arm on.

    :param body: name of the body that the hand holds
    """
    ticks = round((timing.duration + 2.0 * REST_S) / arm.period)
    disturbance = timing.disturbance * _noise(rng, ticks, arm.model.nv, (0.4, 2.0), arm.period)
    # Weak joints are disturbed less.
    disturbance *= arm.limits.torque / arm.limits.torque.max()
    tremor = hand.tremor * _noise(rng, ticks, 3, (6.0, 10.0), arm.period)
    guided = arm.model.body(body).id
    rows = []
    for tick in range(ticks):
        now = arm.measure()
        t = np.clip((tick * arm.period - REST_S) / timing.duration, 0.0, 1.0)
        progress = t + timing.warp * np.sin(2.0 * np.pi * t) / (2.0 * np.pi)
        velocity, wrench = _hand_wrench(arm, guided, hand, progress)
        wrench[:3] += tremor[tick]
        arm.data.xfrc_applied[guided] = wrench
        torque = now.bias + disturbance[tick]
        if hand.elbow_torque is not None:
            torque = torque + hand.elbow_torque(progress, now.position, now.velocity)
        row = (tick * arm.period, now.position, now.pose.copy(), arm.data.xipos[guided].copy(),
               velocity, progress)
        arm.step(np.clip(torque, -arm.limits.torque, arm.limits.torque))
        rows.append((*row, _sensed_force(arm, guided)))
    arm.data.xfrc_applied[guided] = 0.0
    times, joints, tool, positions, velocities, known, forces = (np.array(c) for c in zip(*rows))
    return GuidedMotion(times, joints, tool, positions, velocities, forces, known)


def _hand_wrench(arm: Arm, guided: int, hand: GuidingHand, progress: float
                 ) -> tuple[np.ndarray, np.ndarray]:
    """Velocity of the guided body, and the wrench of the hand on it, both in the base frame."""
    data, six = arm.data, np.zeros(6)
    mujoco.mj_objectVelocity(arm.model, data, mujoco.mjtObj.mjOBJ_BODY, guided, six, 0)
    velocity, angular = six[3:].copy(), six[:3].copy()
    intended = hand.intended_pose(progress)
    force = (hand.stiffness(progress) @ (intended[:3] - data.xipos[guided])
             - hand.damping * velocity)
    error = np.empty(3)
    rotation_between(data.xquat[guided].copy(), np.ascontiguousarray(intended[3:]), error)
    torque = hand.rotational_stiffness * error - hand.rotational_damping * angular
    return velocity, np.concatenate([force, torque])


def _sensed_force(arm: Arm, guided: int) -> np.ndarray:
    """Force of the arm on the guided body from its wrist sensor, without its weight [N]."""
    if arm.model.nsensor == 0:
        return np.full(3, np.nan)
    frame = arm.data.site('wrist').xmat.reshape(3, 3)
    weight = arm.model.body_mass[guided] * arm.model.opt.gravity
    return np.asarray(frame @ arm.data.sensor('wrist_force').data + weight)


def _noise(rng: np.random.Generator, ticks: int, width: int, band: tuple[float, float],
           period: float) -> np.ndarray:
    """Noise of unit variance within a band of frequencies [Hz]."""
    settling = round(3.0 / period)
    raw = sosfilt(butter(2, band, 'bandpass', fs=1.0 / period, output='sos'),
                  rng.standard_normal((ticks + settling, width)), axis=0)[settling:]
    return np.asarray(raw / raw.std(axis=0))
