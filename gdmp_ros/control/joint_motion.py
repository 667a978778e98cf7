"""Motions of all joints: from posture to posture, and coming to rest."""
from __future__ import annotations

from abc import ABC, abstractmethod
import math
from typing import NamedTuple

import numpy as np

from gdmp_ros.control.arm_states import Request
from gdmp_ros.control.joint_path import (
    FINE,
    HELD,
    JointPath,
    LONGEST_WAIT_S,
    NO_PATH,
    ORDER,
    place_at,
    PROGRESS,
    SAMPLE_S,
    WAITED,
)
from gdmp_ros.control.measurement import JointLimits
from gdmp_ros.errors import ParameterError
from gdmp_ros.kernels import records_at
from gdmp_ros.util.profiles import minimum_jerk

#: Peak speed of a profile with minimal jerk, as a multiple of its mean speed.
_PEAK = 1.875
#: Time at the end in which the joints come to rest [s].
SETTLE_S = 0.3
#: Halvings that find a time of a profile to the last digit.
_HALVINGS = 60


class Piece(NamedTuple):
    """
    A part of a motion.

    :ivar begin: of it [s]
    :ivar coefficients: of the powers of the time since then, for each joint; shape (k, n) with
        k up to `ORDER`
    :ivar measured: joint whose torque is measured, or -1
    """

    begin: float
    coefficients: np.ndarray
    measured: int = -1


class JointMotion(ABC):
    """
    A motion of the joints that an arm makes instead of following references.

    :ivar request: with which it begins
    :ivar path: as the controller makes it; empty before it begins
    """

    request: Request

    def __init__(self) -> None:
        self.path = NO_PATH._replace(progress=NO_PATH.progress.copy())
        self.progress = records_at(self.path.progress, 0, 1, PROGRESS)[0]
        self.progress.seconds = math.inf

    @property
    @abstractmethod
    def what(self) -> str:
        """What is being done, for people."""

    @abstractmethod
    def begin(self, position: np.ndarray) -> None:
        """Begin at positions of the joints [rad]; before, only what is wanted is known."""

    @property
    def done(self) -> bool:
        """Whether it has been made."""
        return self.remaining == 0.0

    @property
    def remaining(self) -> float:
        """Time until it has been made [s]."""
        return max(0.0, float(self.progress.seconds - self.progress.time))

    @property
    def failed(self) -> bool:
        """Whether it cannot go on; see `problem`."""
        return bool(self.progress.problem != FINE)

    def problem(self, blocked: str) -> str:
        """
        Why it cannot go on.

        :param blocked: what is in the way
        """
        found = self.progress
        if found.problem == HELD:
            return (f'joint {int(found.joint) + 1} is {found.apart:.2g} rad from where it is to '
                    'be: something holds the arm, or its model is wrong')
        if found.problem == WAITED:
            return f'it waited {LONGEST_WAIT_S:g} s for {blocked}'
        return 'the arm was slowed down by what is around it: nothing was measured'

    def at(self, time: float) -> tuple[np.ndarray, np.ndarray]:
        """Joint positions [rad] and velocities [rad/s] that are wanted at a time [s]."""
        position = np.empty(self.path.coefficients.shape[2])
        velocity = np.empty_like(position)
        place_at(self.path, time, position, velocity)
        return position, velocity

    def target(self) -> tuple[np.ndarray, np.ndarray]:
        """Joint positions [rad] and velocities [rad/s] that are wanted now, at its tempo."""
        position, velocity = self.at(float(self.progress.time))
        return position, float(self.progress.tempo) * velocity

    def _plan(self, pieces: list[Piece], seconds: float) -> None:
        """Move along pieces, for a time [s]."""
        joints = pieces[0].coefficients.shape[1]
        coefficients = np.zeros((len(pieces), ORDER, joints))
        for row, piece in zip(coefficients, pieces):
            row[:len(piece.coefficients)] = piece.coefficients
        begins = np.array([piece.begin for piece in pieces])
        measured = np.array([piece.measured for piece in pieces])
        lasting = np.diff(np.append(begins, seconds))[measured >= 0]
        # Each piece may have one more than fits in.
        samples = int((np.ceil(lasting / SAMPLE_S) + 1.0).sum())
        self.progress.seconds = seconds
        self.path = JointPath(self.path.progress, begins, coefficients, measured,
                              np.zeros((len(pieces), 2)), np.zeros((samples, 2 + joints)))


class PostureMotion(JointMotion):
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
        super().__init__()
        self._next, self._fastest = np.array(postures), np.minimum(joints.fastest(speed), speed)

    def begin(self, position: np.ndarray) -> None:
        """Begin at positions of the joints [rad]."""
        steps = np.diff(np.vstack([position, self._next]), axis=0)
        # How long each takes at that speed; pauses on the way take no time.
        times = (np.abs(steps) / self._fastest).max(axis=1)
        steps, times = steps[times > 0.0], times[times > 0.0]
        reached = np.concatenate([[0.0], np.cumsum(times)])
        seconds, pieces, place = _PEAK * float(reached[-1]), [], np.array(position)
        if len(times):
            begins = _when(reached[:-1] / reached[-1])
            powers = reached[-1] * _minimum_jerk_from(begins)
            powers[:, 0] -= reached[:-1]
            for k, (step, time) in enumerate(zip(steps, times)):
                shares = powers[k] / time / seconds ** np.arange(ORDER)
                coefficients = np.outer(shares, step)
                coefficients[0] += place
                pieces.append(Piece(float(begins[k]) * seconds, coefficients))
                place = place + step
        pieces.append(Piece(seconds, self._next[-1][None]))
        self._plan(pieces, seconds + SETTLE_S)


def _when(passed: np.ndarray) -> np.ndarray:
    """Times in [0, 1] at which a profile with minimal jerk has passed parts of its way."""
    low, high = np.zeros_like(passed), np.ones_like(passed)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        before = minimum_jerk(middle) < passed
        low, high = np.where(before, middle, low), np.where(before, high, middle)
    return low


def _minimum_jerk_from(u: np.ndarray) -> np.ndarray:
    """Coefficients of `minimum_jerk` as polynomials of the time since times, shape (K, 6)."""
    return np.column_stack([
        minimum_jerk(u), 30.0 * (u * (1.0 - u)) ** 2,
        30.0 * u * (1.0 - u) * (1.0 - 2.0 * u), 10.0 * (1.0 - 6.0 * u + 6.0 * u ** 2),
        15.0 * (2.0 * u - 1.0), np.full_like(u, 6.0)])


class Braking(JointMotion):
    """Joints that move come to rest, on the way on which they are."""

    request, what = Request.STOP, 'coming to rest'

    def __init__(self, position: np.ndarray, velocity: np.ndarray, seconds: float):
        """
        Plan.

        :param position: where they are to be [rad]
        :param velocity: with which they come [rad/s]
        :param seconds: until they rest
        """
        super().__init__()
        self.progress.brakes = 1.0
        # Their velocity decreases like 1 - smoothstep.
        way = np.array([1.0, 0.0, -1.0 / seconds ** 2, 0.5 / seconds ** 3])[:, None] * velocity
        slows = np.vstack([position, way])
        self._plan([Piece(0.0, slows), Piece(seconds, (
            position + 0.5 * seconds * velocity)[None])], seconds)

    def begin(self, position: np.ndarray) -> None:
        """They move already."""
