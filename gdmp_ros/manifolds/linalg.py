"""
Small dense linear algebra for the kernels.

For the sizes a manipulation skill meets (2 to 6) plain loops beat LAPACK by 5 to 10 times.
Matrices are contiguous float64 arrays of shape (m, m).
"""
from __future__ import annotations

import math

import numpy as np

from gdmp_ros.compilation import compiled

EPS = 2.0 ** -52
SQRT2 = math.sqrt(2.0)


@compiled
def multiply(a, b, out):
    """``out = a b``; ``out`` must be neither ``a`` nor ``b``."""
    m = a.shape[0]
    for i in range(m):
        for j in range(m):
            total = 0.0
            for k in range(m):
                total += a[i, k] * b[k, j]
            out[i, j] = total


@compiled
def multiply_transposed(a, b, out):
    """``out = a bᵀ``; ``out`` must be neither ``a`` nor ``b``."""
    m = a.shape[0]
    for i in range(m):
        for j in range(m):
            total = 0.0
            for k in range(m):
                total += a[i, k] * b[j, k]
            out[i, j] = total


@compiled
def transposed_multiply(a, b, out):
    """``out = aᵀ b``; ``out`` must be neither ``a`` nor ``b``."""
    m = a.shape[0]
    for i in range(m):
        for j in range(m):
            total = 0.0
            for k in range(m):
                total += a[k, i] * b[k, j]
            out[i, j] = total


@compiled
def congruence(a, s, out):
    """``out = a s aᵀ`` for symmetric ``s``, symmetric to the last bit."""
    m = a.shape[0]
    half = np.empty((m, m))
    multiply(a, s, half)
    for i in range(m):
        for j in range(i + 1):
            total = 0.0
            for k in range(m):
                total += half[i, k] * a[j, k]
            out[i, j] = total
            out[j, i] = total


@compiled
def copy_into(source, out):
    """``out[:] = source`` for flat arrays, as a loop the compiler inlines."""
    for i in range(out.size):
        out[i] = source[i]


@compiled
def set_identity(out):
    """``out = I``."""
    m = out.shape[0]
    for i in range(m):
        for j in range(m):
            out[i, j] = 1.0 if i == j else 0.0


@compiled
def cholesky(a, lower):
    """Lower factor of ``a``; False where ``a`` is not positive definite."""
    m = a.shape[0]
    for j in range(m):
        for i in range(j):
            lower[i, j] = 0.0
        pivot = a[j, j]
        for k in range(j):
            pivot -= lower[j, k] * lower[j, k]
        if not pivot > 0.0:
            return False
        root = math.sqrt(pivot)
        lower[j, j] = root
        for i in range(j + 1, m):
            total = a[i, j]
            for k in range(j):
                total -= lower[i, k] * lower[j, k]
            lower[i, j] = total / root
    return True


@compiled
def invert_lower(lower, out):
    """Inverse of a lower triangular matrix."""
    m = lower.shape[0]
    for j in range(m):
        for i in range(j):
            out[i, j] = 0.0
        out[j, j] = 1.0 / lower[j, j]
        for i in range(j + 1, m):
            total = 0.0
            for k in range(j, i):
                total -= lower[i, k] * out[k, j]
            out[i, j] = total / lower[i, i]


