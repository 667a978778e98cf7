"""A demonstration: stamped points on a manifold."""
from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gdmp_ros.dmp.development import Development
from gdmp_ros.errors import DataError, ManifoldError
from gdmp_ros.manifolds import Manifold

#: Stamps whose spacing varies by less than this fraction are uniform and used as they are.
UNIFORM = 1e-4
#: Fewest samples a second derivative can be taken from.
LEAST_SAMPLES = 3


@dataclass(frozen=True, eq=False)
class Demonstration:
    """
    What was shown: one trajectory, validated.

    Quaternion factors are made sign-continuous. Irregular stamps are kept here and resampled when
    the skill is learned (`uniform`).

    :param times: increasing, shape ``(T,)`` [s]
    :param points: shape ``(T, *point_shape)``
    :raises DataError: naming the first sample that is refused, and why
    """

    times: np.ndarray
    points: np.ndarray
    manifold: Manifold

    def __post_init__(self) -> None:
        times = np.array(self.times, dtype=np.float64)
        points = np.array(self.points, dtype=np.float64)
        if times.ndim != 1 or len(times) < LEAST_SAMPLES:
            raise DataError(f'demonstration: {times.size} samples, '
                            f'expected at least {LEAST_SAMPLES}')
        if points.shape != (len(times), *self.manifold.point_shape):
            raise DataError(f'demonstration: points have shape {points.shape}, '
                            f'expected {(len(times), *self.manifold.point_shape)}')
        self._check_times(times)
        for i, point in enumerate(points):
            try:
                self.manifold.check_point(point)
            except ManifoldError as error:
                raise DataError(f'{error} (sample {i}, t = {times[i]:.6g} s)') from None
            if i > 0:
                points[i] = self.manifold.align(point, points[i - 1])
        times.flags.writeable = points.flags.writeable = False
        object.__setattr__(self, 'times', times)
        object.__setattr__(self, 'points', points)

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

    def at(self, times: np.ndarray) -> np.ndarray:
        """
        Points of a smooth curve through the samples, shape ``(len(times), *point_shape)``.

        :param times: within the first and last stamp [s]
        """
        development = Development(self.manifold, self.flat_points,
                                  self.manifold.frame(self.points[0]))
        wanted = np.clip(times, self.times[0], self.times[-1])
        flat = development.interpolate(self.times, wanted)
        return flat.reshape(len(wanted), *self.manifold.point_shape)

    def uniform(self) -> Demonstration:
        """Give the same curve with as many equally spaced stamps; itself if they are."""
        if self.is_uniform:
            return self
        times = np.linspace(self.times[0], self.times[-1], len(self.times))
        return Demonstration(times, self.at(times), self.manifold)

    def aligned(self, reference: np.ndarray) -> Demonstration:
        """Give the same motion, beginning in the representative nearest ``reference``."""
        if np.array_equal(self.manifold.align(self.points[0], reference), self.points[0]):
            return self
        points = self.points.copy()
        points[0] = self.manifold.align(points[0], reference)
        return Demonstration(self.times, points, self.manifold)

    def span(self) -> float:
        """Largest geodesic distance from the first point."""
        return max(self.manifold.distance(self.points[0], point) for point in self.points)
