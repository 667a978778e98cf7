"""
Detail that the demonstrations have and a skill does not.

Too few basis functions cannot follow a motion, and the average of takes that are out of phase is
flatter than each of them. Both make the path shorter. The length is measured by the motion energy,
the integral of the squared speed, because the share of white noise in it is known.
"""
from __future__ import annotations

from collections.abc import Sequence
import math
from typing import NamedTuple
import warnings

import numpy as np

from gdmp_ros.errors import GdmpWarning
from gdmp_ros.learning.cleaning import noise_level
from gdmp_ros.manifolds import Manifold

#: Number of bins in which samples are averaged, and the least number for each basis function.
#: Details of two bins or more are seen; most of the noise is averaged out.
BINS, BINS_PER_FUNCTION = 400, 4
#: Functions that make a path this much shorter, as a share, do not follow it.
SHORTER = 0.1
#: A loss counts if it is this many times the standard error that noise leaves.
SIGNIFICANT = 4.0
#: Ratio of two estimates of noise beyond what their few samples explain.
MUCH_LESS = 0.5
#: An average that half of the motion energy is not in is no longer what the takes have in common.
AVERAGED = 1.0 - math.sqrt(0.5)


class Reproduced(NamedTuple):
    """
    A demonstration and what its each leaves, both at the same samples.

    :ivar curve: the demonstration, unrolled into Rⁿ, shape ``(samples, n)``
    :ivar residual: from the each to the demonstration, shape ``(samples, n)``
    :ivar noise: of a sample in each factor, as known from a few samples at the ends
    """

    curve: np.ndarray
    residual: np.ndarray
    noise: tuple[float, ...] = ()


class LostDetail(NamedTuple):
    """
    What a skill has lost in one factor.

    :ivar shorter: share by which its path is shorter than those of the demonstrations; 0 if noise
        explains it
    :ivar common: part of the loss that the demonstrations have in common: the functions do not
        follow it; the rest was lost by averaging
    :ivar timing: part of the variance between the demonstrations that is along the motion
    :ivar distance: RMS distance of the reproductions, without the noise [unit of the factor]
    """

    shorter: float
    common: float
    timing: float
    distance: float


def lost_detail(reproductions: Sequence[Reproduced], count: int = 0) -> LostDetail:
    """
    Compare demonstrations with their reproductions, in the columns of one factor.

    :param count: number of basis functions
    """
    bins = min(max(BINS, BINS_PER_FUNCTION * count), *(len(each.curve) for each in reproductions))
    noise = [_noise(each) for each in reproductions]
    curves = [_binned(each.curve, bins) for each in reproductions]
    residuals = [_binned(each.residual, bins) for each in reproductions]
    # Variance of the step between two bins, from the noise of their samples.
    steps = [2.0 * sd ** 2 * bins / len(each.curve) for sd, each in zip(noise, reproductions)]
    total = sum(_energy(curve, step) for curve, step in zip(curves, steps))
    kept = sum(_energy(curve - left, 0.0) for curve, left in zip(curves, residuals))
    mean = np.mean(residuals, axis=0)
    common = len(reproductions) * _energy(mean, float(np.mean(steps)) / len(reproductions))
    varying = sum(_energy(left - mean, step * (1.0 - 1.0 / len(reproductions)))
                  for left, step in zip(residuals, steps))
    square = np.mean([(each.residual ** 2).sum(axis=1).mean()
                      - sd ** 2 * each.residual.shape[1]
                      for each, sd in zip(reproductions, noise)])
    shorter = 0.0
    if total - kept > SIGNIFICANT * _noise_error(steps, curves, reproductions):
        shorter = 1.0 - math.sqrt(kept / total)
    return LostDetail(shorter,
                      common / (common + varying) if common > 0.0 else 0.0,
                      _along(curves, [left - mean for left in residuals]),
                      math.sqrt(max(float(square), 0.0)))


def warn_of_lost_detail(manifold: Manifold, count: int, reproductions: Sequence[Reproduced],
                        contexts: bool) -> None:
    """
    Warn of factors whose path is much shorter than that of the demonstrations.

    :param count: number of basis functions
    :param contexts: whether the demonstrations differ on purpose
    """
    for k, (name, factor, columns) in enumerate(zip(
            manifold.names, manifold.factors, manifold.tangent_slices)):
        lost = lost_detail([Reproduced(each.curve[:, columns], each.residual[:, columns],
                                       each.noise[k:k + 1]) for each in reproductions], count)
        averaged = lost.common < 0.5
        if (lost.shorter < (AVERAGED if averaged else SHORTER)
                or lost.distance < factor.goal_tolerance or (averaged and contexts)):
            continue
        what = (f'the path of {name} is {lost.shorter:.0%} shorter than demonstrated '
                f'({lost.distance:.2g} away from it, RMS)')
        if averaged:
            text = (f'the demonstrations differ, and their average loses detail: {what}. '
                    f'{lost.timing:.0%} of the variance between them is along the path (timing, '
                    'takes out of phase). Leave out those that differ, or learn from one')
        else:
            text = (f'{count} basis functions cannot follow the demonstrations: {what}. Take more '
                    'functions (n_basis), or divide the motion')
        warnings.warn(text, GdmpWarning, stacklevel=6)


def _noise(item: Reproduced) -> float:
    """
    Noise of a sample.

    Detail of a few samples looks like noise in the residual. At the ends it does not, but there
    are few samples: they only count if they tell much less.
    """
    residual = noise_level(item.residual)
    return item.noise[0] if item.noise and item.noise[0] < MUCH_LESS * residual else residual


def _binned(samples: np.ndarray, bins: int) -> np.ndarray:
    """Means of neighbouring samples, shape ``(bins, n)``."""
    first = np.arange(bins) * len(samples) // bins
    counts = np.diff(np.append(first, len(samples)))
    return np.asarray(np.add.reduceat(samples, first, axis=0) / counts[:, None])


def _energy(binned: np.ndarray, noise: float) -> float:
    """Sum of the squared steps, without that of noise of this variance of a coordinate's step."""
    steps = np.diff(binned, axis=0)
    return max(float((steps ** 2).sum()) - noise * steps.size, 0.0)


def _noise_error(steps: Sequence[float], curves: Sequence[np.ndarray],
                 reproductions: Sequence[Reproduced]) -> float:
    """
    Standard error of the motion energy.

    Mean squares of n differences of white noise have the relative variance 3 / n, those of third
    differences, which the noise is known from, 4.6 / n.
    """
    return math.sqrt(sum((step * curve.size) ** 2
                         * (3.0 / curve.size + 4.6 / each.curve.size)
                         for step, curve, each in zip(steps, curves, reproductions)))


def _along(curves: Sequence[np.ndarray], varying: Sequence[np.ndarray]) -> float:
    """Part of the variance that is along the curves."""
    along = total = 0.0
    for curve, offset in zip(curves, varying):
        tangent = np.gradient(curve, axis=0)
        speed = np.linalg.norm(tangent, axis=1)
        tangent /= np.where(speed > 0.0, speed, 1.0)[:, None]
        along += float(((offset * tangent).sum(axis=1) ** 2).sum())
        total += float((offset ** 2).sum())
    return along / total if total > 0.0 else 0.0
