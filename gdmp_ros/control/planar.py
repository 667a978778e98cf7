"""Kinematics of a planar arm, and inverse kinematics along a path."""
from __future__ import annotations

from collections.abc import Sequence

import numpy as np

#: Damping of the inverse Jacobian [m²].
_DAMPING = 1e-6
#: Share of the distance to the rest posture that one step removes.
_POSTURE_GAIN = 0.01


class PlanarArm:
    """Serial arm with revolute joints and its base at the origin; angles are relative."""

    def __init__(self, lengths: Sequence[float]):
        """:param lengths: of the links [m]"""
        self.lengths = np.asarray(lengths, dtype=float)

    def position(self, q: np.ndarray) -> np.ndarray:
        """Position of the tip, shape ``(2,)`` [m]."""
        return np.asarray(self.joints(q)[-1])

    def joints(self, q: np.ndarray) -> np.ndarray:
        """Positions of base, joints and tip, shape ``(n + 1, 2)`` [m]."""
        angles = np.cumsum(q)
        links = self.lengths[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
        return np.vstack([np.zeros(2), np.cumsum(links, axis=0)])

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """Jacobian of the tip, shape ``(2, n)`` [m/rad]."""
        points = self.joints(q)
        to_tip = points[-1] - points[:-1]
        return np.array([-to_tip[:, 1], to_tip[:, 0]])

    def follow(self, path: np.ndarray, q: np.ndarray, substeps: int = 4) -> np.ndarray:
        """
        Joint angles that keep the tip on a path, close to the initial posture.

        :param path: shape ``(T, 2)`` [m]
        :param q: initial angles; the tip is moved to the path first
        :returns: shape ``(T, n)``
        """
        rest, result = np.array(q, dtype=float), []
        q = self._move_to(path[0], rest.copy(), rest, 200)
        for point in path:
            q = self._move_to(point, q, rest, substeps)
            result.append(q)
        return np.array(result)

    def _move_to(self, point: np.ndarray, q: np.ndarray, rest: np.ndarray, steps: int
                 ) -> np.ndarray:
        for _ in range(steps):
            jacobian = self.jacobian(q)
            inverse = jacobian.T @ np.linalg.inv(jacobian @ jacobian.T + _DAMPING * np.eye(2))
            posture = _POSTURE_GAIN * (rest - q)
            error = point - self.position(q)
            q = q + posture + inverse @ (error - jacobian @ posture)
        return q
