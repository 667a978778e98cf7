"""Exponential and logarithm of symmetric matrices, for kernels."""
from __future__ import annotations

import math

from gdmp_ros.kernels import kernel, noinline
from gdmp_ros.manifolds.linalg import copy_into, EPS, multiply, scratch
from gdmp_ros.manifolds.spectral import compose_eigen, compose_pair, symmetric_eigen


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


@kernel
def symmetric_expm(m, s, out, inverse, work):
    """
    ``out = exp(s)`` and ``inverse = exp(-s)`` for symmetric ``s``.

    A small ``s`` takes a short Taylor series: exp(±s) = cosh(s) ± s · sinhc(s), both even in s.

    :param work: scratch memory of at least ``4 m²`` numbers
    """
    noinline()
    norm2 = 0.0
    for i in range(m * m):
        norm2 += s[i] * s[i]
    if norm2 > 0.01:
        _expm_by_eigenvalues(m, s, out, inverse, work)
        return
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
def _expm_by_eigenvalues(m, s, out, inverse, work):
    noinline()
    vectors = scratch(work, 0, m)
    values, rest = work[m * m:m * m + m], work[m * m + m:]
    copy_into(s, out)
    symmetric_eigen(m, out, values, vectors, rest)
    for i in range(m):
        values[i] = math.exp(values[i])
    compose_pair(m, values, vectors, out, inverse)
