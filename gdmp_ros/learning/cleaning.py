"""
What recorders do to a demonstration: stamps in bursts, missing blocks, wrong samples at its ends.

The fit uses the samples that there are, at their stamps. What it cannot see is mended here before,
and told as a warning.
"""
from __future__ import annotations

import math
import warnings

import numpy as np

from gdmp_ros.dmp.demonstration import Demonstration, UNIFORM
from gdmp_ros.errors import GdmpWarning

#: Stamps are regular if less than this share of the steps is shorter than `SHORT` mean steps.
IRREGULAR, SHORT = 0.02, 0.5
#: Even stamps are taken for the true ones if the samples are this much smoother with them.
SMOOTHER = 0.67
#: Steps this much shorter than usual, if they are this often, are those of a burst.
NEVER, OFTEN = 0.05, 0.2
#: A step that is this many times as long as nearly all others is a gap, and as a part of the
#: duration.
GAP, GAP_SHARE = 3.0, 0.02
#: Fewest samples between two gaps whose stamps are made even.
FEWEST = 8
#: Samples from which the first one is predicted, and how many may be wrong at an end.
NEXT, WRONG = 8, 3
#: A sample at an end is wrong if it is this many standard errors away from its prediction, and
#: this many of the largest of the next steps.
SIGNIFICANT, LARGE = 10.0, 3.0
#: Less than this part of the motion is no wrong sample, however smooth the others are.
SMALL = 1e-3
#: Noise of coordinates that do not move, of the size of the points.
ROUNDING = 1e-12
#: Samples from which the noise is estimated where there are few, and orders of the differences.
FEW, ORDERS = 40, (3, 4, 5, 6, 7)
#: Ratio of one window to the next smaller one.
_GROWTH = 1.4
#: Estimates from two windows are consistent within this many standard errors.
_CONSISTENT = 2.0
#: Smallest window.
SMALLEST = 3
#: Median of the absolute value of a normal deviate.
_MEDIAN = 0.6745


def cleaned(demonstration: Demonstration, name: str = '') -> Demonstration:
    """
    The demonstration with true stamps, and without wrong samples at its ends.

    - Samples that were taken evenly and stamped in bursts, as messages without a header are when
      they are received, get even stamps: if the motion is smoother with them.
    - A first or last sample that the next ones do not lead to is replaced by where they lead.

    :param name: of the demonstration in warnings; without one, nothing is told
    """
    result = _without_wrong_ends(_evenly_stamped(demonstration, name), name)
    if name:
        _tell_gaps(result, name)
    return result


def noise_level(samples: np.ndarray, times: np.ndarray | None = None, order: int = 3) -> float:
    """
    Standard deviation of the noise of a coordinate, from third differences.

    :param samples: shape ``(samples, n)``
    :param times: of the samples; by default they are equally spaced
    :param order: of the differences
    """
    return math.sqrt(float((_differences(samples, times, order) ** 2).mean()))


def noise_of_few(samples: np.ndarray, times: np.ndarray) -> float:
    """
    The same of few samples: between them the motion goes on, and looks like noise.

    Differences of high order leave less of the motion, and as much of the noise.
    """
    orders = [order for order in ORDERS if len(samples) > 2 * order]
    return min((noise_level(samples, times, order) for order in orders), default=0.0)


def _differences(samples: np.ndarray, times: np.ndarray | None, order: int) -> np.ndarray:
    """Divided differences with the variance of a sample: zero for a polynomial below the order."""
    if times is None or np.ptp(np.diff(times)) <= UNIFORM * abs(times[-1] - times[0]) / len(times):
        weights = np.array([math.comb(order, k) * (-1.0) ** k for k in range(order + 1)])
        return np.asarray(np.diff(samples, n=order, axis=0)) / math.sqrt(float(weights @ weights))
    windows = np.lib.stride_tricks.sliding_window_view(times, order + 1)
    away = windows[:, :, None] - windows[:, None, :]
    away[:, np.arange(order + 1), np.arange(order + 1)] = 1.0
    # Relative to the longest, because products of short times have no digits left.
    logarithm = -np.log(np.abs(away)).sum(axis=2)
    weights = np.sign(away).prod(axis=2) * np.exp(logarithm - logarithm.max(axis=1, keepdims=True))
    weights /= np.linalg.norm(weights, axis=1, keepdims=True)
    rows = np.lib.stride_tricks.sliding_window_view(samples, order + 1, axis=0)
    return np.asarray(np.einsum('ik,ijk->ij', weights, rows))


