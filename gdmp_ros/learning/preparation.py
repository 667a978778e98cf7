"""What every fit begins with: checked demonstrations, their ends, a primitive without weights."""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
import math
from typing import Any, NamedTuple
import warnings

import numpy as np

from gdmp_ros.choices import ENDS, FITS
from gdmp_ros.dmp.demonstration import as_list, Demonstration
from gdmp_ros.dmp.options import check_range, SHORTEST_DURATION
from gdmp_ros.dmp.primitive import check_connection, Gains, MIN_STEPS
from gdmp_ros.dmp.segments import cut_locus_distances, segment_ends, Segments, split_factors
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import CutLocusError, DataError, GdmpWarning, ParameterError
from gdmp_ros.learning.cleaning import cleaned, FEW, local_fit, noise_level, noise_of_few
from gdmp_ros.learning.variation_fit import Contexts, GivenContexts
from gdmp_ros.manifolds import Manifold
from gdmp_ros.util.numeric import numbers

#: Demonstrations with more samples are averaged to at least this many.
SAMPLES = 1000
#: Largest part of a demonstration that an end is estimated from, and fewest samples.
SHARE, LEAST = 0.05, 5
#: Samples from which their noise can be told.
ENOUGH = 10
#: Largest error that the curvature of the space may add, as a part of the span.
LARGEST_CURVATURE_ERROR = 0.01


class Samples(NamedTuple):
    """
    A demonstration with few samples.

    :ivar progress: of the samples in the whole demonstration, shape ``(samples,)``
    """

    demonstration: Demonstration
    progress: np.ndarray


