"""
Functions of symmetric matrices for kernels: eigenvalues, exponential, logarithm.

Eigenvectors are rows. Cyclic Jacobi up to 3×3, Householder reduction and implicit QL from 4×4 on:
the faster method at each size. Nothing allocates; ``work`` is flat scratch memory.
"""
from __future__ import annotations

import math

from gdmp_ros.kernels import always_inline, inlined, kernel, noinline
from gdmp_ros.manifolds.linalg import copy_into, EPS, multiply, row_of, scratch, set_identity

#: From this size on the reduction to a tridiagonal matrix is faster.
_QL_FROM = 4


@inlined
def _rotation(app, aqq, apq):
    """Tangent, cosine and sine of the plane rotation that makes ``apq`` zero."""
    gap, twice = aqq - app, 2.0 * apq
    radius = math.sqrt(gap * gap + twice * twice)
    if radius == 0.0:
        return 0.0, 1.0, 0.0
    # (|gap| + radius)² + twice² = 2 radius (|gap| + radius): the divisions are independent.
    along = abs(gap) + radius
    scale = 1.0 / math.sqrt(2.0 * radius * along)
    twice = math.copysign(twice, twice * gap)
    return twice / along, along * scale, twice * scale


@kernel
def _jacobi(m, a, vectors):
    """Diagonalise ``a`` in place by plane rotations; accurate also for graded matrices."""
    noinline()
    set_identity(m, vectors)
    for _ in range(60):
        off, scale = 0.0, 0.0
        for i in range(m):
            scale += a[i * m + i] * a[i * m + i]
            for j in range(i):
                off += a[i * m + j] * a[i * m + j]
        if off <= 1e-34 * scale or off == 0.0:
            break
        for p in range(m - 1):
            for q in range(p + 1, m):
                apq = a[p * m + q]
                if apq == 0.0:
                    continue
                t, c, s = _rotation(a[p * m + p], a[q * m + q], apq)
                a[p * m + p] -= t * apq
                a[q * m + q] += t * apq
                a[p * m + q] = 0.0
                a[q * m + p] = 0.0
                for k in range(m):
                    if k != p and k != q:
                        akp, akq = a[k * m + p], a[k * m + q]
                        a[k * m + p] = c * akp - s * akq
                        a[p * m + k] = a[k * m + p]
                        a[k * m + q] = s * akp + c * akq
                        a[q * m + k] = a[k * m + q]
                for k in range(m):
                    vpk, vqk = vectors[p * m + k], vectors[q * m + k]
                    vectors[p * m + k] = c * vpk - s * vqk
                    vectors[q * m + k] = s * vpk + c * vqk


@kernel
def _jacobi3(a, values, v):
    """`_jacobi` for a 3×3 matrix, with all numbers in registers."""
    noinline()
    x, y, z, xy, xz, yz = a[0], a[4], a[8], a[1], a[2], a[5]
    v0, v1, v2, v3, v4, v5, v6, v7, v8 = 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0
    for _ in range(60):
        off = xy * xy + xz * xz + yz * yz
        if off <= 1e-34 * (x * x + y * y + z * z) or off == 0.0:
            break
        t, c, s = _rotation(x, y, xy)
        x, y, xy, xz, yz = x - t * xy, y + t * xy, 0.0, c * xz - s * yz, s * xz + c * yz
        v0, v3 = c * v0 - s * v3, s * v0 + c * v3
        v1, v4 = c * v1 - s * v4, s * v1 + c * v4
        v2, v5 = c * v2 - s * v5, s * v2 + c * v5
        t, c, s = _rotation(x, z, xz)
        x, z, xz, xy, yz = x - t * xz, z + t * xz, 0.0, c * xy - s * yz, s * xy + c * yz
        v0, v6 = c * v0 - s * v6, s * v0 + c * v6
        v1, v7 = c * v1 - s * v7, s * v1 + c * v7
        v2, v8 = c * v2 - s * v8, s * v2 + c * v8
        t, c, s = _rotation(y, z, yz)
        y, z, yz, xy, xz = y - t * yz, z + t * yz, 0.0, c * xy - s * xz, s * xy + c * xz
        v3, v6 = c * v3 - s * v6, s * v3 + c * v6
        v4, v7 = c * v4 - s * v7, s * v4 + c * v7
        v5, v8 = c * v5 - s * v8, s * v5 + c * v8
    values[0], values[1], values[2] = x, y, z
    v[0], v[1], v[2], v[3], v[4], v[5], v[6], v[7], v[8] = v0, v1, v2, v3, v4, v5, v6, v7, v8


