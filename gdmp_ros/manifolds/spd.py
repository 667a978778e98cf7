"""S^m_++: symmetric positive definite matrices -- stiffness, manipulability, covariance."""
from __future__ import annotations

import math

import numpy as np

from gdmp_ros.compilation import compiled
from gdmp_ros.manifolds import operations as ops
from gdmp_ros.manifolds.linalg import (
    cholesky,
    congruence,
    copy_into,
    EPS,
    from_mandel,
    invert_lower,
    multiply,
    symmetric_expm,
    symmetric_logm,
    to_mandel,
)
from gdmp_ros.manifolds.manifold import Manifold


@compiled
def _exp(base, v, out):
    """``Exp_U(v) = L expm(L⁻¹ v L⁻ᵀ) Lᵀ``, [GDMP] eq. (A.2) by Cholesky."""
    m = base.shape[0]
    lower, inverse, tangent, work = (np.empty((m, m)), np.empty((m, m)), np.empty((m, m)),
                                     np.empty((m, m)))
    if not cholesky(base, lower):
        out[:] = math.nan
        return
    invert_lower(lower, inverse)
    from_mandel(v, tangent)
    congruence(inverse, tangent, work)
    symmetric_expm(work, tangent)
    congruence(lower, tangent, out)


@compiled
def _log(base, point, out):
    """``Log_U(Q) = L logm(L⁻¹ Q L⁻ᵀ) Lᵀ``, [GDMP] eq. (A.1) by Cholesky."""
    m = base.shape[0]
    lower, inverse, work, result = (np.empty((m, m)), np.empty((m, m)), np.empty((m, m)),
                                    np.empty((m, m)))
    if not cholesky(base, lower):
        out[:] = math.nan
        return
    invert_lower(lower, inverse)
    congruence(inverse, point, work)
    symmetric_logm(work, result)
    congruence(lower, result, work)
    to_mandel(work, out)


@compiled
def _move(factor, inverse, coordinates):
    """``L ← L expm(ĉ/2)``, ``L⁻¹ ← expm(-ĉ/2) L⁻¹``."""
    m = factor.shape[0]
    half, step, work = np.empty((m, m)), np.empty((m, m)), np.empty((m, m))
    from_mandel(coordinates, half)
    for i in range(m):
        for j in range(m):
            half[i, j] *= 0.5
    symmetric_expm(half, step)
    multiply(factor, step, work)
    factor[:, :] = work
    for i in range(m):
        for j in range(m):
            half[i, j] = -half[i, j]
    symmetric_expm(half, step)
    multiply(step, inverse, work)
    inverse[:, :] = work


@compiled
def _mend(factor, inverse):
    """One Newton step: ``L⁻¹ ← L⁻¹ (2 I - L L⁻¹)``."""
    m = factor.shape[0]
    residue, work = np.empty((m, m)), np.empty((m, m))
    multiply(factor, inverse, residue)
    for i in range(m):
        for j in range(m):
            residue[i, j] = (2.0 if i == j else 0.0) - residue[i, j]
    multiply(inverse, residue, work)
    inverse[:, :] = work


@compiled
def apply(op, m, a, b, out):
    """Answer one of the operations; a frame is (L, L⁻¹) with the point at L Lᵀ."""
    size = m * m
    first = a[:size].reshape(m, m)
    if op == ops.FRAME:
        lower = out[:size].reshape(m, m)
        if cholesky(first, lower):
            invert_lower(lower, out[size:2 * size].reshape(m, m))
        else:
            out[:] = math.nan
        return 0.0
    if op == ops.EXP:
        _exp(first, b, out.reshape(m, m))
        return 0.0
    if op == ops.LOG:
        _log(first, b.reshape(m, m), out)
        return math.inf
    if op == ops.TANGENT:
        copy_into(b, out)
        return 0.0
    if op == ops.MEND_POINT:
        return 0.0
    inverse = a[size:2 * size].reshape(m, m)
    if op == ops.MOVE:
        _move(first, inverse, b)
        return 0.0
    if op == ops.MEND:
        _mend(first, inverse)
        return 0.0
    work = np.empty((m, m))
    if op == ops.FRAME_LOG:
        result = np.empty((m, m))
        congruence(inverse, b.reshape(m, m), work)
        symmetric_logm(work, result)
        to_mandel(result, out)
        return math.inf
    if op == ops.POINT:
        point = out.reshape(m, m)
        for i in range(m):
            for j in range(i + 1):
                total = 0.0
                for k in range(m):
                    total += first[i, k] * first[j, k]
                point[i, j] = total
                point[j, i] = total
    elif op == ops.VECTOR or op == ops.COORDS:
        tangent = np.empty((m, m))
        from_mandel(b, tangent)
        congruence(first if op == ops.VECTOR else inverse, tangent, work)
        to_mandel(work, out)
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
        values, vectors = np.linalg.eigh(0.5 * (array + array.T))
        if not values[-1] > 0.0:
            raise self._no_point(f'the largest eigenvalue is {values[-1]:.3g}, expected > 0')
        values = np.maximum(values, self.floor * values[-1])
        nearest = (vectors * values) @ vectors.T
        return np.asarray(0.5 * (nearest + nearest.T))

    def _defect(self, point: np.ndarray) -> str | None:
        scale = max(float(np.abs(point).max()), EPS)
        skew = float(np.abs(point - point.T).max()) / scale
        if not skew <= self.tolerance:
            return f'asymmetry is {skew:.3g} of the largest entry, expected <= {self.tolerance:g}'
        least = float(np.linalg.eigvalsh(0.5 * (point + point.T))[0])
        if not least > 0.0:
            return f'smallest eigenvalue is {least:.3g}, expected > 0'
        return None

    def random_point(self, rng: np.random.Generator) -> np.ndarray:
        """Draw ``exp`` of a random symmetric matrix: eigenvalues around 1."""
        return self.exp(np.eye(self.m), 0.5 * rng.standard_normal(self.tangent_size))