def averaged(demonstration: Demonstration) -> Samples:
    """Average neighbouring samples, so that many samples cost no more time than few."""
    count, begins = len(demonstration.times), demonstration.times[0]
    size = count // SAMPLES
    if size < 2:
        return Samples(demonstration, (demonstration.times - begins) / demonstration.duration)
    steps = np.diff(demonstration.times)
    # The samples before and after a gap are not averaged.
    runs = np.split(np.arange(count), np.flatnonzero(steps > size * np.median(steps)) + 1)
    first = np.concatenate([run[:max(len(run) // size, 1) * size:size] for run in runs])
    means = demonstration.means(first)
    return Samples(means, (means.times - begins) / demonstration.duration)


class Endpoint(NamedTuple):
    """
    An end of a demonstration.

    :ivar point: shape ``point_shape``
    :ivar velocity: by progress, coordinates in the canonical frame of the first (last) sample,
        shape ``(tangent_size,)``
    :ivar velocity_error: standard error of each coordinate of ``velocity``
    :ivar noise: standard deviation of a sample, for each factor
    """

    point: np.ndarray
    velocity: np.ndarray
    velocity_error: np.ndarray
    noise: tuple[float, ...]


def start_of(demonstration: Demonstration) -> Endpoint:
    """Estimate the start of a demonstration."""
    return _endpoint(demonstration, slice(None), 1.0)


def goal_of(demonstration: Demonstration) -> Endpoint:
    """Estimate the goal of a demonstration."""
    return _endpoint(demonstration, slice(None, None, -1), -1.0)


def _endpoint(demonstration: Demonstration, order: slice, direction: float) -> Endpoint:
    """:param order: of the samples, beginning at the end that is wanted"""
    manifold = demonstration.manifold
    times, points = demonstration.times[order], demonstration.points[order]
    progress = np.abs(times - times[0]) / demonstration.duration
    used = slice(max(LEAST, int((progress <= SHARE).sum())))
    frame = manifold.frame(points[0])
    local = np.array([manifold.log_in_frame(frame, point)[0] for point in points[used]])
    value, velocity, error = (np.zeros(manifold.tangent_size) for _ in range(3))
    few = len(local) < ENOUGH
    curve = demonstration.unrolled[order][:FEW] if few else local
    noise = []
    for columns in manifold.tangent_slices:
        sd = (noise_of_few(curve[:, columns], progress[:FEW]) if few
              else noise_level(local[:, columns], progress[used]))
        noise.append(sd)
        value[columns], slope, error[columns] = local_fit(local[:, columns], progress[used], sd)
        if few:
            # Few samples are far apart: a parabola through them has no exact slope either.
            cubic = np.polyfit(progress[:LEAST], local[:LEAST, columns], 3)[-2]
            error[columns] += float(np.linalg.norm(cubic - slope)) / math.sqrt(len(slope))
        velocity[columns] = direction * slope
    point = manifold.exp(points[0], manifold.from_frame(frame, value))
    return Endpoint(point, velocity, error, tuple(noise))


@dataclass(frozen=True)
class FitSettings:
    """How to learn; see `gdmp_ros.dmp.Skill.learn`."""

    gains: Gains
    connection: str
    smoothing: float | None = None
    regularization: float = 0.0
    split: bool = True
    provenance: Mapping[str, Any] = field(default_factory=dict)
    fit: str = 'output'
    end: str | None = None
    align: bool = True
    demonstration_weights: Sequence[float] | None = None
    contexts: GivenContexts | None = None

    def __post_init__(self) -> None:
        check_connection(self.connection)
        check_range('regularization', self.regularization, 0.0, 1e9)
        if self.fit not in FITS:
            raise ParameterError(f'fit is {self.fit!r}, expected one of {", ".join(FITS)}')
        if self.end not in (None, *ENDS):
            raise ParameterError(f'end is {self.end!r}, expected one of {", ".join(ENDS)}')
        if self.fit == 'forcing' and self.end == 'rest':
            raise ParameterError("end='rest' needs fit='output': fit='forcing' has no data after "
                                 'the end of the demonstration')
        if self.fit == 'forcing' and self.demonstration_weights is not None:
            raise ParameterError("demonstration_weights need fit='output': fit='forcing' counts "
                                 'samples, as the paper does')
        if self.fit == 'forcing' and self.contexts is not None:
            raise ParameterError("contexts need fit='output': fit='forcing' has no distribution")
        if self.fit == 'output' and self.regularization > 0.0:
            warnings.warn("regularization is for fit='forcing' only, and ignored: fit='output' "
                          'chooses the smoothness by cross-validation', GdmpWarning, stacklevel=4)

    @property
    def rests(self) -> bool:
        """Whether the motion comes to rest at its goal."""
        return self.fit == 'output' and self.end != 'moving'

    def weights(self, count: int) -> np.ndarray:
        """
        Weight of each of ``count`` demonstrations, 1 on average.

        :raises ParameterError: unless there is a number above 0 for each
        """
        if self.demonstration_weights is None:
            return np.ones(count)
        given = numbers('demonstration_weights', self.demonstration_weights)
        if given.shape != (count,) or not (np.isfinite(given) & (given > 0.0)).all():
            raise ParameterError(f'demonstration_weights are {given.tolist()}, expected {count} '
                                 'numbers above 0, one for each demonstration')
        return np.asarray(given / given.mean())

    def contexts_of(self, count: int) -> Contexts | None:
        """
        Contexts of ``count`` demonstrations; None without any.

        :raises ParameterError: unless there are as many finite numbers for each
        :raises DataError: if there are too few demonstrations, or a number does not vary
        """
        return None if self.contexts is None else Contexts.of(self.contexts, count)


def prepared(demonstrations: Demonstration | Sequence[Demonstration],
             smoothing: float | None, tell: bool = True) -> list[Demonstration]:
    """
    Demonstrations ready for regression: cleaned, smoothed, with consistent signs.

    The samples are those that were recorded, at their stamps.

    :param tell: warn of what was cleaned
    :raises DataError: without demonstrations, if their manifolds differ, or if one is too short
    """
    demos = as_list(demonstrations)
    if not demos:
        raise DataError('learning needs at least one demonstration, got none')
    for number, demonstration in enumerate(demos):
        if demonstration.manifold != demos[0].manifold:
            raise DataError(f'demonstration {number} is on {demonstration.manifold!r}, '
                            f'the first on {demos[0].manifold!r}')
        if demonstration.duration < SHORTEST_DURATION:
            raise DataError(f'demonstration {number} lasts {demonstration.duration:.4g} s, '
                            f'expected at least {SHORTEST_DURATION:g} s: no arm follows a '
                            'shorter motion')
    demos = [cleaned(d, f'demonstration {number}' if tell else '')
             for number, d in enumerate(demos)]
    if smoothing is not None:
        demos = [d.smoothed(smoothing) for d in demos]
    return [d.aligned(demos[0].points[0]) for d in demos]


def blank_primitive(demos: list[Demonstration], starts: list[np.ndarray], goals: list[np.ndarray],
                    segments: Segments, settings: FitSettings) -> Skill:
    """
    The primitive without velocity and weights: everything that does not depend on them.

    :param starts: start of each demonstration, point
    :param goals: its goal
    :param segments: see `common_segments`
    """
    manifold, weights = demos[0].manifold, settings.weights(len(demos))
    start = _mean(manifold, starts, weights)
    duration = float(np.average([d.duration for d in demos], weights=weights))
    return Skill(
        manifold=manifold, connection=settings.connection, gains=settings.gains, start=start,
        goal=_mean(manifold, goals, weights), frame=manifold.frame(start), duration=duration,
        velocity=np.zeros(manifold.tangent_size), weights=np.zeros((2, manifold.tangent_size)),
        steps=max(MIN_STEPS, math.ceil(duration / 1e-3 - 1e-6)),
        segments=segments, provenance=settings.provenance)


def common_segments(demos: list[Demonstration], settings: FitSettings) -> Segments:
    """Where a motion is split at the cut locus; all demonstrations have the same segments."""
    if not settings.split:
        return Segments()
    manifold = demos[0].manifold
    distances, spacing = zip(*(cut_locus_distances(manifold, d.flat_points, d.flat_points[-1])
                               for d in demos))
    split = tuple(any(column) for column in zip(
        *(split_factors(manifold, each, steps) for each, steps in zip(distances, spacing))))
    if not any(split):
        return Segments()
    ends = segment_ends(spacing, split)
    at = [_points_at(d, ends) for d in demos]
    weights = settings.weights(len(demos))
    waypoints = [_mean(manifold, [points[k] for points in at], weights) for k in range(len(ends))]
    return Segments(ends, np.array(waypoints).reshape(len(ends), -1), split)


def own_segments(blank: Skill, demonstration: Demonstration) -> Segments:
    """The segments of a primitive with the waypoints of one demonstration."""
    if len(blank.segments) == 1:
        return blank.segments
    own = _points_at(demonstration, blank.segments.ends)
    return replace(blank.segments, waypoints=own.reshape(len(own), -1))


def _points_at(demonstration: Demonstration, progress: np.ndarray) -> np.ndarray:
    return demonstration.at(demonstration.times[0] + progress * demonstration.duration)


def _mean(manifold: Manifold, points: list[np.ndarray], weights: np.ndarray) -> np.ndarray:
    """Fréchet mean; points opposite each other have none."""
    if len(points) == 1:
        return points[0]
    try:
        return manifold.mean([manifold.align(p, points[0]) for p in points], weights)
    except CutLocusError as error:
        raise CutLocusError(f'the demonstrations differ too much to have a mean: {error}',
                            error.distance) from None


def check_curvature(error: float, expected: float, span: float) -> None:
    """
    Refuse a fit that the curvature of the space spoils.

    :param error: RMS distance of the roll-out from the demonstrations
    :param expected: the same if the space were flat
    :param span: largest distance from the start along the demonstrations
    :raises DataError: if the error is much larger than expected
    """
    limit = max(3.0 * expected, LARGEST_CURVATURE_ERROR * span, 1e-9)
    if not math.isfinite(error) or error > limit:
        raise DataError(f'the motion cannot be learned: the roll-out is {error:.2g} away from the '
                        f'demonstrations, {error / span:.0%} of the span, although the basis '
                        f'functions can describe them within {expected:.2g}. The space is curved '
                        'too much along it, as for matrices of very different eigenvalues that '
                        'turn')


def check_tolerance(tolerance: float) -> None:
    """:raises ParameterError: unless the tolerance of ``n_basis='auto'`` is between 0 and 1"""
    if not (isinstance(tolerance, (int, float)) and 0.0 < tolerance < 1.0):
        raise ParameterError(f'tolerance is {tolerance!r}, expected a number between 0 and 1')


def warn_tolerance(count: int, error: float, tolerance: float) -> None:
    """Warn that ``n_basis='auto'`` did not meet the tolerance: more functions describe noise."""
    warnings.warn(f"n_basis='auto': {count} basis functions are enough; the {error:.2g} of the "
                  f'span that they leave (tolerance {tolerance:.2g}) are noise, or differ between '
                  'the demonstrations', GdmpWarning, stacklevel=5)