@kernel
def _tridiagonalise(m, a, diagonal, beside, vectors, product):
    """
    Householder reflections: ``a = Vᵀ T V`` with V = ``vectors`` and T tridiagonal.

    The reflections are kept in the rows of ``a`` beyond the diagonal, scaled to length √2, and
    accumulated in ``vectors`` at the end.
    """
    noinline()
    for k in range(m - 2):
        mirror, size = a[k * m + k + 1:(k + 1) * m], m - k - 1
        total = 0.0
        for i in range(size):
            total += mirror[i] * mirror[i]
        length = math.copysign(math.sqrt(total), mirror[0])
        beside[k] = -length
        diagonal[k] = a[k * m + k]
        mirror[0] += length
        total = length * mirror[0]
        scale = 1.0 / math.sqrt(total) if total > 0.0 else 0.0
        for i in range(size):
            mirror[i] *= scale
        along = 0.0
        for i in range(size):
            row, total = a[(k + 1 + i) * m + k + 1:(k + 2 + i) * m], 0.0
            for j in range(size):
                total += row[j] * mirror[j]
            product[i] = total
            along += total * mirror[i]
        for i in range(size):
            product[i] -= 0.5 * along * mirror[i]
        for i in range(size):
            row = a[(k + 1 + i) * m + k + 1:(k + 2 + i) * m]
            vi, wi = mirror[i], product[i]
            for j in range(size):
                row[j] -= vi * product[j] + wi * mirror[j]
    for k in range(max(m - 2, 0), m):
        diagonal[k] = a[k * m + k]
    beside[m - 2] = a[(m - 2) * m + m - 1]
    beside[m - 1] = 0.0
    set_identity(m, vectors)
    for k in range(m - 3, -1, -1):
        mirror, size = a[k * m + k + 1:(k + 1) * m], m - k - 1
        for i in range(size):
            row, total = vectors[(k + 1 + i) * m + k + 1:(k + 2 + i) * m], 0.0
            for j in range(size):
                total += row[j] * mirror[j]
            for j in range(size):
                row[j] -= total * mirror[j]


@kernel
def _ql(m, diagonal, beside, vectors):
    """Diagonalise a tridiagonal matrix by implicit QL steps, rotating the rows of ``vectors``."""
    noinline()
    for first in range(m):
        for _ in range(60):
            last = first
            while last < m - 1:
                near = abs(diagonal[last]) + abs(diagonal[last + 1])
                if abs(beside[last]) <= 0.5 * EPS * near:
                    break
                last += 1
            if last == first:
                break
            g = (diagonal[first + 1] - diagonal[first]) / (2.0 * beside[first])
            shift = g + math.copysign(math.sqrt(g * g + 1.0), g)
            g = diagonal[last] - diagonal[first] + beside[first] / shift
            s, c, p, r = 1.0, 1.0, 0.0, 1.0
            i = last - 1
            while i >= first:
                f, b = s * beside[i], c * beside[i]
                r = math.sqrt(f * f + g * g)
                beside[i + 1] = r
                if r == 0.0:
                    diagonal[i + 1] -= p
                    beside[last] = 0.0
                    break
                s, c = f / r, g / r
                g = diagonal[i + 1] - p
                turn = (diagonal[i] - g) * s + 2.0 * c * b
                p = s * turn
                diagonal[i + 1] = g + p
                g = c * turn - b
                upper, lower = row_of(vectors, i, m), row_of(vectors, i + 1, m)
                for k in range(m):
                    item, other = upper[k], lower[k]
                    lower[k] = s * item + c * other
                    upper[k] = c * item - s * other
                i -= 1
            if r == 0.0 and i >= first:
                continue
            diagonal[first] -= p
            beside[first] = g
            beside[last] = 0.0


@kernel
def symmetric_eigen(m, a, values, vectors, work):
    """
    Eigenvalues and eigenvectors (rows) of symmetric ``a``, which is overwritten.

    :param work: scratch memory of at least ``2 m`` numbers
    """
    if m >= _QL_FROM:
        beside = work[:m]
        _tridiagonalise(m, a, values, beside, vectors, work[m:2 * m])
        _ql(m, values, beside, vectors)
        return
    if m == 3:
        _jacobi3(a, values, vectors)
        return
    _jacobi(m, a, vectors)
    for i in range(m):
        values[i] = a[i * m + i]