def _noise(manifold_columns: list[slice], curve: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Noise of each factor."""
    return np.array([noise_level(curve[:, columns], times) for columns in manifold_columns])


def _evenly_stamped(demonstration: Demonstration, name: str) -> Demonstration:
    times, steps = demonstration.times, np.diff(demonstration.times)
    # Gaps are no steps.
    period = float(np.quantile(steps, 0.9))
    gaps = np.flatnonzero(steps > GAP * period)
    usual = float(steps[steps <= GAP * period].mean())
    if len(times) < FEWEST or (steps < SHORT * usual).mean() < IRREGULAR:
        return demonstration
    even = times.copy()
    for run in np.split(np.arange(len(times)), gaps + 1):
        if len(run) >= FEWEST:
            index = run - run.mean()
            even[run] = times[run].mean() + (index @ times[run]) / (index @ index) * index
    if not (np.diff(even) > 0.0).all():
        return demonstration
    curve, columns = demonstration.unrolled, demonstration.manifold.tangent_slices
    own, mended = (_noise(columns, curve, stamps) for stamps in (times, even))
    moves = own > 1e-12 * (np.ptp(curve) + 1e-300)
    ratio = float(np.exp(np.log(mended[moves] / own[moves]).min())) if moves.any() else 1.0
    # No sensor takes samples that near to each other: then even stamps need not be better.
    needed = SMOOTHER if (steps < NEVER * usual).mean() < OFTEN else 1.0 / SMOOTHER
    if ratio > needed or (mended[moves] > own[moves] / SMOOTHER).any():
        return demonstration
    if name:
        warnings.warn(f'{name}: the samples were taken evenly and stamped in bursts: with even '
                      f'stamps they are {1.0 / ratio:.1f} times as smooth, and learned with them '
                      f'(stamps moved by up to {1e3 * np.abs(even - times).max():.1f} ms)',
                      GdmpWarning, stacklevel=5)
    return Demonstration(even, demonstration.points, demonstration.manifold)


def _without_wrong_ends(demonstration: Demonstration, name: str) -> Demonstration:
    count = len(demonstration.times)
    if count < 2 * NEXT:
        return demonstration
    times, points, wrong = demonstration.times, demonstration.flat_points.copy(), []
    for order in (slice(None), slice(None, None, -1)):
        ends = points[order][:WRONG + NEXT + 1]
        steps = demonstration.manifold.factor_distances(ends[1:], ends[:-1])
        if (steps[:WRONG].max(axis=0) <= steps[WRONG:].max(axis=0)).all():
            continue  # no jump
        curve = demonstration.unrolled
        number = _wrong(curve[order], times[order], demonstration)
        if not number:
            continue
        index = np.arange(count)[order]
        from_, bad = index[number:max(2 * NEXT, len(times) // 20)], index[:number]
        expected = np.array([_expected(demonstration, from_, k) for k in bad])
        points[bad] = demonstration.development.moved(expected - curve[from_[0]],
                                                      np.full(number, from_[0]))
        wrong += bad.tolist()
    if not wrong:
        return demonstration
    if name:
        warnings.warn(f'{name}: sample {", ".join(map(str, wrong))} of {count} is far from where '
                      'the others lead, and was replaced by that', GdmpWarning, stacklevel=5)
    return Demonstration(times, points.reshape(demonstration.points.shape),
                         demonstration.manifold)


def _expected(demonstration: Demonstration, samples: np.ndarray, at: int) -> np.ndarray:
    """Where samples lead at the time of another one, as coordinates of the unrolled curve."""
    times, curve = demonstration.times, demonstration.unrolled
    away = np.abs(times[samples] - times[at])
    result = np.empty(curve.shape[1])
    for columns in demonstration.manifold.tangent_slices:
        own = curve[samples, columns]
        result[columns] = local_fit(own, away, noise_level(own, away))[0]
    return result


def local_fit(samples: np.ndarray, progress: np.ndarray, noise: float
               ) -> tuple[np.ndarray, np.ndarray, float]:
    """
    Quadratic fit to the largest window that is consistent with all smaller ones (Lepski's method).

    :param progress: of the samples, increasing; the fit is that at progress 0

    :returns: value, slope by progress, and standard error of a coordinate of the slope
    """
    fits: list[tuple[np.ndarray, float]] = []
    best: tuple[np.ndarray, np.ndarray, float] | None = None
    for size in _windows(len(samples)):
        (value, slope, _), covariance = _parabola(progress[:size], samples[:size])
        error = noise * math.sqrt(covariance[0, 0] * samples.shape[1])
        if best is not None and any(
                np.linalg.norm(value - other) > _CONSISTENT * their_error
                for other, their_error in fits):
            return best
        fits.append((value, error))
        best = (value, slope / progress[size - 1],
                noise * math.sqrt(covariance[1, 1]) / progress[size - 1])
    if best is None:
        raise ValueError(f'{len(samples)} samples, expected at least {SMALLEST}')
    return best


def _windows(most: int) -> list[int]:
    sizes, size = [], SMALLEST
    while size < most:
        sizes.append(size)
        size = math.ceil(_GROWTH * size)
    return [*sizes, most]


def _parabola(away: np.ndarray, samples: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """
    Parabola through samples, by their distance as a part of the last one's.

    :returns: its three coefficients, and their covariance in variances of a sample
    """
    powers = np.vander(away / away[-1], 3, increasing=True)
    covariance = np.linalg.inv(powers.T @ powers)
    return covariance @ (powers.T @ samples), covariance


def _wrong(curve: np.ndarray, times: np.ndarray, demonstration: Demonstration) -> int:
    """Number of wrong samples at the beginning."""
    most = min(len(times), 5 * FEW)
    result, manifold = 0, demonstration.manifold
    for columns, part in zip(manifold.tangent_slices, manifold.point_slices):
        samples = curve[:most, columns]
        spread = np.abs(_differences(samples[WRONG:], times[WRONG:most], 3))
        # Where nothing moves, there is rounding.
        noise = max(float(np.median(spread)) / _MEDIAN,
                    ROUNDING * max(1.0, float(np.abs(demonstration.flat_points[:, part]).max())))
        least = SMALL * float(np.linalg.norm(np.ptp(curve[WRONG:, columns], axis=0)))
        for first in range(WRONG, result, -1):
            after = slice(first, first + NEXT)
            if _is_wrong(samples[first - 1], samples[after], times[first - 1], times[after],
                         noise, least):
                result = first
                break
    return result


def _is_wrong(sample: np.ndarray, following: np.ndarray, at: float, times: np.ndarray,
              noise: float, least: float) -> bool:
    """Whether a sample is far from the parabola through the next ones."""
    (expected, _, _), covariance = _parabola(np.abs(times - at), following)
    away = float(np.linalg.norm(sample - expected))
    error = noise * math.sqrt((1.0 + covariance[0, 0]) * len(sample))
    step = float(np.linalg.norm(np.diff(following, axis=0), axis=1).max())
    return away > max(SIGNIFICANT * error, LARGE * step, least)


def _tell_gaps(demonstration: Demonstration, name: str) -> None:
    steps = np.diff(demonstration.times)
    period = float(np.quantile(steps, 0.9))
    long = np.flatnonzero((steps > GAP * period) & (steps > GAP_SHARE * demonstration.duration))
    if not len(long):
        return
    begun = demonstration.times - demonstration.times[0]
    where = ', '.join(f'{begun[k]:.2f} to {begun[k + 1]:.2f} s' for k in long[:3])
    more = f' and {len(long) - 3} more' if len(long) > 3 else ''
    warnings.warn(f'{name}: there are no samples from {where}{more}: the smoothest motion fills '
                  'them', GdmpWarning, stacklevel=4)
