"""S^m_++: symmetric positive definite matrices -- stiffness, manipulability, covariance."""
from __future__ import annotations

import math

import numpy as np

from gdmp_ros.compilation import compiled, kept_apart, merged
from gdmp_ros.manifolds import operations as ops
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
from gdmp_ros.manifolds.manifold import Manifold
from gdmp_ros.manifolds.spectral import symmetric_expm, symmetric_logm


@compiled
def _exp(m, base, v, out, work):
    """``Exp_U(v) = L expm(L⁻¹ v L⁻ᵀ) Lᵀ``, [GDMP] eq. (A.2) by Cholesky."""
    kept_apart()
    lower, inverse, tangent, white = (scratch(work, 0, m), scratch(work, 1, m),
                                      scratch(work, 2, m), scratch(work, 3, m))
    if not cholesky(m, base, lower):
        out[:] = math.nan
        return
    invert_lower(m, lower, inverse)
    from_mandel(m, v, 1.0, tangent)
    congruence(m, inverse, tangent, white, out)
    # Of the pair exp(w), exp(-w) the first is wanted.
    symmetric_expm(m, white, tangent, inverse, work[4 * m * m:])
    congruence(m, lower, tangent, out, white)


@compiled
def _log(m, base, point, out, work):
    """``Log_U(Q) = L logm(L⁻¹ Q L⁻ᵀ) Lᵀ``, [GDMP] eq. (A.1) by Cholesky."""
    kept_apart()
    lower, inverse, white, result = (scratch(work, 0, m), scratch(work, 1, m),
                                     scratch(work, 2, m), scratch(work, 3, m))
    if not cholesky(m, base, lower):
        out[:] = math.nan
        return
    invert_lower(m, lower, inverse)
    congruence(m, inverse, point, white, result)
    symmetric_logm(m, white, result, work[4 * m * m:])
    congruence(m, lower, result, white, inverse)
    to_mandel(m, white, out)


@compiled
def _move(m, factor, inverse, coordinates, work):
    """``L ← L expm(ĉ/2)``, ``L⁻¹ ← expm(-ĉ/2) L⁻¹``."""
    half, forth, back = scratch(work, 0, m), scratch(work, 1, m), scratch(work, 2, m)
    from_mandel(m, coordinates, 0.5, half)
    symmetric_expm(m, half, forth, back, work[3 * m * m:])
    multiply(m, factor, forth, half)
    copy_into(half, factor)
    multiply(m, back, inverse, half)
    copy_into(half, inverse)


@compiled
def _mend(m, factor, inverse, work):
    """One Newton step: ``L⁻¹ ← L⁻¹ (2 I - L L⁻¹)``."""
    kept_apart()
    residue, result = scratch(work, 0, m), scratch(work, 1, m)
    multiply(m, factor, inverse, residue)
    for i in range(m * m):
        residue[i] = -residue[i]
    for i in range(m):
        residue[i * m + i] += 2.0
    multiply(m, inverse, residue, result)
    copy_into(result, inverse)


@compiled
def _frame(m, point, lower, inverse):
    kept_apart()
    if cholesky(m, point, lower):
        invert_lower(m, lower, inverse)
    else:
        lower[:] = math.nan
        inverse[:] = math.nan


@compiled
def _log_in_frame(m, inverse, point, out, work):
    """``logm(L⁻¹ Q L⁻ᵀ)`` *is* the logarithm in the frame."""
    white, result = scratch(work, 0, m), scratch(work, 1, m)
    congruence(m, inverse, point, white, result)
    symmetric_logm(m, white, result, work[2 * m * m:])
    to_mandel(m, result, out)


@compiled
def _carry(m, factor, tangent, out, work):
    """Mandel coordinates of ``A v Aᵀ``."""
    matrix, image = scratch(work, 0, m), scratch(work, 1, m)
    from_mandel(m, tangent, 1.0, matrix)
    congruence(m, factor, matrix, image, work[2 * m * m:])
    to_mandel(m, image, out)


@merged
def apply(op, m, a, b, out, work):
    """Answer one of the operations; a frame is (L, L⁻¹) with the point at L Lᵀ."""
    size = m * m
    if op == ops.FRAME:
        _frame(m, a, out[:size], out[size:])
    elif op == ops.EXP:
        _exp(m, a, b, out, work)
    elif op == ops.LOG:
        _log(m, a, b, out, work)
        return math.inf
    elif op == ops.TANGENT:
        copy_into(b, out)
    elif op == ops.MOVE:
        _move(m, a[:size], a[size:], b, work)
    elif op == ops.MEND:
        _mend(m, a[:size], a[size:], work)
    elif op == ops.FRAME_LOG:
        _log_in_frame(m, a[size:], b, out, work)
        return math.inf
    elif op == ops.POINT:
        gram(m, a, out)
    elif op == ops.VECTOR:
        _carry(m, a, b, out, work)
    elif op == ops.COORDS:
        _carry(m, a[size:], b, out, work)
    return 0.0


class SymmetricPositiveDefinite(Manifold):
    """
    Positive definite matrices with the affine-invariant metric, [GDMP] eqs. (A.1), (A.2).

    A point has shape ``(m, m)``; a tangent is a symmetric matrix as its ``m (m + 1) / 2`` Mandel
    coordinates (upper triangle row by row, off-diagonals times √2). The inner product at U is
    ``tr(U⁻¹ u U⁻¹ v)``. There is no cut locus.
    """

    kind = 'spd'
    kernel = staticmethod(apply)
    #: `project` raises eigenvalues to this fraction of the largest.
    floor = 1e-9

    def __init__(self, m: int):
        """:param m: size of the matrices, at least 1"""
        self._size(m, least=1)
        dim = m * (m + 1) // 2
        super().__init__(m, dim=dim, point_shape=(m, m), tangent_size=dim, frame_size=2 * m * m)

    def _project(self, array: np.ndarray) -> np.ndarray:
        scale = max(float(np.abs(array).max()), EPS)
        values, vectors = np.linalg.eigh(0.5 * (array / scale + array.T / scale))
        values *= scale
        if not values[-1] > 0.0:
            raise self._no_point(f'the largest eigenvalue is {values[-1]:.3g}, expected > 0')
        values = np.maximum(values, self.floor * values[-1])
        nearest = (vectors * values) @ vectors.T
        return np.asarray(0.5 * (nearest + nearest.T))

    def _defect(self, point: np.ndarray) -> str | None:
        scale = max(float(np.abs(point).max()), EPS)
        skew = float(np.abs(point / scale - point.T / scale).max())
        if not skew <= self.tolerance:
            return f'asymmetry is {skew:.3g} of the largest entry, expected <= {self.tolerance:g}'
        # Scaled: the sum of two large entries may be infinite, and no eigenvalue found then.
        least = scale * float(np.linalg.eigvalsh(0.5 * (point / scale + point.T / scale))[0])
        if not least > 0.0:
            return f'smallest eigenvalue is {least:.3g}, expected > 0'
        return None

    def random_point(self, rng: np.random.Generator) -> np.ndarray:
        """Draw ``exp`` of a random symmetric matrix: eigenvalues around 1."""
        return self.exp(np.eye(self.m), 0.5 * rng.standard_normal(self.tangent_size))
