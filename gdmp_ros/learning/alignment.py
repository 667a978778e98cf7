"""
Time alignment of several takes: the same moment of the motion gets the same progress.

Each take is warped onto the mean of all (dynamic time warping): the cost of a warp is the squared
distance on the manifold, each factor in units of its own span, and the squared difference in time.
The mean of the warps is the identity, so that the mean motion keeps the usual timing.
"""
from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d

from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.development import Development
from gdmp_ros.errors import DataError
from gdmp_ros.manifolds import Manifold

#: Grid of the warps.
SAMPLES = 151
#: Repetitions: mean, then warps onto it.
REPETITIONS = 4
#: Cost of a difference of the whole duration, in spans. Larger differences in time are unlikely.
TIME_COST = 0.1
#: Largest difference in time, in durations.
LARGEST_SHIFT = 0.25
#: Standard deviation of the smoothing of a warp, in durations.
SMOOTHING = 0.02
#: Factors whose span is smaller than this many goal tolerances do not move.
STILL = 2.0


class Aligned(NamedTuple):
    """
    Takes on a common progress.

    :ivar progress: shape ``(SAMPLES,)``, from 0 to 1
    :ivar warps: progress of each take's own time, shape ``(takes, SAMPLES)``
    :ivar points: flat, shape ``(takes, SAMPLES, point_size)``
    :ivar mean: of the takes, flat points, shape ``(SAMPLES, point_size)``
    """

    progress: np.ndarray
    warps: np.ndarray
    points: np.ndarray
    mean: np.ndarray


def align(takes: Sequence[Demonstration], *, moved: bool = True,
          expected: Sequence[Demonstration] | None = None) -> Aligned:
    """
    Find the warps of several takes.

    :param moved: compare each take with the mean moved to its own start and goal, as a skill would
        be; False compares the takes as they are
    :param expected: compare each take with this motion, moved to its own start and goal, and not
        with the mean
    :raises DataError: without takes, or if their manifolds differ
    """
    if not takes:
        raise DataError('alignment needs at least one take, got none')
    manifold = takes[0].manifold
    for number, take in enumerate(takes):
        if take.manifold != manifold:
            raise DataError(f'take {number} is on {take.manifold!r}, the first on {manifold!r}')
    takes = [take.aligned(takes[0].points[0]) for take in takes]
    progress = np.linspace(0.0, 1.0, SAMPLES)
    own = np.array([_at(take, progress) for take in takes])
    scales = _scales(manifold, own)
    warps, points = np.tile(progress, (len(takes), 1)), own
    mean = mean_path(manifold, points, points[0])
    for _ in range(0 if len(takes) == 1 else 1 if expected else REPETITIONS):
        models = [mean] * len(takes) if expected is None else [
            _at(item, progress) for item in expected]
        warps = np.array([_warp(_costs(
            manifold, _moved(manifold, model, path) if moved else model, path, scales))
                          for model, path in zip(models, own)])
        # The mean of the warps becomes the identity: the mean motion keeps the usual timing.
        usual = warps.mean(axis=0)
        warps = np.array([np.interp(progress, usual, warp) for warp in warps])
        points = np.array([_at(take, warp) for take, warp in zip(takes, warps)])
        mean = mean_path(manifold, points, mean)
    return Aligned(progress, warps, points, mean)


def aligned(takes: Sequence[Demonstration], expected: Sequence[Demonstration] | None = None
            ) -> list[Demonstration]:
    """
    The takes with their time warped, so that the same progress is the same moment of the motion.

    Durations and numbers of samples stay.

    :param expected: see `align`
    :raises DataError: see `align`
    """
    alignment = align(takes, expected=expected)
    result = []
    for take, warp in zip(takes, alignment.warps):
        progress = (take.times - take.times[0]) / take.duration
        own = np.interp(progress, alignment.progress, warp)
        result.append(Demonstration(take.times, take.at(take.times[0] + own * take.duration),
                                    take.manifold))
    return result


