"""
Objects that were grasped while they were shown: the tool carries their frame along.

Seen from such a frame the motion stands still. It would have all the weight, and when the skill is
executed the tool would follow the frame that follows the tool. So the frame rests where the object
was grasped.
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gdmp_ros.manifolds.poses import compose, inverse
from gdmp_ros.manifolds.quaternion import rotation_angles

#: The tool holds a frame that stays within this of the same place, seen from the tool, and a frame
#: follows its earlier motion within this [m, rad]: a camera is less exact, an object slips.
SAME = np.array([0.005, 0.03])
#: A frame was carried if it leaves its earlier motion by this many times `SAME`.
CARRIED = 4.0
#: Time from which its earlier motion is known [s].
EARLIER_S = 0.5
#: Samples of a take that are compared.
_SAMPLES = 200
#: Fewest samples from which a velocity is known.
_FEWEST = 3


class Grasp(NamedTuple):
    """
    An object that was grasped.

    :ivar time: at which the tool held it [s]
    :ivar pose: of its frame then, (7,)
    """

    time: float
    pose: np.ndarray


def grasp_of(times: np.ndarray, frame: np.ndarray, seen: np.ndarray) -> Grasp | None:
    """
    When an object was grasped; None if it was not.

    It was if the tool and its frame moved as one while the frame left the way, with a constant
    twist or at rest, on which it was before. A tool that follows a frame does not change that.

    :param times: shape (T,) [s]
    :param frame: poses of the frame, (T, 7)
    :param seen: poses of the tool as seen from the frame, (T, 7); turned by nothing if the motion
        has no orientation
    """
    rows = np.unique(np.linspace(0, len(times) - 1, _SAMPLES).round().astype(int))
    times, frame, seen = times[rows], frame[rows], seen[rows]
    for first, last in _together(seen):
        earlier = (times <= times[first]) & (times >= times[first] - EARLIER_S)
        leads, stands = _way(times[earlier], frame[earlier], times)
        off = np.max(_apart(leads, frame) / SAME, axis=1)[first:last + 1]
        if off.max() < CARRIED:
            continue
        # On a belt as late as possible; at rest as soon as the tool is there.
        at = first if stands else first + max(int(np.argmax(off > 0.5)) - 1, 0)
        return Grasp(float(times[at]), leads[at])
    return None


def _together(seen: np.ndarray) -> list[tuple[int, int]]:
    """Longest stretches, by their first and last sample, in which the tool stays at one place."""
    found: list[tuple[int, int]] = []
    last = 0
    for first in range(len(seen)):
        last = max(last, first)
        while last + 1 < len(seen) and np.all(
                _apart(seen[first:last + 1], seen[last + 1:last + 2]) < 2.0 * SAME):
            last += 1
        if not found or last > found[-1][1]:
            found.append((first, last))
    return found


def _apart(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Distances of poses, shape (T, 2) [m, rad]."""
    first, second = np.broadcast_arrays(first, second)
    return np.stack([np.linalg.norm(first[:, :3] - second[:, :3], axis=1), rotation_angles(
        np.ascontiguousarray(first[:, 3:]), np.ascontiguousarray(second[:, 3:]))], axis=1)


def _way(times: np.ndarray, poses: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, bool]:
    """
    Poses at other times on the way with a constant velocity through those, or at rest.

    :returns: the poses, and whether they rest
    """
    middle = poses[len(poses) // 2]
    local = np.array([compose(inverse(middle), pose) for pose in poses])
    local[:, 3:] *= np.where(local[:, 3:4] < 0.0, -1.0, 1.0)
    values = np.concatenate([local[:, :3], local[:, 4:]], axis=1)  # of small turns: the halves
    line = np.stack([values.mean(axis=0), np.zeros(6)])
    if len(times) >= _FEWEST:
        fitted = np.polynomial.polynomial.polyfit(times - times[-1], values, 1)
        speeds = np.array([np.linalg.norm(fitted[1, :3]), 2.0 * np.linalg.norm(fitted[1, 3:])])
        if (speeds * (times[-1] - times[0]) > 0.5 * SAME).any():
            line = fitted
    value = line[0] + (at - times[-1])[:, None] * line[1]
    half = np.linalg.norm(value[:, 3:], axis=1, keepdims=True)
    turned = np.concatenate([np.cos(half), value[:, 3:] * np.sinc(half / np.pi)], axis=1)
    return np.array([compose(middle, np.concatenate([place, turn]))
                     for place, turn in zip(value[:, :3], turned)]), not line[1].any()
