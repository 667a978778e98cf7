"""S^m_++: symmetric positive definite matrices -- stiffness, manipulability, covariance."""
from __future__ import annotations

import math

import numpy as np

from gdmp_ros.kernels import kernel, noinline
from gdmp_ros.manifolds.factors import Kernels
from gdmp_ros.manifolds.linalg import (
    cholesky,
    congruence,
    copy_into,
    EPS,
    from_mandel,
    gram,
    invert_lower,
    multiply,
    scratch,
    to_mandel,
)
from gdmp_ros.manifolds.manifold import earliest, first_of, Manifold
from gdmp_ros.manifolds.spectral import symmetric_expm, symmetric_logm


@kernel
def _exp(size, base, tangent, point, work):
    """``Exp_U(v) = L expm(L⁻¹ v L⁻ᵀ) Lᵀ``, [GDMP] eq. (A.2) by Cholesky."""
    lower, inverse, matrix, white = (scratch(work, 0, size), scratch(work, 1, size),
                                     scratch(work, 2, size), scratch(work, 3, size))
    if not cholesky(size, base, lower):
        point[:] = math.nan
        return
    invert_lower(size, lower, inverse)
    from_mandel(size, tangent, 1.0, matrix)
    congruence(size, inverse, matrix, white, point)
    # Writes exp(w) and exp(-w); only the first is needed.
    symmetric_expm(size, white, matrix, inverse, work[4 * size * size:])
    congruence(size, lower, matrix, point, white)


@kernel
def _log(size, base, point, tangent, work):
    """``Log_U(Q) = L logm(L⁻¹ Q L⁻ᵀ) Lᵀ``, [GDMP] eq. (A.1) by Cholesky."""
    lower, inverse, white, result = (scratch(work, 0, size), scratch(work, 1, size),
                                     scratch(work, 2, size), scratch(work, 3, size))
    if not cholesky(size, base, lower):
        tangent[:] = math.nan
        return math.inf
    invert_lower(size, lower, inverse)
    congruence(size, inverse, point, white, result)
    symmetric_logm(size, white, result, work[4 * size * size:])
    congruence(size, lower, result, white, inverse)
    to_mandel(size, white, tangent)
    return math.inf


# A frame is (L, L⁻¹) with the point L Lᵀ; the tangent with coordinates ĉ is L ĉ Lᵀ.

@kernel
def _frame(size, point, frame, work):
    lower, inverse = frame[:size * size], frame[size * size:]
    if cholesky(size, point, lower):
        invert_lower(size, lower, inverse)
    else:
        frame[:] = math.nan


@kernel
def _frame_point(size, frame, point, work):
    gram(size, frame, point)


@kernel
def _transport_frame(size, frame, coordinates, work):
    """``L ← L expm(ĉ/2)``, ``L⁻¹ ← expm(-ĉ/2) L⁻¹``."""
    factor, inverse = frame[:size * size], frame[size * size:]
    half, forward, backward = (scratch(work, 0, size), scratch(work, 1, size),
                               scratch(work, 2, size))
    from_mandel(size, coordinates, 0.5, half)
    symmetric_expm(size, half, forward, backward, work[3 * size * size:])
    multiply(size, factor, forward, half)
    copy_into(half, factor)
    multiply(size, backward, inverse, half)
    copy_into(half, inverse)


@kernel
def _log_in_frame(size, frame, point, coordinates, work):
    """``logm(L⁻¹ Q L⁻ᵀ)`` *is* the logarithm in the frame."""
    white, result = scratch(work, 0, size), scratch(work, 1, size)
    congruence(size, frame[size * size:], point, white, result)
    symmetric_logm(size, white, result, work[2 * size * size:])
    to_mandel(size, result, coordinates)
    return math.inf


@kernel
def _change_basis(size, factor, vector, out, work):
    """Mandel coordinates of ``A v Aᵀ``."""
    noinline()
    matrix, image = scratch(work, 0, size), scratch(work, 1, size)
    from_mandel(size, vector, 1.0, matrix)
    congruence(size, factor, matrix, image, work[2 * size * size:])
    to_mandel(size, image, out)


