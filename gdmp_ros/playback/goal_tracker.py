"""
Velocity of a goal that keeps moving, estimated from its poses.

A filter of constant velocity on R³ × S³ with fading memory: it works with any rate, jitter and
drop-outs, because each pose counts by its own time.
"""
from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gdmp_ros.manifolds.euclidean import Euclidean
from gdmp_ros.manifolds.product import Product
from gdmp_ros.manifolds.quaternion import UnitQuaternion

#: Poses older than this hardly count [s]: long enough for jitter of 5 ms to change the velocity by
#: 1 %, short for a hand.
MEMORY = 0.4
#: A goal without a new pose for this long rests where it was last seen [s].
TIME_OUT = 0.4
#: A pose further than this from where the goal was expected is another goal [m, rad].
JUMP_M, JUMP_RAD = 0.05, 0.3
#: Poses from which a velocity is known, and the smallest one [m/s, rad/s].
LEAST_POSES = 3
LEAST_SPEED, LEAST_ANGULAR_SPEED = 0.005, 0.03


#: (x, y, z, qw, qx, qy, qz)
POSES = Product(Euclidean(3), UnitQuaternion())


class MovingGoal(NamedTuple):
    """
    A goal now.

    :ivar pose: (x, y, z, qw, qx, qy, qz)
    :ivar twist: linear and angular velocity [m/s, rad/s]; None if it rests
    """

    pose: np.ndarray
    twist: np.ndarray | None


class GoalTracker:
    """Estimates where a goal is and how it moves; times are in seconds of one clock."""

    def __init__(self) -> None:
        self._pose = self._seen = np.zeros(7)
        self._velocity = np.zeros(6)
        self._time = 0.0
        self._count = 0
        # How long it moves on without a new pose [s], and whether its twist was given.
        self._moves, self._timeout, self._given = False, TIME_OUT, False

    def update(self, pose: np.ndarray, time: float, now: float) -> MovingGoal:
        """
        Use a new pose.

        :param pose: (x, y, z, qw, qx, qy, qz)
        :param time: when the goal was there
        :param now: the present, not before ``time``
        :returns: the goal at present
        """
        if self._given:
            self.reset()
        dt = time - self._time
        if self._count and -TIME_OUT <= dt < 0.0:
            return self._at(now, self._moves)  # it comes late: a newer one is known
        self._seen = pose
        if self._count == 0 or not 0.0 <= dt <= TIME_OUT:
            self._begin(pose, time)
        elif dt > 0.0:
            self._correct(pose, time, dt)
        return self._at(now, self._known_to_move())

    def follow(self, pose: np.ndarray, twist: np.ndarray, now: float, timeout: float) -> None:
        """
        Use a goal with a twist that is known, until another one comes or the time is over.

        :param pose: at present
        """
        self.reset()
        # Tangents on S³ are half the rotation vector.
        self._pose, self._seen, self._time, self._timeout = pose, pose, now, timeout
        self._velocity = np.concatenate([twist[:3], 0.5 * twist[3:]])
        self._moves, self._given = bool(twist.any()), True

    def present(self, now: float) -> MovingGoal | None:
        """Where the goal is while it moves; None if it rests."""
        return self._at(now, True) if self._moves else None

    def expired(self, now: float) -> MovingGoal | None:
        """The goal at rest where it was last seen, once, if its poses have ended."""
        if not self._moves or now - self._time <= self._timeout:
            return None
        stopped = MovingGoal(self._at(now, True).pose if self._given else self._seen, None)
        self.reset()
        return stopped

    def reset(self) -> None:
        """Forget the goal."""
        self._moves, self._count, self._timeout, self._given = False, 0, TIME_OUT, False

    def _begin(self, pose: np.ndarray, time: float) -> None:
        self._pose, self._time = pose, time
        self._velocity[:] = 0.0
        self._count, self._moves = 1, False

    def _correct(self, pose: np.ndarray, time: float, dt: float) -> None:
        expected = self._predicted(dt)
        measured = POSES.align(pose, expected)
        offset = POSES.log_anyway(expected, measured)[0]
        if np.linalg.norm(offset[:3]) > JUMP_M or 2.0 * np.linalg.norm(offset[3:]) > JUMP_RAD:
            self._begin(pose, time)
            return
        self._count += 1
        # The first poses count alike, later ones by their age.
        kept = math.exp(-dt / MEMORY)
        shares = (1.0 - kept ** 2, (1.0 - kept) ** 2)
        first = (2.0 * (2.0 * self._count - 1.0), 6.0)
        count = self._count * (self._count + 1.0)
        gain, rate = (max(share, item / count) for share, item in zip(shares, first))
        self._pose = POSES.exp(expected, min(gain, 1.0) * offset)
        self._velocity += min(rate, 1.0) / dt * offset
        self._time = time

    def _predicted(self, dt: float) -> np.ndarray:
        return POSES.exp(self._pose, dt * self._velocity)

    def _known_to_move(self) -> bool:
        fast = (np.linalg.norm(self._velocity[:3]) > LEAST_SPEED
                or 2.0 * np.linalg.norm(self._velocity[3:]) > LEAST_ANGULAR_SPEED)
        self._moves = bool(self._count >= LEAST_POSES and fast)
        return self._moves

    def _at(self, now: float, moving: bool) -> MovingGoal:
        if not moving:
            return MovingGoal(self._seen, None)
        pose = self._predicted(min(max(now - self._time, 0.0), self._timeout))
        # Tangents on S³ are half the rotation vector.
        return MovingGoal(pose, np.concatenate([self._velocity[:3], 2.0 * self._velocity[3:]]))
