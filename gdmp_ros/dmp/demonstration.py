"""A demonstration: stamped points on a manifold."""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any
import warnings

import numpy as np

from gdmp_ros.dmp.development import Development
from gdmp_ros.dmp.frames import checked_frames
from gdmp_ros.errors import DataError, GdmpWarning, InvalidPointError
from gdmp_ros.manifolds import Manifold, UnitQuaternion
from gdmp_ros.util.numeric import numbers

#: Stamps whose spacing varies by less than this fraction are uniform and used as they are.
UNIFORM = 1e-4
#: Range of the cut-off of smoothing [Hz].
MIN_CUTOFF, MAX_CUTOFF = 1e-6, 1e6
#: Fewest samples from which a second derivative can be computed.
MIN_SAMPLES = 3
#: Quaternions whose norm differs from 1 by at most this are normalised.
ROUNDED = 1e-3
#: Stamps that are nearer than this part of the usual spacing are nearly equal.
NEAR = 0.2
#: Demonstrations with fewer samples are interpolated to this many by `uniform`.
MIN_RESAMPLED = 300


def as_list(demonstrations: Demonstration | Sequence[Demonstration]) -> list[Demonstration]:
    """One demonstration or several, as a list."""
    single = isinstance(demonstrations, Demonstration)
    return [demonstrations] if single else list(demonstrations)  # type: ignore[arg-type,list-item]