@kernel
def _from_frame(size, frame, coordinates, tangent, work):
    _change_basis(size, frame, coordinates, tangent, work)


@kernel
def _to_frame(size, frame, tangent, coordinates, work):
    _change_basis(size, frame[size * size:], tangent, coordinates, work)


@kernel
def _renormalize_frame(size, frame, work):
    """One Newton step: ``L⁻¹ ← L⁻¹ (2 I - L L⁻¹)``."""
    factor, inverse = frame[:size * size], frame[size * size:]
    residual, result = scratch(work, 0, size), scratch(work, 1, size)
    multiply(size, factor, inverse, residual)
    for i in range(size * size):
        residual[i] = -residual[i]
    for i in range(size):
        residual[i * size + i] += 2.0
    multiply(size, inverse, residual, result)
    copy_into(result, inverse)


@kernel
def _renormalize(size, point, work):
    """``exp`` and ``frame_point`` give exactly symmetric matrices."""


@kernel
def _project_tangent(size, point, vector, tangent, work):
    copy_into(vector, tangent)


class SymmetricPositiveDefinite(Manifold):
    """
    Positive definite matrices with the affine-invariant metric, [GDMP] eqs. (A.1), (A.2).

    A point has shape ``(m, m)``; a tangent is a symmetric matrix as its ``m (m + 1) / 2`` Mandel
    coordinates (upper triangle row by row, off-diagonals times √2). The inner product at U is
    ``tr(U⁻¹ u U⁻¹ v)``. There is no cut locus.
    """

    kind = 'spd'
    unit = 'of the matrix (N/m, Nm/rad)'
    goal_tolerance = 0.0025
    has_cut_locus = False
    kernels = Kernels(exp=_exp, log=_log, frame=_frame, frame_point=_frame_point,
                      transport_frame=_transport_frame, log_in_frame=_log_in_frame,
                      from_frame=_from_frame, to_frame=_to_frame,
                      renormalize_frame=_renormalize_frame, renormalize=_renormalize,
                      project_tangent=_project_tangent)
    #: `project` raises eigenvalues to this fraction of the largest.
    floor = 1e-9

    def __init__(self, m: int):
        """:param m: size of the matrices, at least 1"""
        self._check_size(m, least=1)
        dim = m * (m + 1) // 2
        super().__init__(m, dim=dim, point_shape=(m, m), tangent_size=dim, frame_size=2 * m * m)

    @property
    def components(self) -> list[tuple[str, int]]:
        m = self.size
        return [(f'{i + 1}{j + 1}', i * m + j) for i in range(m) for j in range(i, m)]

    def nearest_point(self, array: np.ndarray) -> np.ndarray:
        scale = max(float(np.abs(array).max()), EPS)
        values, vectors = np.linalg.eigh(0.5 * (array / scale + array.T / scale))
        values *= scale
        if not values[-1] > 0.0:
            raise self.error(f'the largest eigenvalue is {values[-1]:.3g}, expected > 0')
        values = np.maximum(values, self.floor * values[-1])
        nearest = (vectors * values) @ vectors.T
        return np.asarray(0.5 * (nearest + nearest.T))

    def first_invalid(self, points: np.ndarray) -> tuple[int, str] | None:
        # Scaled, because the sum of two large entries may be infinite.
        scales = np.maximum(np.abs(points).max(axis=(1, 2)), EPS)
        scaled = points / scales[:, None, None]
        turned = scaled.transpose(0, 2, 1)
        skew = np.abs(scaled - turned).max(axis=(1, 2))
        least = scales * np.linalg.eigvalsh(0.5 * (scaled + turned))[:, 0]
        return earliest(
            first_of(~(skew <= self.tolerance), lambda i: f'asymmetry is {skew[i]:.3g} of the '
                     f'largest entry, expected <= {self.tolerance:g}'),
            first_of(~(least > 0.0), lambda i:
                     f'smallest eigenvalue is {least[i]:.3g}, expected > 0'))

    def random_point(self, rng: np.random.Generator) -> np.ndarray:
        """Draw ``exp`` of a random symmetric matrix: eigenvalues around 1."""
        return self.exp(np.eye(self.size), 0.5 * rng.standard_normal(self.tangent_size))
