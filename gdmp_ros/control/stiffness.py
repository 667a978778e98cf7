"""6×6 stiffness matrices: comparison, interpolation by modes, bounds."""
from __future__ import annotations

import math

import numpy as np

from gdmp_ros.control.limits import STIFFNESS_BOUNDS
from gdmp_ros.kernels import kernel, local_numbers
from gdmp_ros.manifolds.linalg import cholesky, congruence, invert_lower, multiply_transposed
from gdmp_ros.manifolds.spectral import symmetric_eigen


@kernel
def relative_modes(old, new, values, modes):
    """
    Modes of ``new`` relative to ``old``: ``old = Σ wₖ wₖᵀ``, ``new = Σ βₖ wₖ wₖᵀ``.

    :param old: 36 numbers, positive definite
    :param new: 36 numbers
    :param values: result, the βₖ
    :param modes: result, the wₖ as rows, 36 numbers
    """
    lower, inverse, half = local_numbers(36), local_numbers(36), local_numbers(36)
    white, work = local_numbers(36), local_numbers(36)
    cholesky(6, old, lower)
    invert_lower(6, lower, inverse)
    congruence(6, inverse, new, white, half)
    symmetric_eigen(6, white, values, half, work)
    multiply_transposed(6, half, lower, modes)


@kernel
def compose_modes(values, modes, out):
    """``Σ βₖ wₖ wₖᵀ``."""
    for i in range(6):
        for j in range(i + 1):
            total = 0.0
            for k in range(6):
                total += values[k] * modes[6 * k + i] * modes[6 * k + j]
            out[6 * i + j], out[6 * j + i] = total, total


@kernel
def bound_stiffness(stiffness, low, high, violation):
    """
    Bring the eigenvalues into their bounds; the upper bound has priority.

    The eigenvalues are those relative to ``diag(t, t, t, r, r, r)``: without coupling, those of
    the translational and of the rotational block, each divided by its bound.

    :param stiffness: 36 numbers, changed
    :param low: lower bound, 36 numbers
    :param high: upper bound
    """
    values, modes = local_numbers(6), local_numbers(36)
    for bound, side in ((low, 1.0), (high, -1.0)):
        relative_modes(bound, stiffness, values, modes)
        exceeded = False
        for k in range(6):
            beyond = -side * math.log(max(values[k], 1e-12))
            if beyond > 1e-9:
                violation[STIFFNESS_BOUNDS] = max(violation[STIFFNESS_BOUNDS], beyond)
                values[k] = 1.0
                exceeded = True
        if exceeded:
            compose_modes(values, modes, stiffness)


def diagonal_bounds(least: tuple[float, float], most: tuple[float, float]) -> np.ndarray:
    """
    Bounds for `bound_stiffness`, shape ``(2, 36)``.

    :param least: smallest eigenvalue, translational and rotational [N/m, Nm/rad]
    :param most: largest eigenvalue
    """
    return np.array([np.diag(np.repeat(bound, 3)).reshape(-1) for bound in (least, most)])
