"""Kinematics of an arm in the plane, and a path followed with it."""
from __future__ import annotations

from collections.abc import Sequence

import numpy as np

#: Damping of the inverse [m²], gain that takes back what is left of an error, posture gain.
_DAMPING, _GAIN, _POSTURE = 1e-6, 1.0, 0.01


class PlanarArm:
    """Revolute joints in a row, based at the origin; angles from link to link."""

    def __init__(self, lengths: Sequence[float]):
        """:param lengths: of the links [m]"""
        self.lengths = np.asarray(lengths, dtype=float)

    def position(self, q: np.ndarray) -> np.ndarray:
        """Tip, shape ``(2,)`` [m]."""
        return np.asarray(self.joints(q)[-1])

    def joints(self, q: np.ndarray) -> np.ndarray:
        """Positions of base, joints and tip, shape ``(n + 1, 2)`` [m]."""
        angles = np.cumsum(q)
        links = self.lengths[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
        return np.vstack([np.zeros(2), np.cumsum(links, axis=0)])

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """Of the tip, shape ``(2, n)``."""
        points = self.joints(q)
        away = points[-1] - points[:-1]
        return np.array([-away[:, 1], away[:, 0]])

    def follow(self, path: np.ndarray, q: np.ndarray, substeps: int = 4) -> np.ndarray:
        """
        Joint angles that keep the tip on a path, near the posture they begin with.

        :param path: shape ``(T, 2)`` [m]
        :param q: angles to begin from; the tip is brought to the path first
        :returns: shape ``(T, n)``
        """
        rest, result = np.array(q, dtype=float), []
        q = self._to(path[0], rest.copy(), rest, 200)
        for point in path:
            q = self._to(point, q, rest, substeps)
            result.append(q)
        return np.array(result)

    def _to(self, point: np.ndarray, q: np.ndarray, rest: np.ndarray, steps: int) -> np.ndarray:
        for _ in range(steps):
            jacobian = self.jacobian(q)
            inverse = jacobian.T @ np.linalg.inv(jacobian @ jacobian.T + _DAMPING * np.eye(2))
            step = inverse @ (_GAIN * (point - self.position(q)))
            drift = _POSTURE * (rest - q)
            q = q + step + drift - inverse @ (jacobian @ drift)
        return q
