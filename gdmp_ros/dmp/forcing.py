"""
The forcing term: normalised basis functions over the phase, [GDMP] eqs. (4), (5), (19).

That of a rhythmic motion is periodic. It has coordinates in the frame of the centre G, so it
closes over a cycle; a frame that is carried along the motion does not, where the space is curved.
In every step it is carried along the geodesic from the centre to the present point. One cycle is
one unit of progress, φ = 2π s.
"""
from __future__ import annotations

import math

import numpy as np

from gdmp_ros.errors import ParameterError
from gdmp_ros.kernels import always_inline, kernel, noinline
from gdmp_ros.manifolds.factors import (
    frame_point,
    from_frame,
    log_in_frame,
    to_frame,
    transport_frame,
)
from gdmp_ros.manifolds.linalg import copy_numbers

#: Basis functions below e^-37 of the largest are left out: they are smaller than rounding errors.
_NEGLIGIBLE = 37.0


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


def periodic_basis(count: int) -> np.ndarray:
    """
    Centres [cycles] and widths of the periodic basis functions, shape ``(2, count)``.

    ``Γ_i(φ) = exp(h (cos(φ - c_i) - 1))``; neighbours overlap at e^-1, as those of a motion that
    ends do.

    :param count: at least 4
    """
    width = 1.0 / (1.0 - math.cos(2.0 * math.pi / count))
    return np.array([np.arange(count) / count, np.full(count, width)])


@kernel
def periodic_forcing(functions, weights, s, out):
    """
    ``F(φ) = Σ w_i Γ_i / Σ Γ_i`` at φ = 2π s.

    :param functions: of `periodic_basis`
    :param weights: shape (functions, outputs)
    """
    noinline()
    count, outputs = weights.shape
    passed = s - math.floor(s)
    width = functions[1, 0]
    nearest = int(passed * count + 0.5) % count
    reference = width * math.cos(2.0 * math.pi * (passed - functions[0, nearest]))
    total = 1.0
    for j in range(outputs):
        out[j] = weights[nearest, j]
    for step in (-1, 1):
        # A function opposite to the nearest one is counted once.
        for distance in range(1, (count - 1) // 2 + 1 if step < 0 else count // 2 + 1):
            i = (nearest + step * distance) % count
            exponent = reference - width * math.cos(2.0 * math.pi * (passed - functions[0, i]))
            if exponent > _NEGLIGIBLE:
                break
            psi = math.exp(-exponent)
            total += psi
            for j in range(outputs):
                out[j] += psi * weights[i, j]
    for j in range(outputs):
        out[j] /= total


@kernel
def periodic_design(functions, s, out):
    """Fill row l of ``out`` with ``Γ_i(φ_l) / Σ Γ`` for the progress ``s``."""
    for row in range(s.size):
        total = 0.0
        for i in range(functions.shape[1]):
            out[row, i] = math.exp(functions[1, i] * (math.cos(
                2.0 * math.pi * (s[row] - functions[0, i])) - 1.0))
            total += out[row, i]
        for i in range(functions.shape[1]):
            out[row, i] /= total


@always_inline
def update_cycle(motion, s):
    """
    Write the forcing term at ``s`` in the frame at the middle of the interval.

    The amplitude follows what was asked for by a first-order lag, as the centre does, so that the
    acceleration has no step.
    """
    noinline()
    scalars, tangents, spare = motion.scalars, motion.tangents, motion.frames.spare
    # Its value in the middle of the interval, from that at the node before.
    left = math.exp(-0.5 * scalars.alpha_g / scalars.steps)
    missing = left * (scalars.amplitude - scalars.amplitude_goal)
    periodic_forcing(motion.basis, motion.weights, s, tangents.offset)
    for i in range(motion.sizes.tangent):
        tangents.offset[i] *= scalars.amplitude_goal + missing
    scalars.amplitude = scalars.amplitude_goal + left * missing
    copy_numbers(motion.sizes.frame, motion.frames.goal, spare)
    frame_point(motion.factors, motion.frames.mid, motion.points.mid, motion.work)
    log_in_frame(motion.factors, spare, motion.points.mid, tangents.spare, motion.work)
    transport_frame(motion.factors, spare, tangents.spare, motion.work)
    from_frame(motion.factors, spare, tangents.offset, tangents.spare, motion.work)
    to_frame(motion.factors, motion.frames.mid, tangents.spare, tangents.forcing, motion.work)
