"""
Kinesthetic teaching in simulation: a hand leads a compliant arm, and what it feels is recorded.

The arm carries its own weight and no more; its friction, and what its gravity compensation gets
wrong, disturb the hand. The hand is a spring and a damper along the path it intends, with tremor
and with a timing of its own in every demonstration.
"""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.signal import butter, sosfilt

from gdmp_ros.manifolds import UnitQuaternion
from gdmp_ros.sim.arm import Arm

_S3 = UnitQuaternion()


@dataclass(frozen=True)
class Hand:
    """
    How somebody leads a tool.

    :ivar intends: pose (x, y, z, qw, qx, qy, qz) of the led body at a progress from 0 to 1
    :ivar stiffness: at a progress, 3×3 [N/m]
    :ivar damping: [N s/m]
    :ivar turning: stiffness [Nm/rad] and damping [Nm s/rad] of the rotation
    :ivar tremor: standard deviation of the force's noise, 6 to 10 Hz [N]
    :ivar elbow: torque [Nm] on the joints at a progress, as by the other hand on the elbow
    """

    intends: Callable[[float], np.ndarray]
    stiffness: Callable[[float], np.ndarray]
    damping: float = 40.0
    turning: tuple[float, float] = (60.0, 5.0)
    tremor: float = 0.5
    elbow: Callable[[float, np.ndarray, np.ndarray], np.ndarray] | None = None


@dataclass(frozen=True)
class Timing:
    """
    One demonstration's own course.

    :ivar duration: of the motion [s]
    :ivar warp: amplitude of ``s = t + warp sin(2π t)/(2π)``: hurrying first, or last
    :ivar disturbance: standard deviation of joint torques the arm adds, 0.4 to 2 Hz [Nm]
    """

    duration: float
    warp: float = 0.0
    disturbance: float = 2.0


@dataclass(frozen=True)
class Taught:
    """
    What was recorded, one row per tick.

    :ivar times: [s]
    :ivar joints: [rad]
    :ivar tool: pose of the site ``tcp``
    :ivar positions: of the led body's middle [m], with velocities [m/s]
    :ivar forces: of the arm on the led body, its weight taken off [N]; NaN without a sensor
    :ivar progress: what the hand knew of itself; only for comparison
    """

    times: np.ndarray
    joints: np.ndarray
    tool: np.ndarray
    positions: np.ndarray
    velocities: np.ndarray
    forces: np.ndarray
    progress: np.ndarray


#: Before the motion the hand holds the tool this long; after it too [s].
REST_S = 0.5


def demonstrate(arm: Arm, body: str, hand: Hand, timing: Timing,
                rng: np.random.Generator) -> Taught:
    """
    Lead ``body`` along; begins where the arm is.

    :param body: name of the body that the hand holds
    """
    ticks = round((timing.duration + 2.0 * REST_S) / arm.period)
    disturbance = timing.disturbance * _noise(rng, ticks, arm.model.nv, (0.4, 2.0), arm.period)
    # Weak joints are disturbed less.
    disturbance *= arm.limits.torque / arm.limits.torque.max()
    tremor = hand.tremor * _noise(rng, ticks, 3, (6.0, 10.0), arm.period)
    led = arm.model.body(body).id
    rows = []
    for tick in range(ticks):
        now = arm.measure()
        t = np.clip((tick * arm.period - REST_S) / timing.duration, 0.0, 1.0)
        progress = t + timing.warp * np.sin(2.0 * np.pi * t) / (2.0 * np.pi)
        velocity, wrench = _lead(arm, led, hand, progress)
        wrench[:3] += tremor[tick]
        arm.data.xfrc_applied[led] = wrench
        torque = now.bias + disturbance[tick]
        if hand.elbow is not None:
            torque = torque + hand.elbow(progress, now.position, now.velocity)
        row = (tick * arm.period, now.position, now.pose.copy(), arm.data.xipos[led].copy(),
               velocity, progress)
        arm.step(np.clip(torque, -arm.limits.torque, arm.limits.torque))
        rows.append((*row, _sensed(arm, led)))
    arm.data.xfrc_applied[led] = 0.0
    times, joints, tool, positions, velocities, known, forces = (np.array(c) for c in zip(*rows))
    return Taught(times, joints, tool, positions, velocities, forces, known)


def _lead(arm: Arm, led: int, hand: Hand, progress: float) -> tuple[np.ndarray, np.ndarray]:
    """Velocity of the led body's middle, and the hand's wrench on it in the base frame."""
    data, six = arm.data, np.zeros(6)
    mujoco.mj_objectVelocity(arm.model, data, mujoco.mjtObj.mjOBJ_BODY, led, six, 0)
    velocity, turning = six[3:].copy(), six[:3].copy()
    wanted = hand.intends(progress)
    force = (hand.stiffness(progress) @ (wanted[:3] - data.xipos[led])
             - hand.damping * velocity)
    here = data.xquat[led].copy()
    error = 2.0 * _S3.log(here, _S3.align(wanted[3:], here))
    torque = hand.turning[0] * error - hand.turning[1] * turning
    return velocity, np.concatenate([force, torque])


def _sensed(arm: Arm, led: int) -> np.ndarray:
    """Force of the arm on the led body from its wrist sensor, weight taken off [N]."""
    if arm.model.nsensor == 0:
        return np.full(3, np.nan)
    frame = arm.data.site('wrist').xmat.reshape(3, 3)
    weight = arm.model.body_mass[led] * arm.model.opt.gravity
    return np.asarray(frame @ arm.data.sensor('wrist_force').data + weight)


def _noise(rng: np.random.Generator, ticks: int, width: int, band: tuple[float, float],
           period: float) -> np.ndarray:
    """Noise of unit variance within a band of frequencies [Hz]."""
    warm = round(3.0 / period)
    raw = sosfilt(butter(2, band, 'bandpass', fs=1.0 / period, output='sos'),
                  rng.standard_normal((ticks + warm, width)), axis=0)[warm:]
    return np.asarray(raw / raw.std(axis=0))