@compiled
def symmetric_eigen(a, values, vectors):
    """
    Eigenvalues and eigenvectors (columns) of symmetric ``a``, which is overwritten.

    Cyclic Jacobi: accurate to the last digits also for graded matrices, and quick where ``a`` is
    nearly diagonal already, as it is along a smooth roll-out.
    """
    m = a.shape[0]
    set_identity(vectors)
    for _ in range(60):
        off, scale = 0.0, 0.0
        for i in range(m):
            scale += a[i, i] * a[i, i]
            for j in range(i):
                off += a[i, j] * a[i, j]
        if off <= 1e-34 * scale or off == 0.0:
            break
        for p in range(m - 1):
            for q in range(p + 1, m):
                apq = a[p, q]
                if apq == 0.0:
                    continue
                theta = 0.5 * (a[q, q] - a[p, p]) / apq
                t = 1.0 / (abs(theta) + math.sqrt(theta * theta + 1.0))
                if theta < 0.0:
                    t = -t
                c = 1.0 / math.sqrt(t * t + 1.0)
                s = t * c
                a[p, p] -= t * apq
                a[q, q] += t * apq
                a[p, q] = 0.0
                a[q, p] = 0.0
                for k in range(m):
                    if k != p and k != q:
                        akp, akq = a[k, p], a[k, q]
                        a[k, p] = c * akp - s * akq
                        a[p, k] = a[k, p]
                        a[k, q] = s * akp + c * akq
                        a[q, k] = a[k, q]
                for k in range(m):
                    vkp, vkq = vectors[k, p], vectors[k, q]
                    vectors[k, p] = c * vkp - s * vkq
                    vectors[k, q] = s * vkp + c * vkq
    for i in range(m):
        values[i] = a[i, i]


@compiled
def compose_eigen(values, vectors, out):
    """``out = V diag(values) Vᵀ``, symmetric to the last bit."""
    m = values.size
    for i in range(m):
        for j in range(i + 1):
            total = 0.0
            for k in range(m):
                total += vectors[i, k] * values[k] * vectors[j, k]
            out[i, j] = total
            out[j, i] = total


@compiled
def symmetric_expm(s, out):
    """``out = exp(s)`` for symmetric ``s``: a short Taylor series for a small one."""
    m = s.shape[0]
    norm2 = 0.0
    for i in range(m):
        for j in range(m):
            norm2 += s[i, j] * s[i, j]
    if norm2 > 0.01:
        work, values, vectors = s.copy(), np.empty(m), np.empty((m, m))
        symmetric_eigen(work, values, vectors)
        for i in range(m):
            values[i] = math.exp(values[i])
        compose_eigen(values, vectors, out)
        return
    norm = math.sqrt(norm2)
    degree, term = 1, norm
    while term > 0.25 * EPS:  # the remainder is below the next term for norm <= 0.1
        degree += 1
        term *= norm / degree
    # Horner: exp(s) = I + s (I + s/2 (I + s/3 (...)))
    work = np.empty((m, m))
    set_identity(out)
    for k in range(degree, 0, -1):
        multiply(s, out, work)
        for i in range(m):
            for j in range(m):
                out[i, j] = work[i, j] / k
            out[i, i] += 1.0


@compiled
def symmetric_logm(s, out):
    """``out = log(s)`` for positive definite ``s``, which is overwritten."""
    m = s.shape[0]
    values, vectors = np.empty(m), np.empty((m, m))
    symmetric_eigen(s, values, vectors)
    for i in range(m):
        values[i] = math.log(values[i])
    compose_eigen(values, vectors, out)


@compiled
def from_mandel(coordinates, out):
    """Symmetric matrix of Mandel coordinates (upper triangle by rows, off-diagonals × √2)."""
    m = out.shape[0]
    k = 0
    for i in range(m):
        out[i, i] = coordinates[k]
        k += 1
        for j in range(i + 1, m):
            out[i, j] = coordinates[k] / SQRT2
            out[j, i] = out[i, j]
            k += 1


@compiled
def to_mandel(s, out):
    """Mandel coordinates of a symmetric matrix (the inverse of `from_mandel`)."""
    m = s.shape[0]
    k = 0
    for i in range(m):
        out[k] = s[i, i]
        k += 1
        for j in range(i + 1, m):
            out[k] = (s[i, j] + s[j, i]) * (0.5 * SQRT2)
            k += 1


@compiled
def sinc(angle):
    """``sin(angle) / angle``, 1 at zero."""
    if abs(angle) < 1e-4:
        return 1.0 - angle * angle / 6.0
    return math.sin(angle) / angle