@always_inline
def _compose(m, values, vectors, out):
    for i in range(m * m):
        out[i] = 0.0
    for k in range(m):
        vector = row_of(vectors, k, m)
        for i in range(m):
            scaled, row = values[k] * vector[i], row_of(out, i, m)
            for j in range(i + 1):
                row[j] += scaled * vector[j]
    for i in range(m):
        for j in range(i):
            out[j * m + i] = out[i * m + j]


@kernel
def compose_eigen(m, values, vectors, out):
    """``out = Vᵀ diag(values) V``, exactly symmetric."""
    noinline()
    if m == 3:
        _compose(3, values, vectors, out)
    elif m == 6:
        _compose(6, values, vectors, out)
    else:
        _compose(m, values, vectors, out)


@kernel
def compose_pair(m, values, vectors, out, inverse):
    """`compose_eigen` to ``out`` and its inverse to ``inverse``; ``values`` are overwritten."""
    compose_eigen(m, values, vectors, out)
    for i in range(m):
        values[i] = 1.0 / values[i]
    compose_eigen(m, values, vectors, inverse)


@kernel
def symmetric_logm(m, s, out, work):
    """
    ``out = log(s)`` for positive definite ``s``, which is overwritten.

    :param work: scratch memory of at least ``m² + 3 m`` numbers
    """
    noinline()
    vectors, values = scratch(work, 0, m), work[m * m:m * m + m]
    symmetric_eigen(m, s, values, vectors, work[m * m + m:])
    for i in range(m):
        values[i] = math.log(values[i])
    compose_eigen(m, values, vectors, out)


@always_inline
def _exp_series(m, s, norm2, out, inverse, work):
    # The remainder is smaller than the next term; ``terms`` counts pairs of even and odd powers.
    terms, term = 1, norm2
    while term > 0.25 * EPS:
        terms += 1
        term *= norm2 / ((2 * terms - 1) * (2 * terms - 2))
    square, power, odd, product = (scratch(work, 0, m), scratch(work, 1, m), scratch(work, 2, m),
                                   scratch(work, 3, m))
    multiply(m, s, s, square)
    even_scale, odd_scale = 0.5, 1.0 / 6.0
    for i in range(m * m):
        power[i] = square[i]
        out[i] = even_scale * square[i]
        odd[i] = odd_scale * square[i]
    for k in range(2, terms + 1):
        multiply(m, power, square, product)
        even_scale /= (2 * k - 1) * (2 * k)
        odd_scale /= (2 * k) * (2 * k + 1)
        for i in range(m * m):
            power[i] = product[i]
            out[i] += even_scale * product[i]
            odd[i] += odd_scale * product[i]
    for i in range(m):
        odd[i * m + i] += 1.0
    multiply(m, s, odd, inverse)
    for i in range(m * m):
        even, part = out[i], inverse[i]
        out[i] = even + part
        inverse[i] = even - part
    for i in range(m):
        out[i * m + i] += 1.0
        inverse[i * m + i] += 1.0


@kernel
def symmetric_expm(m, s, out, inverse, work):
    """
    ``out = exp(s)`` and ``inverse = exp(-s)`` for symmetric ``s``.

    A small ``s`` takes a Taylor series: exp(±s) = cosh(s) ± s · sinhc(s), both even in s. Up to a
    norm of 1 it is faster than the eigenvalues are, and loses a factor of e² in precision at most.

    :param work: scratch memory of at least ``4 m²`` numbers
    """
    noinline()
    norm2 = 0.0
    for i in range(m * m):
        norm2 += s[i] * s[i]
    if norm2 > 1.0:
        _expm_by_eigenvalues(m, s, out, inverse, work)
    elif m == 3:
        _exp_series(3, s, norm2, out, inverse, work)
    elif m == 6:
        _exp_series(6, s, norm2, out, inverse, work)
    else:
        _exp_series(m, s, norm2, out, inverse, work)


@kernel
def _expm_by_eigenvalues(m, s, out, inverse, work):
    noinline()
    vectors = scratch(work, 0, m)
    values, rest = work[m * m:m * m + m], work[m * m + m:]
    copy_into(s, out)
    symmetric_eigen(m, out, values, vectors, rest)
    for i in range(m):
        values[i] = math.exp(values[i])
    compose_pair(m, values, vectors, out, inverse)
