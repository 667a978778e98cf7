"""From demonstrations to a primitive: the dynamical system inverted along the demonstrations."""
from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
import math
from typing import Any, NamedTuple

import numpy as np

from gdmp_ros.dmp.demonstration import as_list, Demonstration
from gdmp_ros.dmp.development import Development, differentiate, published_derivatives
from gdmp_ros.dmp.evaluation import deviation, mean_distance
from gdmp_ros.dmp.forcing import basis
from gdmp_ros.dmp.primitive import carry_frame, check_connection, Gains, MIN_STEPS, Primitive
from gdmp_ros.dmp.rollout import Rollout
from gdmp_ros.dmp.segments import (
    cut_locus_distances,
    segment_ends,
    Segments,
    split_factors,
    targets,
)
from gdmp_ros.errors import CutLocusError, DataError, ParameterError
from gdmp_ros.learning.regression import regress
from gdmp_ros.manifolds import Manifold

#: Range of basis functions that ``n_basis='auto'`` searches.
MIN_BASIS, MAX_BASIS = 5, 500


@dataclass(frozen=True)
class FitSettings:
    """How to learn; see `gdmp_ros.dmp.Skill.learn`."""

    gains: Gains
    connection: str
    smoothing: float | None = None
    regularization: float = 0.0
    split: bool = True
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_connection(self.connection)
        if not (math.isfinite(self.regularization) and self.regularization >= 0.0):
            raise ParameterError(f'regularization is {self.regularization!r}, '
                                 'expected a number >= 0')


class _Inverted(NamedTuple):
    """Regression targets from one demonstration."""

    s: np.ndarray
    forcing: np.ndarray
    velocity: np.ndarray


def learn(demonstrations: Demonstration | Sequence[Demonstration], n_basis: int | str,
          settings: FitSettings, tolerance: float) -> Primitive:
    """Learn a primitive; see `gdmp_ros.dmp.Skill.learn`."""
    shown = _prepared(demonstrations, settings.smoothing)
    blank = _blank(shown, settings)
    parts = [_invert(d, blank) for d in shown]
    s, forcing = (np.concatenate([p.s for p in parts]), np.vstack([p.forcing for p in parts]))
    blank = replace(blank, velocity=np.mean([p.velocity for p in parts], axis=0))

    def with_basis(count: int) -> Primitive:
        functions = basis(count, settings.gains.alpha_x)
        return replace(blank, weights=regress(functions, settings.gains.alpha_x, s, forcing,
                                              settings.regularization))

    if n_basis == 'auto':
        return _smallest(with_basis, shown, tolerance, len(s))
    if not isinstance(n_basis, (int, np.integer)) or isinstance(n_basis, bool):
        raise ParameterError(f"n_basis is {n_basis!r}, expected an integer >= 2 or 'auto'")
    return with_basis(int(n_basis))


def _prepared(demonstrations: Demonstration | Sequence[Demonstration],
              smoothing: float | None) -> list[Demonstration]:
    """
    Demonstrations ready for regression: smoothed, uniform in time, with consistent signs.

    :raises DataError: without demonstrations, or if their manifolds differ
    """
    shown = as_list(demonstrations)
    if not shown:
        raise DataError('learning needs at least one demonstration, got none')
    for number, demonstration in enumerate(shown):
        if demonstration.manifold != shown[0].manifold:
            raise DataError(f'demonstration {number} is on {demonstration.manifold!r}, '
                            f'the first on {shown[0].manifold!r}')
    if smoothing is not None:
        shown = [d.smoothed(smoothing) for d in shown]
    return [d.uniform().aligned(shown[0].points[0]) for d in shown]


def _blank(shown: list[Demonstration], settings: FitSettings) -> Primitive:
    """The primitive without weights: everything that does not depend on the basis functions."""
    manifold = shown[0].manifold
    start = _mean(manifold, [d.points[0] for d in shown])
    duration = float(np.mean([d.duration for d in shown]))
    return Primitive(
        manifold=manifold, connection=settings.connection, gains=settings.gains, start=start,
        goal=_mean(manifold, [d.points[-1] for d in shown]), frame=manifold.frame(start),
        duration=duration, velocity=np.zeros(manifold.tangent_size),
        weights=np.zeros((2, manifold.tangent_size)),
        steps=max(MIN_STEPS, math.ceil(duration / 1e-3 - 1e-6)),
        segments=_segments(shown, settings.split), provenance=settings.provenance)


