"""
Small dense linear algebra for kernels.

For the sizes of manipulation skills (2 to 6) plain loops are 5 to 10 times faster than LAPACK. An
(m, m) matrix is a flat float64 array of m² numbers, row by row: a reshape inside a kernel costs as
much as a 3×3 product. Nothing here allocates: the caller provides scratch memory (`scratch`).
"""
from __future__ import annotations

import math

from gdmp_ros.kernels import always_inline, inlined, kernel, noinline

EPS = 2.0 ** -52
SQRT2 = math.sqrt(2.0)


@inlined
def row_of(a, i, m):
    """Row ``i`` as a view: LLVM can then vectorise a loop along it."""
    return a[i * m:(i + 1) * m]


@inlined
def scratch(work, index, m):
    """Matrix number ``index`` of the scratch memory ``work``."""
    size = m * m
    return work[index * size:(index + 1) * size]


@inlined
def _multiply3(a, b, out):
    b0, b1, b2, b3, b4, b5, b6, b7, b8 = b[0], b[1], b[2], b[3], b[4], b[5], b[6], b[7], b[8]
    for i in range(0, 9, 3):
        x, y, z = a[i], a[i + 1], a[i + 2]
        out[i] = x * b0 + y * b3 + z * b6
        out[i + 1] = x * b1 + y * b4 + z * b7
        out[i + 2] = x * b2 + y * b5 + z * b8


@always_inline
def _multiply_rows(m, a, b, out):
    for i in range(m):
        left, result = row_of(a, i, m), row_of(out, i, m)
        for j in range(m):
            result[j] = left[0] * b[j]
        for k in range(1, m):
            share, right = left[k], row_of(b, k, m)
            for j in range(m):
                result[j] += share * right[j]


@kernel
def _multiply_any(m, a, b, out):
    noinline()
    # The size of a stiffness: with a constant LLVM unrolls the loops.
    if m == 6:
        _multiply_rows(6, a, b, out)
    else:
        _multiply_rows(m, a, b, out)


@inlined
def multiply(m, a, b, out):
    """``out = a b``; ``out`` must be neither ``a`` nor ``b``."""
    if m == 3:
        _multiply3(a, b, out)
    else:
        _multiply_any(m, a, b, out)


@kernel
def multiply_transposed(m, a, b, out):
    """``out = a bᵀ``; ``out`` must be neither ``a`` nor ``b``."""
    noinline()
    for i in range(m):
        left, result = row_of(a, i, m), row_of(out, i, m)
        for j in range(m):
            right, total = row_of(b, j, m), 0.0
            for k in range(m):
                total += left[k] * right[k]
            result[j] = total


@kernel
def transposed_multiply(m, a, b, out):
    """``out = aᵀ b``; ``out`` must be neither ``a`` nor ``b``."""
    noinline()
    for i in range(m):
        result = row_of(out, i, m)
        for j in range(m):
            result[j] = a[i] * b[j]
        for k in range(1, m):
            share, right = a[k * m + i], row_of(b, k, m)
            for j in range(m):
                result[j] += share * right[j]


@inlined
def _half_product(m, a, b, out):
    """``out = a bᵀ`` where the product is symmetric; the result is exactly symmetric."""
    if m == 3:
        b0, b1, b2, b3, b4, b5, b6, b7, b8 = b[0], b[1], b[2], b[3], b[4], b[5], b[6], b[7], b[8]
        a3, a4, a5, a6, a7, a8 = a[3], a[4], a[5], a[6], a[7], a[8]
        out[0] = a[0] * b0 + a[1] * b1 + a[2] * b2
        out[1] = out[3] = a3 * b0 + a4 * b1 + a5 * b2
        out[2] = out[6] = a6 * b0 + a7 * b1 + a8 * b2
        out[4] = a3 * b3 + a4 * b4 + a5 * b5
        out[5] = out[7] = a6 * b3 + a7 * b4 + a8 * b5
        out[8] = a6 * b6 + a7 * b7 + a8 * b8
        return
    for i in range(m):
        left, result = row_of(a, i, m), row_of(out, i, m)
        for j in range(i + 1):
            right, total = row_of(b, j, m), 0.0
            for k in range(m):
                total += left[k] * right[k]
            result[j] = total
            out[j * m + i] = total


@kernel
def congruence(m, a, s, out, half):
    """``out = a s aᵀ`` for symmetric ``s``, exactly symmetric; ``half`` is scratch memory."""
    multiply(m, a, s, half)
    _half_product(m, half, a, out)


@kernel
def gram(m, a, out):
    """``out = a aᵀ``, exactly symmetric."""
    _half_product(m, a, a, out)


@kernel
def is_finite(v):
    """Whether all numbers of a vector are finite; numpy takes ten times as long for a few."""
    total = 0.0
    for i in range(v.size):
        total += 0.0 * v[i]
    return total == 0.0


