"""SO(m): rotation matrices."""
from __future__ import annotations

import numpy as np

from gdmp_ros.kernels import kernel
from gdmp_ros.manifolds.factors import Kernels
from gdmp_ros.manifolds.linalg import (
    copy_into,
    multiply,
    multiply_transposed,
    orthonormalize,
    scratch,
    set_identity,
    transposed_multiply,
)
from gdmp_ros.manifolds.manifold import Manifold
from gdmp_ros.manifolds.point_space import earliest, first_of
from gdmp_ros.manifolds.rotation_maps import (
    exp_at_identity,
    log_at_identity,
    skew_coordinates,
    skew_matrix,
)


@kernel
def _exp(size, base, tangent, point, work):
    """``Exp_U(v) = expm([v]) U``."""
    step = scratch(work, 0, size)
    exp_at_identity(size, tangent, 1.0, step, work[size * size:])
    multiply(size, step, base, point)


@kernel
def _log(size, base, point, tangent, work):
    """``Log_U(Q) = logm(Q Uᵀ)``."""
    relative = scratch(work, 0, size)
    multiply_transposed(size, point, base, relative)
    return log_at_identity(size, relative, tangent, work[size * size:])


# A frame is (A, C) with the point A C; each takes half of every step.

@kernel
def _frame(size, point, frame, work):
    set_identity(size, frame[:size * size])
    copy_into(point, frame[size * size:])


@kernel
def _frame_point(size, frame, point, work):
    multiply(size, frame[:size * size], frame[size * size:], point)


@kernel
def _transport_frame(size, frame, coordinates, work):
    first, second = frame[:size * size], frame[size * size:]
    half, product = scratch(work, 0, size), scratch(work, 1, size)
    exp_at_identity(size, coordinates, 0.5, half, work[2 * size * size:])
    multiply(size, first, half, product)
    copy_into(product, first)
    multiply(size, half, second, product)
    copy_into(product, second)


@kernel
def _log_in_frame(size, frame, point, coordinates, work):
    part, relative = scratch(work, 0, size), scratch(work, 1, size)
    transposed_multiply(size, frame[:size * size], point, part)
    multiply_transposed(size, part, frame[size * size:], relative)
    return log_at_identity(size, relative, coordinates, work[2 * size * size:])


@kernel
def _from_frame(size, frame, coordinates, tangent, work):
    """Coordinates of ``A V Aᵀ``."""
    if size == 3:
        for i in range(3):
            work[i] = (frame[3 * i] * coordinates[0] + frame[3 * i + 1] * coordinates[1]
                       + frame[3 * i + 2] * coordinates[2])
        copy_into(work[:3], tangent)
        return
    matrix, half = scratch(work, 0, size), scratch(work, 1, size)
    skew_matrix(size, coordinates, matrix)
    multiply(size, frame, matrix, half)
    multiply_transposed(size, half, frame, matrix)
    skew_coordinates(size, matrix, tangent)


@kernel
def _to_frame(size, frame, tangent, coordinates, work):
    """Coordinates of ``Aᵀ V A``."""
    matrix, half = scratch(work, 0, size), scratch(work, 1, size)
    skew_matrix(size, tangent, matrix)
    transposed_multiply(size, frame, matrix, half)
    multiply(size, half, frame, matrix)
    skew_coordinates(size, matrix, coordinates)


@kernel
def _renormalize_frame(size, frame, work):
    orthonormalize(size, frame[:size * size], work)
    orthonormalize(size, frame[size * size:], work)


@kernel
def _renormalize(size, point, work):
    orthonormalize(size, point, work)


@kernel
def _project_tangent(size, point, vector, tangent, work):
    copy_into(vector, tangent)


class SpecialOrthogonal(Manifold):
    """
    Rotation matrices of R^m with ``Log_U(Q) = logm(Q Uᵀ)``, [GDMP] eqs. (A.9), (A.10) for m = 3.

    A point has shape ``(m, m)``; a tangent the ``m (m - 1) / 2`` coordinates of a skew matrix in
    the base frame [rad]: the rotation vector for m = 3, the angle for m = 2, otherwise the upper
    triangle row by row.
    """

    kind = 'rotation'
    unit = 'rad'
    goal_tolerance = 0.0025
    # The logarithm turns π / distance times as fast as the point moves near the cut locus: too
    # fast to be learned from samples.
    split_margin = 0.5
    kernels = Kernels(exp=_exp, log=_log, frame=_frame, frame_point=_frame_point,
                      transport_frame=_transport_frame, log_in_frame=_log_in_frame,
                      from_frame=_from_frame, to_frame=_to_frame,
                      renormalize_frame=_renormalize_frame, renormalize=_renormalize,
                      project_tangent=_project_tangent)

    def __init__(self, m: int):
        """:param m: size of the matrices, at least 2"""
        self._check_size(m, least=2)
        dim = m * (m - 1) // 2
        super().__init__(m, dim=dim, point_shape=(m, m), tangent_size=dim, frame_size=2 * m * m)

    @property
    def components(self) -> list[tuple[str, int]]:
        m = self.size
        return [(f'{i + 1}{j + 1}', i * m + j) for i in range(m) for j in range(m)]

    def nearest_point(self, array: np.ndarray) -> np.ndarray:
        left, _, right = np.linalg.svd(array)
        left[:, -1] *= np.sign(np.linalg.det(left @ right))
        return np.ascontiguousarray(left @ right)

    def first_invalid(self, points: np.ndarray) -> tuple[int, str] | None:
        errors = np.abs(points @ points.transpose(0, 2, 1) - np.eye(self.size)).max(axis=(1, 2))
        return earliest(
            first_of(~(errors <= self.tolerance), lambda i: f'R Rᵀ differs from I by '
                     f'{errors[i]:.3g}, expected at most {self.tolerance:g}'),
            first_of(np.linalg.det(points) < 0.0,
                     lambda _: 'determinant is -1 (a reflection), expected +1'))

    def random_point(self, rng: np.random.Generator) -> np.ndarray:
        """Draw uniformly (Haar measure)."""
        q, r = np.linalg.qr(rng.standard_normal((self.size, self.size)))
        q = q * np.sign(np.diag(r))
        if np.linalg.det(q) < 0.0:
            q[:, 0] = -q[:, 0]
        return np.ascontiguousarray(q)
