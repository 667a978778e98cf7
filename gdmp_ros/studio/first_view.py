"""From where a motion is looked at first: from the side that shows it, near enough to see it."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

#: Vertical field of view [deg].
FIELD_OF_VIEW = 45.0
#: Share of the smaller side of the picture that the path fills, and the least distance of the eye
#: from its middle [m].
SHARE, NEAREST = 0.58, 0.08
#: Nothing else is known: the arm from the front.
_EYE, _LOOKED_AT = (1.5, -1.3, 0.95), (0.3, -0.1, 0.35)
#: Directions that are tried: around the vertical, and above the horizon [deg].
_AROUND, _ABOVE = range(0, 360, 10), (10, 25, 40, 60)


class View(NamedTuple):
    """
    A camera; z is up.

    :ivar eye: where it is [m]
    :ivar looked_at: what is in the middle of the picture [m]
    """

    eye: np.ndarray
    looked_at: np.ndarray

    def projected(self, points: np.ndarray) -> np.ndarray:
        """
        Points in the picture: right, up, as shares of half of its height; shape (n, 2).

        :param points: shape (n, 3) [m]
        """
        forward, right, up = _axes(self.looked_at - self.eye)
        away = points - self.eye
        depth = np.tan(np.radians(0.5 * FIELD_OF_VIEW)) * (away @ forward)
        return np.asarray(np.column_stack([away @ right, away @ up]) / depth[:, None])


def _axes(forward: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return forward, right, np.cross(right, forward)


def extent(path: np.ndarray | None) -> float:
    """
    Diagonal of the box around a path [m]; 0 if nothing moves.

    :param path: positions, shape (n, 3) [m]
    """
    if path is None or len(path) < 2 or np.ptp(path, axis=0).max() < 1e-4:
        return 0.0
    return float(np.linalg.norm(np.ptp(path, axis=0)))


def first_view(path: np.ndarray | None, aspect: float = 1.0, covered: float = 0.0) -> View:
    """
    The view in which a path is seen from its broad side, and the arm not in front of it.

    :param path: positions, shape (n, 3) [m]; None: the view of an arm
    :param aspect: width of the picture / its height
    :param covered: share of the height that something covers, from below
    """
    size = extent(path)
    if path is None or size == 0.0:
        return View(np.array(_EYE), np.array(_LOOKED_AT))
    middle = 0.5 * (path.min(axis=0) + path.max(axis=0))
    outwards = middle * [1.0, 1.0, 0.0]
    outwards /= max(float(np.linalg.norm(outwards)), 1e-9)
    best, chosen, across = -np.inf, np.zeros(3), 0.0
    for around in np.radians(_AROUND):
        for above in np.radians(_ABOVE):
            way = np.array([np.cos(around) * np.cos(above), np.sin(around) * np.cos(above),
                            np.sin(above)])
            _, right, up = _axes(-way)
            wide, high = (float(np.ptp(path @ axis)) / size for axis in (right, up))
            value = 2.0 * wide * high + max(wide, high) + 0.4 * float(way @ outwards)
            if value > best:
                best, chosen = value, way
                across = size * max(wide / min(aspect, 1.0), high / (1.0 - covered))
    half = np.tan(np.radians(0.5 * FIELD_OF_VIEW))
    distance = max(across / (2.0 * SHARE * half), NEAREST)
    # What is seen is in the middle of what is not covered.
    lower = covered * distance * half * _axes(-chosen)[2]
    return View(middle + distance * chosen - lower, middle - lower)
