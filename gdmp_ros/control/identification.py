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
from gdmp_ros.control.joint_motion import check_follows
from gdmp_ros.control.kinematics import Chain
from gdmp_ros.control.measurement import JointLimits, Measurement
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
#: Time between two samples for the weight [s].
SAMPLE_S = 0.02
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


class _Sample(NamedTuple):
    """Torque of a moving joint beyond the model [Nm], at joint positions [rad]."""

    position: np.ndarray
    leg: _Leg
    torque: float


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
    def seconds(self) -> float:
        return abs(self.last - self.first) / self.speed + self.speed / ACCELERATION

    def at(self, time: float) -> tuple[float, float]:
        """Position and velocity a time after its beginning."""
        ramp, sign = self.speed / ACCELERATION, math.copysign(1.0, self.last - self.first)
        rest = self.seconds - ramp
        if time < ramp:
            passed, speed = 0.5 * ACCELERATION * time ** 2, ACCELERATION * time
        elif time < rest:
            passed, speed = self.speed * (time - 0.5 * ramp), self.speed
        else:
            left = max(self.seconds - time, 0.0)
            passed = abs(self.last - self.first) - 0.5 * ACCELERATION * left ** 2
            speed = ACCELERATION * left
        return self.first + sign * passed, sign * speed


class FrictionIdentification:
    """A plan of motions, and what they show; one instance for each identification."""

    request = Request.IDENTIFY

    def __init__(self, joints: JointLimits, chain: Chain, speeds: Sequence[float] = SPEEDS,
                 reach: float = REACH):
        """Plan motions at speeds [rad/s], each so far to both sides [rad]."""
        self._joints, self._chain = joints, chain
        self._speeds, self._reach = tuple(speeds), reach
        self.time, self.seconds = 0.0, math.inf

    def begin(self, position: np.ndarray) -> None:
        """Begin at joint positions [rad]; every motion begins and ends there."""
        self._start, joints, reach = np.array(position, dtype=float), self._joints, self._reach
        self._legs: list[_Leg] = []
        time = REST_S
        for joint, middle in enumerate(self._start):
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
        self.seconds = time
        self._present = 0
        count = len(self._start)
        # Sum of torques and number of them, by joint, speed and direction.
        self._sums = np.zeros((2, count, len(self._speeds), 2))
        self._samples: list[_Sample] = []
        self._next = 0.0

    @property
    def done(self) -> bool:
        """Whether all motions have been made."""
        return self.remaining == 0.0

    @property
    def remaining(self) -> float:
        """Time until all have been made [s]."""
        return max(0.0, self.seconds - self.time)

    @property
    def what(self) -> str:
        """What is being done, for people."""
        leg = self._legs[min(self._present, len(self._legs) - 1)]
        return f'identifying the friction of joint {leg.joint + 1}'

    def target(self) -> tuple[np.ndarray, np.ndarray]:
        """Joint positions and velocities that are wanted now."""
        position, velocity = self._start.copy(), np.zeros_like(self._start)
        while (self._present + 1 < len(self._legs)
               and self.time >= self._legs[self._present + 1].begin):
            self._present += 1
        leg = self._legs[self._present]
        if self.time >= leg.begin:
            position[leg.joint], velocity[leg.joint] = leg.at(self.time - leg.begin)
        return position, velocity

    def add(self, measured: Measurement, torque: np.ndarray, dt: float) -> None:
        """
        Use a tick.

        :param torque: that was sent [Nm]
        :raises DataError: if the arm does not follow
        """
        check_follows(self.target()[0], measured)
        leg = self._legs[self._present]
        passed, skipped = self.time - leg.begin, leg.speed / ACCELERATION + SETTLE_S
        if leg.counts and skipped <= passed < leg.seconds - skipped:
            which = (leg.joint, self._speeds.index(leg.speed), int(leg.last > leg.first))
            more = float(torque[leg.joint] - measured.bias[leg.joint])
            self._sums[0][which] += more
            self._sums[1][which] += 1.0
            if self.time >= self._next:
                self._samples.append(_Sample(measured.position.copy(), leg, more))
                self._next = self.time + SAMPLE_S
        self.time += dt

    def result(self) -> Identified:
        """
        Friction of all joints, and weight that the model lacks.

        :raises DataError: if a joint has no room to move, or the model lacks too much
        """
        totals, counts = self._sums
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

    def _moments(self) -> np.ndarray:
        """
        Moments of weight that explain the torque, with the friction of each joint and speed.

        Ridge regression. All samples of a motion in one direction count as one: their error is
        the same.
        """
        n, count = len(self._start), len(self._speeds)
        rows = np.zeros((len(self._samples), 3 * n + n * count))
        sizes = Counter(sample.leg for sample in self._samples)
        weights = np.array([1.0 / (UNEXPLAINED_NM * math.sqrt(sizes[sample.leg]))
                            for sample in self._samples])
        for row, (position, leg, _) in zip(rows, self._samples):
            row[:3 * n] = weight_rows(self._chain, position)[leg.joint]
            row[3 * n + leg.joint * count + self._speeds.index(leg.speed)] = math.copysign(
                1.0, leg.last - leg.first)
        torques = np.array([sample.torque for sample in self._samples])
        prior = np.concatenate([np.full(3 * n, USUAL_NM ** -2), np.zeros(n * count)])
        weighted = weights[:, None] * rows
        found = np.linalg.solve(weighted.T @ weighted + np.diag(prior),
                                weighted.T @ (weights * torques))
        return np.asarray(found[:3 * n].reshape(n, 3))
