"""The forcing term: normalised basis functions over the phase, [GDMP] eqs. (4), (5), (19)."""
from __future__ import annotations

import math

import numpy as np

from gdmp_ros.errors import ParameterError
from gdmp_ros.kernels import kernel, noinline

#: Basis functions below e^-40 of the largest are left out: they are smaller than rounding errors.
_NEGLIGIBLE = 40.0


def basis(count: int, alpha_x: float) -> np.ndarray:
    """
    Centres and widths of the basis functions, shape ``(2, count)``.

    ``Ψ_i(x) = exp(-h_i (x - c_i)²)`` with centres equally spaced in time. Source: [GDMP] eq. (5).

    :raises ParameterError: if there are fewer than two
    """
    if count < 2:
        raise ParameterError(f'n_basis is {count}, expected at least 2')
    centres = np.exp(-alpha_x * np.arange(count) / (count - 1))
    widths = 1.0 / np.diff(centres) ** 2
    return np.array([centres, np.append(widths, widths[-1])])


@kernel
def _nearest(functions, s):
    last = functions.shape[1] - 1
    return int(min(max(s, 0.0), 1.0) * last + 0.5)


@kernel
def forcing(functions, weights, s, x, out):
    """
    ``F(x) = (Σ w_i Ψ_i / Σ Ψ_i) x``, [GDMP] eq. (19).

    The sum begins with the function nearest to ``s`` (= -ln x / α_x) and goes outward. That
    function's exponent is subtracted from all others, so nothing underflows for a small phase.

    :param weights: shape (functions, outputs)
    """
    noinline()
    count, outputs = weights.shape
    nearest = _nearest(functions, s)
    d = x - functions[0, nearest]
    reference = functions[1, nearest] * d * d
    total = 1.0
    for j in range(outputs):
        out[j] = weights[nearest, j]
    for step in (-1, 1):
        i = nearest + step
        while 0 <= i < count:
            d = x - functions[0, i]
            exponent = functions[1, i] * d * d - reference
            if exponent > _NEGLIGIBLE:
                break
            psi = math.exp(-exponent)
            total += psi
            for j in range(outputs):
                out[j] += psi * weights[i, j]
            i += step
    scale = x / total
    for j in range(outputs):
        out[j] *= scale


@kernel
def design_matrix(functions, alpha_x, s, out):
    """Fill row l of ``out`` with ``Ψ_i(x_l) x_l / Σ Ψ`` for the times ``s`` (in durations)."""
    count = functions.shape[1]
    for row in range(s.size):
        x = math.exp(-alpha_x * s[row])
        nearest = _nearest(functions, s[row])
        d = x - functions[0, nearest]
        reference = functions[1, nearest] * d * d
        total = 0.0
        for i in range(count):
            d = x - functions[0, i]
            exponent = functions[1, i] * d * d - reference
            out[row, i] = math.exp(-exponent) if exponent <= _NEGLIGIBLE else 0.0
            total += out[row, i]
        for i in range(count):
            out[row, i] *= x / total