@kernel
def is_zero(v):
    """Whether all numbers of a vector are 0."""
    total = 0.0
    for i in range(v.size):
        total += abs(v[i])
    return total == 0.0


@always_inline
def norm(count, v):
    """Euclidean norm."""
    total = 0.0
    for i in range(count):
        total += v[i] * v[i]
    return math.sqrt(total)


@always_inline
def limit_norm(count, v, limit):
    """Shorten ``v`` to ``limit``, and return by how much it was longer."""
    length = norm(count, v)
    if length <= limit:
        return 0.0
    for i in range(count):
        v[i] *= limit / length
    return length - limit


@kernel
def copy_into(source, out):
    """``out[:] = source`` as a loop, which LLVM inlines."""
    for i in range(out.size):
        out[i] = source[i]


@kernel
def multiply_vector(matrix, vector, result):
    """Write the product of a matrix and a vector."""
    for i in range(matrix.shape[0]):
        result[i] = 0.0
        for j in range(matrix.shape[1]):
            result[i] += matrix[i, j] * vector[j]


@kernel
def copy_numbers(count, source, out):
    """``out[:count] = source[:count]``, of arrays or pointers."""
    for i in range(count):
        out[i] = source[i]


@kernel
def set_identity(m, out):
    """``out = I``."""
    for i in range(m * m):
        out[i] = 0.0
    for i in range(m):
        out[i * m + i] = 1.0


@kernel
def cholesky(m, a, lower):
    """Write the lower Cholesky factor; return False if ``a`` is not positive definite."""
    noinline()
    for j in range(m):
        for i in range(j):
            lower[i * m + j] = 0.0
        pivot = a[j * m + j]
        for k in range(j):
            pivot -= lower[j * m + k] * lower[j * m + k]
        if not pivot > 0.0:
            return False
        root = math.sqrt(pivot)
        lower[j * m + j] = root
        for i in range(j + 1, m):
            total = a[i * m + j]
            for k in range(j):
                total -= lower[i * m + k] * lower[j * m + k]
            lower[i * m + j] = total / root
    return True


@kernel
def invert_lower(m, lower, out):
    """Inverse of a lower triangular matrix."""
    noinline()
    for j in range(m):
        for i in range(j):
            out[i * m + j] = 0.0
        out[j * m + j] = 1.0 / lower[j * m + j]
        for i in range(j + 1, m):
            total = 0.0
            for k in range(j, i):
                total -= lower[i * m + k] * out[k * m + j]
            out[i * m + j] = total / lower[i * m + i]


@always_inline
def _from_mandel(m, coordinates, scale, out):
    k = 0
    for i in range(m):
        out[i * m + i] = scale * coordinates[k]
        k += 1
        for j in range(i + 1, m):
            out[i * m + j] = out[j * m + i] = coordinates[k] * (scale / SQRT2)
            k += 1


@kernel
def from_mandel(m, coordinates, scale, out):
    """``scale`` times the symmetric matrix of Mandel coordinates (upper triangle, row by row)."""
    noinline()
    if m == 3:
        _from_mandel(3, coordinates, scale, out)
    elif m == 6:
        _from_mandel(6, coordinates, scale, out)
    else:
        _from_mandel(m, coordinates, scale, out)


@always_inline
def _to_mandel(m, s, out):
    k = 0
    for i in range(m):
        out[k] = s[i * m + i]
        k += 1
        for j in range(i + 1, m):
            out[k] = (s[i * m + j] + s[j * m + i]) * (0.5 * SQRT2)
            k += 1


@kernel
def to_mandel(m, s, out):
    """Mandel coordinates of a symmetric matrix (off-diagonals × √2)."""
    noinline()
    if m == 3:
        _to_mandel(3, s, out)
    elif m == 6:
        _to_mandel(6, s, out)
    else:
        _to_mandel(m, s, out)


@kernel
def sinc(angle):
    """``sin(angle) / angle``, 1 at zero."""
    if abs(angle) < 1e-4:
        return 1.0 - angle * angle / 6.0
    return math.sin(angle) / angle


@kernel
def orthonormalize(m, matrix, work):
    """One Newton-Schulz step towards the nearest orthogonal matrix, in place."""
    noinline()
    correction, row = scratch(work, 0, m), work[m * m:m * m + m]
    for i in range(m):
        for j in range(m):
            total = 0.0
            for k in range(m):
                total += matrix[k * m + i] * matrix[k * m + j]
            correction[i * m + j] = (1.5 if i == j else 0.0) - 0.5 * total
    for i in range(m):
        for j in range(m):
            total = 0.0
            for k in range(m):
                total += matrix[i * m + k] * correction[k * m + j]
            row[j] = total
        for j in range(m):
            matrix[i * m + j] = row[j]