@dataclass(frozen=True, eq=False)
class Demonstration:
    """
    One demonstrated trajectory, validated.

    Quaternion factors are made sign-continuous, and normalised with a `GdmpWarning` if their norm
    is 1 within `ROUNDED` only, as recorded numbers with few digits have it. Irregular stamps are
    kept, and resampled when a skill is learned (`uniform`).

    :param times: increasing, shape ``(T,)`` [s]
    :param points: shape ``(T, *point_shape)``
    :param frames: task frames by name: pose (x, y, z, qw, qx, qy, qz) [m], or a pair of rotation
        (d, d) and origin (d,); with a leading axis of T for a frame that moved while this was
        shown. Kept as poses, shape (7,) or (T, 7). What is made of this demonstration (`uniform`,
        `smoothed`, …) has none
    :raises DataError: with the first invalid sample and the reason
    """

    times: np.ndarray
    points: np.ndarray
    manifold: Manifold
    frames: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        times = np.array(numbers('times', self.times, DataError))
        points = np.array(numbers('points', self.points, DataError))
        if times.ndim != 1 or len(times) < MIN_SAMPLES:
            raise DataError(f'demonstration: {times.size} samples, '
                            f'expected at least {MIN_SAMPLES}')
        if points.shape != (len(times), *self.manifold.point_shape):
            raise DataError(f'demonstration: points have shape {points.shape}, '
                            f'expected {(len(times), *self.manifold.point_shape)}')
        self._check_times(times)
        _normalise_quaternions(self.manifold, points)
        try:
            self.manifold.check_points(points)
        except InvalidPointError as error:
            raise DataError(f'{error} (sample {error.index}, '
                            f't = {times[error.index]:.6g} s)') from None
        points = self.manifold.continuous(points)
        times.flags.writeable = points.flags.writeable = False
        object.__setattr__(self, 'times', times)
        object.__setattr__(self, 'points', points)
        object.__setattr__(self, 'frames', checked_frames(self.frames, self.manifold, len(times)))

    @staticmethod
    def _check_times(times: np.ndarray) -> None:
        if not np.isfinite(times).all():
            at = int(np.argmin(np.isfinite(times)))
            raise DataError(f'demonstration: time is {times[at]} at sample {at}')
        steps = np.diff(times)
        if not (steps > 0.0).all():
            at = int(np.argmin(steps > 0.0)) + 1
            raise DataError(f'demonstration: stamps must increase: sample {at} has '
                            f't = {times[at]:.9g} s after {times[at - 1]:.9g} s')

    @property
    def duration(self) -> float:
        """Time from the first to the last sample [s]."""
        return float(self.times[-1] - self.times[0])

    @property
    def is_uniform(self) -> bool:
        """Whether the stamps are equally spaced."""
        steps = np.diff(self.times)
        return bool(np.ptp(steps) <= UNIFORM * steps.mean())

    @cached_property
    def flat_points(self) -> np.ndarray:
        """The samples as flat points, shape ``(T, point_size)``."""
        return self.points.reshape(len(self.times), -1)

    @cached_property
    def unrolled(self) -> np.ndarray:
        """The development: the samples as a curve in Rⁿ, shape ``(T, n)``."""
        return self.development.unrolled

    def at(self, times: np.ndarray) -> np.ndarray:
        """
        Points of a smooth curve through the samples, shape ``(len(times), *point_shape)``.

        Of samples with nearly equal stamps the curve goes through the mean: a curve through both
        would follow their noise far beyond them.

        :param times: within the first and last stamp [s]
        """
        clipped = np.clip(times, self.times[0], self.times[-1])
        distinct = self._distinct
        flat = distinct.development.interpolate(distinct.times, clipped)
        return flat.reshape(len(clipped), *self.manifold.point_shape)

    @cached_property
    def _distinct(self) -> Demonstration:
        """The same with the means of samples whose stamps are nearly equal."""
        steps = np.diff(self.times)
        near = NEAR * float(np.quantile(steps, 0.75))
        if steps.min() >= near:
            return self
        first, begins = [0], self.times[0]
        for i, time in enumerate(self.times):
            if time - begins >= near:
                first.append(i)
                begins = time
        if len(first) < MIN_SAMPLES:
            return self
        means = self.means(np.array(first))
        times = means.times.copy()
        # The curve begins and ends where the samples do.
        times[0], times[-1] = self.times[0], self.times[-1]
        return Demonstration(times, means.points, self.manifold)

    def means(self, first: np.ndarray) -> Demonstration:
        """
        Means of groups of neighbouring samples, and of their stamps.

        :param first: index of the first sample of each group, increasing from 0
        """
        groups = np.searchsorted(first, np.arange(len(self.times)), side='right') - 1
        counts = np.bincount(groups)
        middles = self.points[first + counts // 2]
        tangents, _ = self.manifold.log_anyway(middles[groups], self.points)
        sums = np.add.reduceat(tangents, first, axis=0)
        return Demonstration(np.add.reduceat(self.times, first) / counts, self.manifold.exp(
            middles, sums / counts.reshape(-1, *[1] * (sums.ndim - 1))), self.manifold)

    def uniform(self) -> Demonstration:
        """
        Return the same curve with equally spaced stamps; itself if they are, and enough of them.

        The spline of `at` fills gaps in the stamps.
        """
        if self.is_uniform and len(self.times) >= MIN_RESAMPLED:
            return self
        times = np.linspace(self.times[0], self.times[-1], max(len(self.times), MIN_RESAMPLED))
        return Demonstration(times, self.at(times), self.manifold)

    def smoothed(self, cutoff: float) -> Demonstration:
        """
        Return the motion with frequencies above ``cutoff`` [Hz] removed, at the same stamps.

        A cubic smoothing spline on the manifold (`gdmp_ros.dmp.development.Development.smooth`):
        50 % of the amplitude remains at the cut-off, 94 % at half of it, 6 % at twice, without
        delay. Start and end are smoothed too.

        :raises DataError: with fewer than 5 samples
        """
        if not (isinstance(cutoff, (int, float, np.number))
                and MIN_CUTOFF <= cutoff <= MAX_CUTOFF):
            raise DataError(f'cutoff is {cutoff!r} Hz, expected a number from {MIN_CUTOFF:g} to '
                            f'{MAX_CUTOFF:g}')
        if len(self.times) < 5:
            raise DataError(f'smoothing needs at least 5 samples, got {len(self.times)}')
        flat = self.development.smooth(self.times, cutoff)
        return Demonstration(self.times, flat.reshape(self.points.shape), self.manifold)

    def aligned(self, reference: np.ndarray) -> Demonstration:
        """Return the same motion, beginning in the representative nearest ``reference``."""
        if np.array_equal(self.manifold.align(self.points[0], reference), self.points[0]):
            return self
        points = self.points.copy()
        points[0] = self.manifold.align(points[0], reference)
        return Demonstration(self.times, points, self.manifold)

    def span(self) -> float:
        """Largest geodesic distance from the first point."""
        first = np.broadcast_to(self.flat_points[0], self.flat_points.shape)
        distances = self.manifold.factor_distances(first, self.flat_points)
        return float(np.linalg.norm(distances, axis=1).max())

    @cached_property
    def development(self) -> Development:
        """The samples unrolled into Rⁿ."""
        return Development(self.manifold, self.flat_points, self.manifold.frame(self.points[0]))


def _normalise_quaternions(manifold: Manifold, points: np.ndarray) -> None:
    """Normalise what was rounded; what is further from 1 is left for the check of each point."""
    rows = points.reshape(len(points), -1)
    for factor, row in zip(manifold.factors, manifold.factor_table):
        if not isinstance(factor, UnitQuaternion):
            continue
        numbers = rows[:, int(row['point']):int(row['point']) + 4]
        norms = np.linalg.norm(numbers, axis=1)
        off = float(np.abs(norms - 1.0).max())
        if factor.tolerance < off <= ROUNDED:
            numbers /= norms[:, None]
            warnings.warn(f'the norms of the quaternions differ from 1 by up to {off:.1e}: they '
                          'were normalised', GdmpWarning, stacklevel=4)