def mean_path(manifold: Manifold, points: np.ndarray, near: np.ndarray) -> np.ndarray:
    """
    Fréchet mean at each sample.

    :param points: flat, shape ``(takes, samples, point_size)``
    :param near: flat points near the mean, to begin with, shape ``(samples, point_size)``
    """
    mean, paths = manifold.unflat(near), manifold.unflat(points)
    for _ in range(2):
        mean = manifold.exp(mean, manifold.log_anyway(mean, paths)[0].mean(axis=0))
    return manifold.flat(mean)


def _at(take: Demonstration, progress: np.ndarray) -> np.ndarray:
    points = take.at(take.times[0] + progress * take.duration)
    return np.asarray(points.reshape(len(progress), -1))


def _scales(manifold: Manifold, paths: np.ndarray) -> np.ndarray:
    """Span of each factor; infinite if it does not move."""
    spans = np.mean([manifold.factor_distances(
        np.ascontiguousarray(np.broadcast_to(path[0], path.shape)), path).max(axis=0)
                     for path in paths], axis=0)
    still = np.array([STILL * factor.goal_tolerance for factor in manifold.factors])
    return np.where(spans > still, spans, np.inf)


def _moved(manifold: Manifold, mean: np.ndarray, path: np.ndarray) -> np.ndarray:
    """The mean, moved to the start and goal of a path."""
    shape = manifold.point_shape
    curve = Development(manifold, mean, manifold.frame(mean[0].reshape(shape)))
    first, last = (manifold.log_in_frame(curve.frames[i], path[i].reshape(shape))[0]
                   for i in (0, -1))
    progress = np.linspace(0.0, 1.0, len(mean))[:, None]
    return curve.moved((1.0 - progress) * first + progress * last)


def _costs(manifold: Manifold, mean: np.ndarray, path: np.ndarray, scales: np.ndarray
           ) -> np.ndarray:
    """Cost of pairing each sample of the mean with each one of the path; too far is infinite."""
    count = len(mean)
    shift = np.subtract.outer(np.arange(count), np.arange(count)) / (count - 1.0)
    first, second = np.nonzero(np.abs(shift) <= LARGEST_SHIFT)
    offset = manifold.factor_distances(mean[first], path[second]) / scales
    costs = np.full((count, count), np.inf)
    costs[first, second] = (offset ** 2).sum(axis=1) + (TIME_COST * shift[first, second]) ** 2
    return costs


def _warp(costs: np.ndarray) -> np.ndarray:
    """The cheapest monotone pairing, smoothed: progress of the path at that of the mean."""
    count = len(costs)
    total = np.full((count + 1, count + 1), np.inf)
    total[0, 0] = 0.0
    # Row by row: the step along a row is a running minimum of what it costs until there.
    for i in range(count):
        row = costs[i]
        enter = np.minimum(total[i, :-1] + row, total[i, 1:] + row)
        total[i + 1, 1:] = _along(enter, row)
    place, i, j = np.zeros(count), count - 1, count - 1
    seen = np.zeros(count)
    while i >= 0 and j >= 0:
        place[i] += j
        seen[i] += 1.0
        before = (total[i, j], total[i, j + 1], total[i + 1, j])
        step = int(np.argmin(before))
        i, j = i - (step != 2), j - (step != 1)
    warp = place / np.maximum(seen, 1.0) / (count - 1.0)
    return _smoothed(warp)


def _along(enter: np.ndarray, row: np.ndarray) -> np.ndarray:
    """Cheapest total when a row may be entered anywhere and then followed."""
    finite = np.where(np.isfinite(row), row, 0.0)
    passed = np.cumsum(finite)
    result = np.minimum.accumulate(enter - passed) + passed
    return np.where(np.isfinite(row), result, np.inf)


def _smoothed(warp: np.ndarray) -> np.ndarray:
    """Smooth a warp between its fixed ends; it stays monotone."""
    progress = np.linspace(0.0, 1.0, len(warp))
    # The reflected shift from the identity: 0 at both ends.
    shift = gaussian_filter1d(np.concatenate([-(warp - progress)[::-1], warp - progress,
                                              -(warp - progress)[::-1]]),
                              SMOOTHING * (len(warp) - 1))[len(warp):2 * len(warp)]
    smooth = np.maximum.accumulate(np.clip(progress + shift, 0.0, 1.0))
    smooth[0], smooth[-1] = 0.0, 1.0
    return np.asarray(smooth + 1e-9 * progress)
