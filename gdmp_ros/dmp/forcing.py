"""The forcing term: basis functions over the phase, and the regression of their weights."""
from __future__ import annotations

import math

import numpy as np
from scipy.linalg import cho_factor, cho_solve, LinAlgError, lstsq

from gdmp_ros.compilation import compiled, kept_apart
from gdmp_ros.errors import ParameterError

#: Basis functions below e^-40 of the largest are left out of the sums: less than rounding.
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


@compiled
def _nearest(functions, s):
    last = functions.shape[1] - 1
    return int(min(max(s, 0.0), 1.0) * last + 0.5)


@compiled
def forcing(functions, weights, s, x, out):
    """
    ``F(x) = (Σ w_i Ψ_i / Σ Ψ_i) x``, [GDMP] eq. (19).

    Walks outward from the function nearest to ``s`` (= -ln x / α_x), with its exponent subtracted
    from all: no underflow, however small the phase.

    :param weights: shape (functions, outputs)
    """
    kept_apart()
    count = functions.shape[1]
    nearest = _nearest(functions, s)
    d = x - functions[0, nearest]
    reference = functions[1, nearest] * d * d
    total = 1.0
    for j in range(out.size):
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
            for j in range(out.size):
                out[j] += psi * weights[i, j]
            i += step
    scale = x / total
    for j in range(out.size):
        out[j] *= scale


@compiled
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


def scaled_design(functions: np.ndarray, alpha_x: float,
                  s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """
    Design matrix with columns of unit length, and the lengths they had.

    (The phase spans two decades, and so would the pivots of the normal equations.)
    """
    matrix = np.empty((s.size, functions.shape[1]))
    design_matrix(functions, alpha_x, s, matrix)
    lengths = np.sqrt(np.einsum('ij,ij->j', matrix, matrix))
    lengths[lengths == 0.0] = 1.0
    matrix /= lengths
    return matrix, lengths


def regress(functions: np.ndarray, alpha_x: float, s: np.ndarray, target: np.ndarray,
            ridge: float = 0.0) -> np.ndarray:
    """
    Least-squares weights of all outputs at once, shape ``(functions, outputs)``.

    The normal equations are well conditioned where every function sees samples (about 400 for 60
    functions); where some do not, an orthogonal factorisation gives the shortest weights.

    :param s: sample times in durations, shape ``(samples,)``
    :param target: forcing to reproduce, shape ``(samples, outputs)``
    :param ridge: added to the diagonal of the normal equations, which is 1
    """
    matrix, lengths = scaled_design(functions, alpha_x, s)
    normal = matrix.T @ matrix
    normal[np.diag_indices_from(normal)] += ridge
    try:
        factor = cho_factor(normal, check_finite=False)
        pivots = np.diag(factor[0])
        if pivots.min() > 1e-5 * pivots.max():
            solved = cho_solve(factor, matrix.T @ target, check_finite=False)
            return np.ascontiguousarray(solved / lengths[:, None])
    except LinAlgError:
        pass
    solved = lstsq(matrix, target, check_finite=False)[0]
    return np.ascontiguousarray(solved / lengths[:, None])
