"""How a measured pose moves: a straight line through what was seen of it within a second."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gdmp_ros.manifolds.poses import moved_on, POSE_SIZE
from gdmp_ros.manifolds.quaternion import (
    conjugate_multiply,
    log_at_identity,
    multiply_conjugate,
    rotate_by_vector,
)

#: Poses from which a twist is estimated: within this time [s], at least so many, over this time.
_WINDOW, _FEWEST, _LEAST_SPAN = 1.0, 4, 0.1
#: A pose this far from where the ones before lead is a jump [m, rad], and in their deviations.
_JUMP, _JUMP_DEVIATIONS = np.array([0.005, 0.03]), 5.0


class Seen(NamedTuple):
    """
    A measured pose.

    :ivar stamp: [s]
    :ivar pose: shape (7,)
    """

    stamp: float
    pose: np.ndarray


class PoseTrack(NamedTuple):
    """
    The poses that tell how something moves; those before a jump do not.

    :ivar seen: oldest first; their stamps increase
    """

    seen: tuple[Seen, ...] = ()

    @property
    def stamp(self) -> float:
        """Of the newest pose [s]."""
        return self.seen[-1].stamp

    def with_pose(self, stamp: float, pose: np.ndarray) -> PoseTrack:
        """The same with another pose, shape (7,), unless a newer one is known."""
        if self.seen and stamp < self.stamp:
            return self
        new = Seen(stamp, pose)
        recent = tuple(one for one in self.seen if one.stamp > stamp - _WINDOW)
        line = _line(recent) if len(recent) >= _FEWEST else None
        if line is not None:
            motion, spread = line
            expected = moved_on(motion[:POSE_SIZE], motion[POSE_SIZE:], stamp - recent[-1].stamp)
            far = np.linalg.norm(offset_from(expected, pose).reshape(2, 3), axis=1)
            if (far > np.maximum(_JUMP, _JUMP_DEVIATIONS * spread)).any():
                return PoseTrack((new,))
        return PoseTrack((*recent, new))

    @property
    def motion(self) -> np.ndarray:
        """Pose and twist at the newest stamp, shape (13,); at rest if too little is known."""
        line = _line(self.seen)
        return np.concatenate([self.seen[-1].pose, np.zeros(6)]) if line is None else line[0]


def offset_from(to: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """Offset of a pose from another: of the position, and as rotation vector in the other."""
    turn = np.empty(4)
    conjugate_multiply(to[3:], pose[3:], turn)
    return np.concatenate([pose[:3] - to[:3], _vector(turn)])


def _vector(q: np.ndarray) -> np.ndarray:
    """Rotation vector of a unit quaternion, with its sign: up to a full turn [rad]."""
    half = np.empty(3)
    log_at_identity(q, half)
    return 2.0 * half


def _line(seen: tuple[Seen, ...]) -> tuple[np.ndarray, np.ndarray] | None:
    """
    Straight line through measured poses; None for too few.

    :returns: pose and twist at the last stamp; deviations of position and rotation, RMS
    """
    last = seen[-1]
    times = np.array([one.stamp - last.stamp for one in seen])
    if len(seen) < _FEWEST or -times[0] < _LEAST_SPAN:
        return None
    values = np.array([np.concatenate([
        one.pose[:3] - last.pose[:3], _vector(_turn_between(last.pose, one.pose))])
                       for one in seen])
    design = np.stack([np.ones(len(times)), times], axis=1)
    fitted = np.linalg.lstsq(design, values, rcond=None)[0]
    deviations = values - design @ fitted
    spread = np.sqrt((deviations.reshape(len(times), 2, 3) ** 2).sum(axis=2).mean(axis=0))
    turned = np.empty(4)
    rotate_by_vector(last.pose[3:], fitted[0, 3:], turned)
    return np.concatenate([last.pose[:3] + fitted[0, :3], turned, fitted[1]]), spread


def _turn_between(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """The quaternion that turns the first pose to the second one, in the base, the short way."""
    turn = np.empty(4)
    multiply_conjugate(second[3:], first[3:], turn)
    return -turn if turn[0] < 0.0 else turn
