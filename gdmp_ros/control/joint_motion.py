"""A motion of all joints from one posture to another."""
from __future__ import annotations

from typing import Protocol

import numpy as np

from gdmp_ros.control.measurement import JointLimits, Measurement
from gdmp_ros.control.modes import ArmMode
from gdmp_ros.errors import DataError, ParameterError
from gdmp_ros.util.profiles import minimum_jerk

#: A joint that is further than this from where it is to be does not move freely [rad].
LARGEST_ERROR = 0.2
#: Peak speed of a profile with minimal jerk, as a multiple of its mean speed.
_PEAK = 1.875
#: Time at the end in which the joints come to rest [s].
SETTLE_S = 0.3


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


def _check_speed(speed: float) -> None:
    if not 0.0 < speed < np.inf:
        raise ParameterError(f'speed is {speed!r} rad/s, expected a positive number')


class _RestToRest:
    """From rest to rest with minimal jerk, all joints together; obstacles are not known."""

    mode = ArmMode.MOVE

    def __init__(self, seconds: float):
        self.seconds, self.time = seconds, 0.0

    @property
    def done(self) -> bool:
        """Whether it has arrived."""
        return self.time >= self.seconds + SETTLE_S

    def _progress(self) -> tuple[float, float]:
        """Share of the way that is done, and its rate [1/s]."""
        if self.time >= self.seconds:
            return 1.0, 0.0
        s = self.time / self.seconds
        return minimum_jerk(s), 30.0 * (s * (1.0 - s)) ** 2 / self.seconds

    def target(self) -> tuple[np.ndarray, np.ndarray]:
        """Joint positions [rad] and velocities [rad/s] that are wanted now."""
        raise NotImplementedError

    def add(self, measured: Measurement, torque: np.ndarray, dt: float) -> None:
        """Let a tick pass; see `JointMotion`."""
        check_follows(self.target()[0], measured)
        self.time += dt


class PostureMotion(_RestToRest):
    """Straight from one posture to another."""

    what = 'moving to a posture'

    def __init__(self, joints: JointLimits, start: np.ndarray, goal: np.ndarray, speed: float):
        """
        Plan.

        :param start: present joint positions [rad]
        :param speed: largest speed of a joint [rad/s]; the limits of the joints hold too
        :raises ParameterError: if the goal is outside the limits, or the speed is not positive
        """
        joints.check(goal)
        _check_speed(speed)
        self._start, self._way = start.copy(), goal - start
        fastest = np.minimum(joints.fastest(speed), speed)
        super().__init__(float(_PEAK * np.max(np.abs(self._way) / fastest)))

    def target(self) -> tuple[np.ndarray, np.ndarray]:
        """Joint positions [rad] and velocities [rad/s] that are wanted now."""
        share, rate = self._progress()
        return self._start + share * self._way, rate * self._way


class Retrace(_RestToRest):
    """The way back along postures that were passed, from the last one to the first one."""

    what = 'going back the way it came'

    def __init__(self, joints: JointLimits, postures: np.ndarray, speed: float):
        """
        Plan.

        :param postures: in the order in which they were passed [rad], shape ``(T, n)``
        :param speed: largest speed of a joint [rad/s]; the limits of the joints hold too
        :raises ParameterError: if the speed is not positive
        """
        _check_speed(speed)
        self._back = postures[::-1]
        steps = np.abs(np.diff(self._back, axis=0)) / np.minimum(joints.fastest(speed), speed)
        # When each posture is reached at that speed; pauses on the way take no time.
        self._reached = np.concatenate([[0.0], np.cumsum(steps.max(axis=1))])
        super().__init__(float(_PEAK * self._reached[-1]))

    def target(self) -> tuple[np.ndarray, np.ndarray]:
        """Joint positions [rad] and velocities [rad/s] that are wanted now."""
        share, rate = self._progress()
        if share == 1.0:
            return self._back[-1], np.zeros_like(self._back[-1])
        reached, back = self._reached, self._back
        at = share * reached[-1]
        k = int(np.searchsorted(reached, at, side='right')) - 1
        slope = (back[k + 1] - back[k]) / (reached[k + 1] - reached[k])
        return back[k] + (at - reached[k]) * slope, rate * reached[-1] * slope
