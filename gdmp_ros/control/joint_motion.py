"""A motion of all joints from one posture to another."""
from __future__ import annotations

from typing import Protocol

import numpy as np

from gdmp_ros.control.measurement import JointLimits, Measurement
from gdmp_ros.control.modes import ArmMode
from gdmp_ros.errors import DataError, ParameterError

#: A joint that is further than this from where it is to be does not move freely [rad].
LARGEST_ERROR = 0.2
#: Peak speed of a profile with minimal jerk, as a multiple of its mean speed.
_PEAK = 1.875
#: Time at the end in which the joints come to rest [s].
SETTLE_S = 0.3
#: Time over which a velocity is computed [s].
_STEP = 1e-3


class JointMotion(Protocol):
    """
    Motions of the joints that an arm makes instead of following references.

    :ivar mode: what the arm says it does
    """

    mode: ArmMode

    @property
    def done(self) -> bool:
        """Whether all motions have been made."""

    @property
    def what(self) -> str:
        """What is being done, for people."""

    def target(self) -> tuple[np.ndarray, np.ndarray]:
        """Joint positions [rad] and velocities [rad/s] that are wanted now."""

    def add(self, measured: Measurement, torque: np.ndarray, dt: float) -> None:
        """
        Let a tick pass.

        :param torque: that was sent [Nm]
        :raises DataError: if the arm does not follow
        """


def check_follows(wanted: np.ndarray, measured: Measurement) -> None:
    """:raises DataError: if a joint is far from where it is to be"""
    error = np.abs(wanted - measured.position)
    if not error.max() <= LARGEST_ERROR:
        at = int(np.argmax(error))
        raise DataError(f'joint {at + 1} is {error[at]:.2g} rad from where it is to be: something '
                        'holds the arm, or its model is wrong')


class PostureMotion:
    """From rest to rest with minimal jerk, all joints together; obstacles are not known."""

    mode = ArmMode.MOVE
    what = 'moving to a posture'

    def __init__(self, joints: JointLimits, start: np.ndarray, goal: np.ndarray, speed: float):
        """
        Plan.

        :param start: present joint positions [rad]
        :param speed: largest speed of a joint [rad/s]; the limits of the joints hold too
        :raises ParameterError: if the goal is outside the limits, or the speed is not positive
        """
        joints.check(goal)
        if not 0.0 < speed < np.inf:
            raise ParameterError(f'speed is {speed!r} rad/s, expected a positive number')
        self._start, self._way = start.copy(), goal - start
        fastest = np.minimum(joints.fastest(speed), speed)
        self.seconds = float(_PEAK * np.max(np.abs(self._way) / fastest))
        self.time = 0.0

    @property
    def done(self) -> bool:
        """Whether it has arrived."""
        return self.time >= self.seconds + SETTLE_S

    def target(self) -> tuple[np.ndarray, np.ndarray]:
        """Joint positions [rad] and velocities [rad/s] that are wanted now."""
        if self.time >= self.seconds:
            return self._start + self._way, np.zeros_like(self._way)
        s = self.time / self.seconds
        share = s ** 3 * (10.0 - 15.0 * s + 6.0 * s ** 2)
        rate = 30.0 * (s * (1.0 - s)) ** 2 / self.seconds
        return self._start + share * self._way, rate * self._way

    def add(self, measured: Measurement, torque: np.ndarray, dt: float) -> None:
        """Let a tick pass; see `JointMotion`."""
        check_follows(self.target()[0], measured)
        self.time += dt


class Retrace:
    """The way back along postures that were passed, from the last one to the first one."""

    mode = ArmMode.MOVE
    what = 'going back the way it came'

    def __init__(self, joints: JointLimits, postures: np.ndarray, speed: float):
        """
        Plan.

        :param postures: in the order in which they were passed [rad], shape ``(T, n)``
        :param speed: largest speed of a joint [rad/s]; the limits of the joints hold too
        """
        self._back = postures[::-1]
        steps = np.abs(np.diff(self._back, axis=0)) / np.minimum(joints.fastest(speed), speed)
        # Pauses on the way take no time.
        self._reached = np.concatenate([[0.0], np.cumsum(steps.max(axis=1))])
        self.seconds = float(_PEAK * self._reached[-1])
        self.time = 0.0

    @property
    def done(self) -> bool:
        """Whether it has arrived."""
        return self.time >= self.seconds + SETTLE_S

    def _at(self, time: float) -> np.ndarray:
        s = min(time / self.seconds, 1.0) if self.seconds > 0.0 else 1.0
        share = s ** 3 * (10.0 - 15.0 * s + 6.0 * s ** 2)
        return np.array([np.interp(share * self._reached[-1], self._reached, column)
                         for column in self._back.T])

    def target(self) -> tuple[np.ndarray, np.ndarray]:
        """Joint positions [rad] and velocities [rad/s] that are wanted now."""
        now = self._at(self.time)
        return now, (self._at(self.time + _STEP) - now) / _STEP

    def add(self, measured: Measurement, torque: np.ndarray, dt: float) -> None:
        """Let a tick pass; see `JointMotion`."""
        check_follows(self.target()[0], measured)
        self.time += dt
