"""R^m: positions, joint angles, forces."""
from __future__ import annotations

import math

import numpy as np

from gdmp_ros.compilation import merged
from gdmp_ros.manifolds import operations as ops
from gdmp_ros.manifolds.manifold import Manifold


@merged
def apply(op, m, a, b, out, work):
    """Answer one of the operations of `gdmp_ros.manifolds.operations`."""
    if op == ops.LOG or op == ops.FRAME_LOG:
        for i in range(m):
            out[i] = b[i] - a[i]
        return math.inf
    if op == ops.EXP:
        for i in range(m):
            out[i] = a[i] + b[i]
    elif op == ops.MOVE:
        for i in range(m):
            a[i] += b[i]
    elif op == ops.VECTOR or op == ops.COORDS or op == ops.TANGENT:
        for i in range(m):
            out[i] = b[i]
    elif op == ops.FRAME or op == ops.POINT:
        for i in range(m):
            out[i] = a[i]
    return 0.0


class Euclidean(Manifold):
    """
    R^m with ``Log_U(Q) = Q - U`` and ``Exp_U(v) = U + v``.

    A point and a tangent have shape ``(m,)``; the frame is the point itself.
    """

    kind = 'euclidean'
    kernel = staticmethod(apply)

    def __init__(self, m: int):
        """:param m: number of coordinates, at least 1"""
        super().__init__(self._size(m, least=1), dim=m, point_shape=(m,), tangent_size=m,
                         frame_size=m)

    def _project(self, array: np.ndarray) -> np.ndarray:
        return array.copy()

    def _defect(self, point: np.ndarray) -> str | None:
        return None

    def random_point(self, rng: np.random.Generator) -> np.ndarray:
        """Draw from the standard normal distribution."""
        return rng.standard_normal(self.m)
