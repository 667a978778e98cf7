"""R^m: positions, joint angles, forces."""
from __future__ import annotations

import math

import numpy as np

from gdmp_ros.kernels import kernel
from gdmp_ros.manifolds.factors import Kernels
from gdmp_ros.manifolds.manifold import Manifold


@kernel
def _add(size, base, tangent, point, work):
    for i in range(size):
        point[i] = base[i] + tangent[i]


@kernel
def _subtract(size, base, point, tangent, work):
    for i in range(size):
        tangent[i] = point[i] - base[i]
    return math.inf


@kernel
def _copy(size, source, target, work):
    for i in range(size):
        target[i] = source[i]


@kernel
def _move(size, frame, coordinates, work):
    for i in range(size):
        frame[i] += coordinates[i]


@kernel
def _same_vector(size, at, source, target, work):
    for i in range(size):
        target[i] = source[i]


@kernel
def _nothing(size, array, work):
    """A flat space has no rounding to remove."""


class Euclidean(Manifold):
    """
    R^m with ``Log_U(Q) = Q - U`` and ``Exp_U(v) = U + v``.

    A point and a tangent have shape ``(m,)``; the frame is the point itself.
    """

    kind = 'euclidean'
    unit = 'm'
    goal_tolerance = 0.0005
    has_cut_locus = False
    is_flat = True
    kernels = Kernels(exp=_add, log=_subtract, frame=_copy, frame_point=_copy,
                      transport_frame=_move, log_in_frame=_subtract, from_frame=_same_vector,
                      to_frame=_same_vector, renormalize_frame=_nothing, renormalize=_nothing,
                      project_tangent=_same_vector)

    def __init__(self, m: int):
        """:param m: number of coordinates, at least 1"""
        super().__init__(self._check_size(m, least=1), dim=m, point_shape=(m,), tangent_size=m,
                         frame_size=m)

    def nearest_point(self, array: np.ndarray) -> np.ndarray:
        return array.copy()

    def first_invalid(self, points: np.ndarray) -> tuple[int, str] | None:
        return None

    def random_point(self, rng: np.random.Generator) -> np.ndarray:
        """Draw from the standard normal distribution."""
        return rng.standard_normal(self.size)
