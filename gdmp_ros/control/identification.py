"""
Friction of the joints, and weight that the model lacks, from slow motions of single joints.

At a constant speed the torque beyond gravity is friction. At the same positions in both directions
an error of the gravity model is the same, and cancels in half the difference; friction cancels in
half the sum. At rest the two cannot be told apart.
"""
from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
import math
from typing import NamedTuple

import numpy as np

from gdmp_ros.control.arm_states import Request
from gdmp_ros.control.joint_motion import JointMotion, Piece
from gdmp_ros.control.kinematics import Chain
from gdmp_ros.control.measurement import JointLimits
from gdmp_ros.control.weight import weight_rows
from gdmp_ros.errors import DataError

#: Speeds at which each joint moves [rad/s], and how far to each side [rad].
SPEEDS, REACH = (0.1, 0.2, 0.4), 0.15
#: Distance that is kept from a joint limit [rad].
MARGIN = 0.05
#: Acceleration at the turns [rad/s²].
ACCELERATION = 3.0
#: Time after a turn that does not count, and time at rest before the first motion [s].
SETTLE_S, REST_S = 0.2, 0.5
#: Error of the torque of a motion in one direction that no moment of weight explains, and size of
#: the moments to be expected [Nm].
UNEXPLAINED_NM, USUAL_NM = 0.1, 1.0
#: Share of a motor's torque that the model may lack.
LARGEST_SHARE = 0.2


class Identified(NamedTuple):
    """
    What slow motions show.

    :ivar viscous: friction of each joint [Nm s/rad], shape ``(n,)``
    :ivar dry: the same, at any speed [Nm]
    :ivar moments: that the model lacks (`gdmp_ros.control.weight`) [Nm], shape ``(n, 3)``
    """

    viscous: np.ndarray
    dry: np.ndarray
    moments: np.ndarray


class _Leg(NamedTuple):
    """
    A motion of one joint between two positions, with ramps at both ends.

    :ivar counts: whether it is one of those that are compared
    """

    joint: int
    first: float
    last: float
    speed: float
    begin: float
    counts: bool

    @property
    def sign(self) -> float:
        """Direction."""
        return math.copysign(1.0, self.last - self.first)

    @property
    def fastest(self) -> float:
        """Speed that is reached [rad/s]; a short motion is slower."""
        return min(self.speed, math.sqrt(ACCELERATION * abs(self.last - self.first)))

    @property
    def seconds(self) -> float:
        """Time that it takes [s]."""
        return abs(self.last - self.first) / self.fastest + self.fastest / ACCELERATION

    def pieces(self, start: np.ndarray) -> list[Piece]:
        """
        Its parts: ramp, constant speed, ramp. In the middle of a leg that counts is measured.

        :param start: positions of the other joints [rad]
        """
        axis = self.sign * np.eye(len(start))[self.joint]
        first = start.copy()
        first[self.joint] = self.first
        ramp, speed, rest = self.fastest / ACCELERATION, self.fastest, -1
        even = self.seconds - 2.0 * ramp
        half = 0.5 * ACCELERATION * axis
        begins = [(0.0, rest)] if not (self.counts and even > 2.0 * SETTLE_S) else [
            (0.0, rest), (SETTLE_S, self.joint), (even - SETTLE_S, rest)]
        pieces = [Piece(self.begin, np.array([first, 0.0 * axis, half]))]
        for after, measured in begins:
            place = first + (0.5 * speed * ramp + speed * after) * axis
            pieces.append(Piece(self.begin + ramp + after, np.array([place, speed * axis]),
                                measured))
        place = first + speed * (0.5 * ramp + even) * axis
        pieces.append(Piece(self.begin + ramp + even, np.array([place, speed * axis, -half])))
        return pieces


