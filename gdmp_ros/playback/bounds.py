"""Bounds speed and acceleration of the stream: other controllers follow it without a guard."""
from __future__ import annotations

import math

import numpy as np

from gdmp_ros.control.governor import catch_up, CATCH_UP_S
from gdmp_ros.control.target import (
    ACCELERATION,
    extrapolate_pose,
    POSE,
    STIFFNESS,
    TARGET_SIZE,
    TWIST,
)
from gdmp_ros.kernels import kernel
from gdmp_ros.manifolds.linalg import limit_norm, norm
from gdmp_ros.manifolds.quaternion import rotation_between
from gdmp_ros.playback.stream_settings import StreamSettings

#: Speed at which a bounded stream catches up, as a share of the largest speed.
CATCH_UP_SHARE = 0.3
#: Rounding of a step.
_TOLERANCE = 1.0 + 1e-6


@kernel
def _bound(target, out, limits, dt):
    """
    Move a bounded reference towards a target by one tick.

    :param out: the bounded reference of the last tick; changed
    :param limits: speed and acceleration, of position and rotation
    :returns: whether it is bounded now
    """
    way, change, jump = np.empty(6), np.empty(6), np.empty(6)
    for i in range(3):
        way[i] = target[POSE + i] - out[POSE + i]
    rotation_between(out[POSE + 3:POSE + 7], target[POSE + 3:POSE + 7], way[3:])
    for i in range(6):
        change[i] = target[TWIST + i] - out[TWIST + i]
        jump[i] = way[i] - dt * (out[TWIST + i] + 0.5 * change[i])
    free = True
    for part in range(2):
        first = 3 * part
        speed, acceleration = limits[2 * part], limits[2 * part + 1]
        free = (free and norm(3, jump[first:first + 3]) <= acceleration * dt * dt
                and norm(3, target[TWIST + first:TWIST + first + 3]) <= _TOLERANCE * speed
                and norm(3, change[first:first + 3]) <= _TOLERANCE * acceleration * dt)
    for i in range(STIFFNESS, out.size):
        out[i] = target[i]
    if free:
        for i in range(STIFFNESS):
            out[i] = target[i]
        return False
    velocity = np.empty(6)
    for part in range(2):
        first = 3 * part
        speed, acceleration = limits[2 * part], limits[2 * part + 1]
        for i in range(first, first + 3):
            velocity[i] = target[TWIST + i]
            way[i] -= dt * velocity[i]
        catch_up(way[first:first + 3], 0.5 * acceleration, CATCH_UP_SHARE * speed,
                 velocity[first:first + 3])
        limit_norm(3, velocity[first:first + 3], speed)
        for i in range(first, first + 3):
            change[i] = velocity[i] - out[TWIST + i]
        limit_norm(3, change[first:first + 3], acceleration * dt)
        for i in range(first, first + 3):
            out[TWIST + i] += change[i]
            out[ACCELERATION + i] = change[i] / dt
    extrapolate_pose(out, dt, out[POSE:POSE + 7])
    return True


class StreamBounds:
    """
    The bounded stream of a player.

    :ivar bounded: ticks in which the bounds were active
    """

    def __init__(self, settings: StreamSettings):
        self._out = np.zeros(TARGET_SIZE)
        self._begun = False
        self.bounded = 0
        self.configure(settings)

    def configure(self, settings: StreamSettings) -> None:
        """Use other bounds from now on."""
        self._limits = np.array([item or math.inf for item in (
            settings.stream_speed, settings.stream_acceleration, settings.stream_angular_speed,
            settings.stream_angular_acceleration)])

    def reset(self) -> None:
        """The next reference begins a stream."""
        self._begun = False

    def apply(self, target: np.ndarray, dt: float) -> np.ndarray:
        """
        Bound the reference of a tick.

        :param target: `TARGET_SIZE` numbers; not changed
        :returns: `TARGET_SIZE` numbers, the same array every time
        """
        if not self._begun:
            self._out[:], self._begun = target, True
        elif dt > 0.0:
            self.bounded += bool(_bound(target, self._out, self._limits, dt))
        return self._out


@kernel
def _bound_joints(target, out, limits, n, dt):
    """
    Move bounded references of n joints towards a target by one tick; see `_bound`.

    :param target: positions, velocities, stiffness, damping ratio, accelerations
    :param limits: largest speed and acceleration [rad/s, rad/s²]
    """
    bounded = False
    speed, acceleration = limits[0], limits[1]
    for i in range(2 * n, out.size):
        out[i] = target[i]
    for i in range(n):
        desired, velocity = target[n + i], out[n + i]
        change = desired - velocity
        jump = target[i] - out[i] - dt * (velocity + 0.5 * change)
        if (abs(jump) <= acceleration * dt * dt and abs(desired) <= _TOLERANCE * speed
                and abs(change) <= _TOLERANCE * acceleration * dt):
            out[i], out[n + i] = target[i], desired
            continue
        bounded = True
        lag = target[i] - out[i] - dt * velocity
        closing = min(abs(lag) / CATCH_UP_S, CATCH_UP_SHARE * speed,
                      math.sqrt(acceleration * abs(lag)))
        desired = min(max(desired + math.copysign(closing, lag), -speed), speed)
        out[n + i] += min(max(desired - velocity, -acceleration * dt), acceleration * dt)
        out[i] += dt * out[n + i]
    return bounded


class JointBounds:
    """
    The bounded stream of a skill of the joints.

    :ivar bounded: ticks in which the bounds were active
    """

    def __init__(self, settings: StreamSettings, joints: int):
        self._n, self._out = joints, np.empty(0)
        self.bounded = 0
        self.configure(settings)

    def configure(self, settings: StreamSettings) -> None:
        """Use other bounds from now on."""
        self._limits = np.array([item or math.inf for item in (
            settings.stream_angular_speed, settings.stream_angular_acceleration)])

    def apply(self, target: np.ndarray, dt: float) -> np.ndarray:
        """Bound the reference of a tick; see `StreamBounds.apply`."""
        if not len(self._out):
            self._out = target.copy()
        elif dt > 0.0:
            self.bounded += bool(_bound_joints(target, self._out, self._limits, self._n, dt))
        return self._out
