"""A motion of all joints from one posture to another."""
from __future__ import annotations

from typing import Protocol

import numpy as np

from gdmp_ros.control.arm_states import Request
from gdmp_ros.control.measurement import JointLimits, Measurement
from gdmp_ros.errors import DataError, ParameterError
from gdmp_ros.util.profiles import minimum_jerk, smoothstep

#: A joint that is further than this from where it is to be does not move freely [rad].
LARGEST_ERROR = 0.2
#: Peak speed of a profile with minimal jerk, as a multiple of its mean speed.
_PEAK = 1.875
#: Time at the end in which the joints come to rest [s].
SETTLE_S = 0.3


class JointMotion(Protocol):
    """
    Motions of the joints that an arm makes instead of following references.

    :ivar request: with which they begin
    """

    request: Request

    @property
    def done(self) -> bool:
        """Whether all motions have been made."""

    @property
    def remaining(self) -> float:
        """Time until they have been made, after the begin [s]."""

    @property
    def what(self) -> str:
        """What is being done, for people."""

    def begin(self, position: np.ndarray) -> None:
        """Begin at positions of the joints [rad]; before, only what is wanted is known."""

    def target(self) -> tuple[np.ndarray, np.ndarray]:
        """Joint positions [rad] and velocities [rad/s] that are wanted now."""

    def add(self, measured: Measurement, torque: np.ndarray, dt: float) -> None:
        """
        Let a tick pass.

        :param torque: that was sent [Nm]
        :raises DataError: if the arm does not follow
        """


def check_follows(acceleration: np.ndarray, measured: Measurement) -> None:
    """:raises DataError: if a joint is far from where it is to be"""
    error = np.abs(acceleration - measured.position)
    if not error.max() <= LARGEST_ERROR:
        at = int(np.argmax(error))
        raise DataError(f'joint {at + 1} is {error[at]:.2g} rad from where it is to be: something '
                        'holds the arm, or its model is wrong')


class PostureMotion:
    """
    From rest to rest by way of postures, all joints together.

    The way has minimal jerk, in straight lines of joint space from posture to posture.
    """

    request, what = Request.MOVE, 'moving to a posture'

    def __init__(self, joints: JointLimits, postures: np.ndarray, speed: float):
        """
        Plan.

        :param postures: on the way, and the goal [rad], shape ``(T, n)``
        :param speed: largest speed of a joint [rad/s]; the limits of the joints hold too
        :raises ParameterError: if the goal is outside the limits, or the speed is not positive
        """
        joints.check(postures[-1])
        if not 0.0 < speed < np.inf:
            raise ParameterError(f'speed is {speed!r} rad/s, expected a positive number')
        self._next, self._fastest = np.array(postures), np.minimum(joints.fastest(speed), speed)
        self.time = self.seconds = 0.0

    def begin(self, position: np.ndarray) -> None:
        """Begin at positions of the joints [rad]."""
        self._postures = np.vstack([position, self._next])
        steps = np.abs(np.diff(self._postures, axis=0)) / self._fastest
        # When each posture is reached at that speed; pauses on the way take no time.
        self._reached = np.concatenate([[0.0], np.cumsum(steps.max(axis=1))])
        self.seconds = float(_PEAK * self._reached[-1])

    @property
    def done(self) -> bool:
        """Whether it has arrived."""
        return self.remaining == 0.0

    @property
    def remaining(self) -> float:
        """Time until it has arrived [s]."""
        return max(0.0, self.seconds + SETTLE_S - self.time)

    def target(self) -> tuple[np.ndarray, np.ndarray]:
        """Joint positions [rad] and velocities [rad/s] that are wanted now."""
        postures, reached = self._postures, self._reached
        s = self.time / self.seconds if self.time < self.seconds else 1.0
        at, rate = minimum_jerk(s) * reached[-1], 30.0 * (s * (1.0 - s)) ** 2
        if at >= reached[-1]:
            return postures[-1], np.zeros_like(postures[-1])
        k = int(np.searchsorted(reached, at, side='right')) - 1
        slope = (postures[k + 1] - postures[k]) / (reached[k + 1] - reached[k])
        return postures[k] + (at - reached[k]) * slope, rate / self.seconds * reached[-1] * slope

    def add(self, measured: Measurement, torque: np.ndarray, dt: float) -> None:
        """Let a tick pass; see `JointMotion`."""
        check_follows(self.target()[0], measured)
        self.time += dt


class Braking:
    """Joints that move come to rest, on the way on which they are."""

    request, what = Request.STOP, 'coming to rest'

    def __init__(self, position: np.ndarray, velocity: np.ndarray, seconds: float):
        """:param seconds: until they rest"""
        self._position, self._velocity = position.copy(), velocity.copy()
        self._now = velocity.copy()
        self.seconds, self.time = seconds, 0.0

    @property
    def done(self) -> bool:
        """Whether they rest."""
        return self.remaining == 0.0

    @property
    def remaining(self) -> float:
        """Time until they rest [s]."""
        return max(0.0, self.seconds - self.time)

    def begin(self, position: np.ndarray) -> None:
        """They move already."""

    def target(self) -> tuple[np.ndarray, np.ndarray]:
        """Joint positions [rad] and velocities [rad/s] that are wanted now."""
        return self._position, self._now

    def add(self, measured: Measurement, torque: np.ndarray, dt: float) -> None:
        """Let a tick pass."""
        self.time += dt
        before = self._now
        self._now = (1.0 - smoothstep(min(self.time / self.seconds, 1.0))) * self._velocity
        self._position = self._position + 0.5 * dt * (before + self._now)