class FrictionIdentification(JointMotion):
    """A plan of motions, and what they show; one instance for each identification."""

    request = Request.IDENTIFY

    def __init__(self, joints: JointLimits, chain: Chain, speeds: Sequence[float] = SPEEDS,
                 reach: float = REACH):
        """Plan motions at speeds [rad/s], each so far to both sides [rad]."""
        super().__init__()
        self.progress.steady = 1.0
        self._joints, self._chain = joints, chain
        self._speeds, self._reach = tuple(speeds), reach
        self._legs: list[_Leg] = []

    def begin(self, position: np.ndarray) -> None:
        """Begin at joint positions [rad]; every motion begins and ends there."""
        start, joints, reach = np.array(position, dtype=float), self._joints, self._reach
        time = REST_S
        for joint, middle in enumerate(start):
            low = max(middle - reach, joints.lower[joint] + MARGIN)
            high = min(middle + reach, joints.upper[joint] - MARGIN)
            for speed in self._speeds:
                for first, last, counts in ((middle, high, False), (high, low, True),
                                            (low, high, True), (high, middle, False)):
                    if abs(last - first) < 1e-6:
                        continue
                    leg = _Leg(joint, first, last, speed, time, counts)
                    self._legs.append(leg)
                    time += leg.seconds
        pieces, self._leg_of = [Piece(0.0, start[None])], [-1]
        for number, leg in enumerate(self._legs):
            made = leg.pieces(start)
            pieces += made
            self._leg_of += len(made) * [number]
        # The last piece is constant: the arm stays at the start until Python ends the motion.
        pieces.append(Piece(time, start[None]))
        self._leg_of.append(-1)
        self._plan(pieces, time)

    @property
    def what(self) -> str:
        """What is being done, for people."""
        begun = sum(leg.begin <= self.progress.time for leg in self._legs)
        joint = self._legs[max(begun - 1, 0)].joint if self._legs else 0
        return f'identifying the friction of joint {joint + 1}'

    def result(self) -> Identified:
        """
        Friction of all joints, and weight that the model lacks.

        :raises DataError: if a joint has no room to move, or the model lacks too much
        """
        size = len(self._joints.torque), len(self._speeds), 2
        totals, counts = np.zeros(size), np.zeros(size)
        for leg, (total, count) in zip(self._leg_of, self.path.sums):
            if count > 0.0:
                totals[self._which(self._legs[leg])] += total
                counts[self._which(self._legs[leg])] += count
        if not (counts > 0.0).all():
            at = int(np.argmin((counts > 0.0).all(axis=(1, 2))))
            raise DataError(f'joint {at + 1} has no room to move: begin further from its limits')
        mean = totals / counts
        friction = 0.5 * (mean[:, :, 1] - mean[:, :, 0])
        lacking, most = 0.5 * np.abs(mean.sum(axis=2)).max(axis=1), LARGEST_SHARE
        if (lacking > most * self._joints.torque).any():
            at = int(np.argmax(lacking / self._joints.torque))
            raise DataError(f'the model lacks {lacking[at]:.1f} Nm of weight at joint {at + 1}, '
                            f'expected at most {most * self._joints.torque[at]:.1f}: is what the '
                            'arm carries announced, and the model that of the arm?')
        speeds = np.array(self._speeds)
        from scipy.optimize import nnls  # slow to import
        coefficients = np.array([nnls(np.column_stack([speeds, np.ones_like(speeds)]), row)[0]
                                 for row in friction])
        return Identified(coefficients[:, 0], coefficients[:, 1], self._moments())

    def _which(self, leg: _Leg) -> tuple[int, int, int]:
        """Joint, speed and direction of a motion, as indices."""
        return leg.joint, self._speeds.index(leg.speed), int(leg.sign > 0.0)

    def _moments(self) -> np.ndarray:
        """
        Moments of weight that explain the torque, with the friction of each joint and speed.

        Ridge regression. All samples of a motion in one direction count as one: their error is
        the same.
        """
        n, count = len(self._joints.torque), len(self._speeds)
        samples = self.path.samples[:int(self.progress.sampled)]
        legs = [self._leg_of[int(piece)] for piece in samples[:, 0]]
        sizes = Counter(legs)
        weights = np.array([1.0 / (UNEXPLAINED_NM * math.sqrt(sizes[leg])) for leg in legs])
        rows = np.zeros((len(samples), 3 * n + n * count))
        for row, number, sample in zip(rows, legs, samples):
            leg = self._legs[number]
            row[:3 * n] = weight_rows(self._chain, sample[2:])[leg.joint]
            row[3 * n + leg.joint * count + self._speeds.index(leg.speed)] = leg.sign
        prior = np.concatenate([np.full(3 * n, USUAL_NM ** -2), np.zeros(n * count)])
        weighted = weights[:, None] * rows
        found = np.linalg.solve(weighted.T @ weighted + np.diag(prior),
                                weighted.T @ (weights * samples[:, 1]))
        return np.asarray(found[:3 * n].reshape(n, 3))