def _segments(shown: list[Demonstration], allowed: bool) -> Segments:
    if not allowed:
        return Segments()
    manifold = shown[0].manifold
    distances, spacing = zip(*(cut_locus_distances(manifold, d.flat_points, d.flat_points[-1])
                               for d in shown))
    split = tuple(any(column) for column in zip(
        *(split_factors(manifold, one, steps) for one, steps in zip(distances, spacing))))
    if not any(split):
        return Segments()
    ends = segment_ends(spacing, split)
    at = [_points_at(d, ends) for d in shown]
    waypoints = [_mean(manifold, [points[k] for points in at]) for k in range(len(ends))]
    return Segments(ends, np.array(waypoints).reshape(len(ends), -1), split)


def _points_at(demonstration: Demonstration, progress: np.ndarray) -> np.ndarray:
    return demonstration.at(demonstration.times[0] + progress * demonstration.duration)


def _mean(manifold: Manifold, points: list[np.ndarray]) -> np.ndarray:
    """Fréchet mean; points opposite each other have none."""
    if len(points) == 1:
        return points[0]
    try:
        return manifold.mean([manifold.align(p, points[0]) for p in points])
    except CutLocusError as error:
        raise CutLocusError(f'the demonstrations differ too much to have a mean: {error}',
                            error.distance) from None


def _invert(demonstration: Demonstration, blank: Primitive) -> _Inverted:
    """Solve [GDMP] eq. (17) for the forcing term along a uniform demonstration."""
    manifold, gains, points = blank.manifold, blank.gains, demonstration.flat_points
    duration, segments = demonstration.duration, blank.segments
    dt = duration / (len(points) - 1)
    s = np.linspace(0.0, 1.0, len(points))
    frame, _ = carry_frame(manifold, blank.frame, demonstration.points[0])
    if len(segments) > 1:
        own = _points_at(demonstration, segments.ends)
        segments = replace(segments, waypoints=own.reshape(len(own), -1))
    attracting = targets(manifold, segments, points[-1], s)
    if blank.connection == 'parallel':
        development = Development(manifold, points, frame, targets=attracting)
        velocity, acceleration = differentiate(development.steps, dt)
        to_target, start_velocity = development.to_target, velocity[0]
    else:
        velocity, acceleration, to_target = published_derivatives(manifold, points, attracting, dt)
        start_velocity = manifold.to_frame(frame, velocity[0])
    x = np.exp(-gains.alpha_x * s)
    forcing = ((duration ** 2 * acceleration + gains.alpha_z * duration * velocity)
               / (gains.alpha_z * gains.beta_z) - to_target + to_target[0] * x[:, None])
    return _Inverted(s, forcing, duration * start_velocity)


def _smallest(make: Callable[[int], Primitive], shown: list[Demonstration], tolerance: float,
              samples: int) -> Primitive:
    """
    The primitive with the fewest basis functions that meets the tolerance, found by bisection.

    :raises ParameterError: if none does
    """
    if not (isinstance(tolerance, (int, float)) and 0.0 < tolerance < 1.0):
        raise ParameterError(f'tolerance is {tolerance!r}, expected a number between 0 and 1')
    most = max(MIN_BASIS, min(MAX_BASIS, samples // 2))
    error = _error_measure(make(most), shown)
    tried: dict[int, float] = {}

    def meets(count: int) -> bool:
        tried[count] = error(make(count))
        return tried[count] <= tolerance

    low, high = MIN_BASIS - 1, MIN_BASIS
    while not meets(high):
        if high == most:
            raise ParameterError(
                f"n_basis='auto': {most} basis functions leave a mean error of "
                f'{tried[most]:.2g} of the span, the tolerance is {tolerance:.2g}: smooth the '
                'demonstration or accept a larger tolerance')
        low, high = high, min(2 * high, most)
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if meets(middle) else (middle, high)
    return make(high)


def _error_measure(finest: Primitive, shown: list[Demonstration]) -> Callable[[Primitive], float]:
    """Error for `_smallest`: from the one demonstration, or from the finest roll-out."""
    times = np.linspace(0.0, finest.duration, 1000)
    if len(shown) == 1:
        span = shown[0].span()
        return lambda primitive: mean_distance(deviation(primitive, shown[0], times)) / span
    manifold = finest.manifold
    path = Rollout(finest).sample(times).points.reshape(len(times), -1)
    span = max(d.span() for d in shown)
    return lambda primitive: mean_distance(manifold.factor_distances(
        path, Rollout(primitive).sample(times).points.reshape(len(times), -1))) / span
