"""From demonstrations to weights: the dynamical system inverted along what was shown."""
from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
import math
from typing import NamedTuple

import numpy as np

from gdmp_ros.dmp.demonstration import Demonstration, one_or_several
from gdmp_ros.dmp.development import (
    Development,
    differentiate,
    distances,
    published_derivatives,
)
from gdmp_ros.dmp.evaluation import deviation, mean_distance
from gdmp_ros.dmp.forcing import basis, regress
from gdmp_ros.dmp.rollout import Rollout
from gdmp_ros.dmp.segments import (
    cut_locus_gaps,
    segment_ends,
    Segments,
    split_factors,
    targets,
)
from gdmp_ros.dmp.skill import carry_frame, check_connection, Gains, in_frame, LEAST_STEPS, Skill
from gdmp_ros.errors import CutLocusError, DataError, ParameterError
from gdmp_ros.manifolds import Manifold

#: Range of basis functions that ``n_basis='auto'`` searches.
LEAST_BASIS, MOST_BASIS = 5, 500


@dataclass(frozen=True)
class Settings:
    """How to learn, as `Skill.learn` documents it."""

    gains: Gains
    connection: str
    smoothing: float | None = None
    regularization: float = 0.0
    split: bool = True

    def __post_init__(self) -> None:
        check_connection(self.connection)
        if not (math.isfinite(self.regularization) and self.regularization >= 0.0):
            raise ParameterError(f'regularization is {self.regularization!r}, '
                                 'expected a number >= 0')


class _Inverted(NamedTuple):
    """A demonstration turned into regression targets."""

    s: np.ndarray
    forcing: np.ndarray
    velocity: np.ndarray


def learn(demonstrations: Demonstration | Sequence[Demonstration], n_basis: int | str,
          settings: Settings, tolerance: float) -> Skill:
    """Learn a skill; see `Skill.learn`."""
    shown = _prepared(demonstrations, settings.smoothing)
    blank = _blank(shown, settings)
    parts = [_invert(d, blank) for d in shown]
    s, forcing = (np.concatenate([p.s for p in parts]), np.vstack([p.forcing for p in parts]))
    blank = replace(blank, velocity=np.mean([p.velocity for p in parts], axis=0))

    def with_basis(count: int) -> Skill:
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
    Demonstrations as they are learned from: smooth, uniform, in one representative.

    :raises DataError: without demonstrations, or if their manifolds differ
    """
    shown = one_or_several(demonstrations)
    if not shown:
        raise DataError('learning needs at least one demonstration, got none')
    for number, demonstration in enumerate(shown):
        if demonstration.manifold != shown[0].manifold:
            raise DataError(f'demonstration {number} is on {demonstration.manifold!r}, '
                            f'the first on {shown[0].manifold!r}')
    if smoothing is not None:
        shown = [d.smoothed(smoothing) for d in shown]
    return [d.uniform().aligned(shown[0].points[0]) for d in shown]


def _blank(shown: list[Demonstration], settings: Settings) -> Skill:
    """All that does not depend on the basis functions."""
    manifold = shown[0].manifold
    start = _mean(manifold, [d.points[0] for d in shown])
    duration = float(np.mean([d.duration for d in shown]))
    return Skill(manifold=manifold, connection=settings.connection, gains=settings.gains,
                 start=start, goal=_mean(manifold, [d.points[-1] for d in shown]),
                 frame=manifold.frame(start), duration=duration,
                 velocity=np.zeros(manifold.tangent_size),
                 weights=np.zeros((2, manifold.tangent_size)),
                 steps=max(LEAST_STEPS, math.ceil(duration / 1e-3 - 1e-6)),
                 segments=_segments(shown, settings.split))


def _segments(shown: list[Demonstration], allowed: bool) -> Segments:
    if not allowed:
        return Segments()
    manifold = shown[0].manifold
    gaps, lengths = zip(*(cut_locus_gaps(manifold, d.flat_points, d.flat_points[-1])
                          for d in shown))
    split = tuple(any(column) for column in zip(
        *(split_factors(manifold, g, steps) for g, steps in zip(gaps, lengths))))
    if not any(split):
        return Segments()
    ends = segment_ends(lengths, split)
    at = [_on_the_way(d, ends) for d in shown]
    waypoints = [_mean(manifold, [points[k] for points in at]) for k in range(len(ends))]
    return Segments(ends, np.array(waypoints).reshape(len(ends), -1), split)


def _on_the_way(demonstration: Demonstration, ends: np.ndarray) -> np.ndarray:
    return demonstration.at(demonstration.times[0] + ends * demonstration.duration)


def _mean(manifold: Manifold, points: list[np.ndarray]) -> np.ndarray:
    """Fréchet mean; of points opposite each other, which have none, an error that says so."""
    if len(points) == 1:
        return points[0]
    try:
        return manifold.mean([manifold.align(p, points[0]) for p in points])
    except CutLocusError as error:
        raise CutLocusError(f'the demonstrations differ too much to have a mean: {error}',
                            error.distance) from None


def _invert(demonstration: Demonstration, blank: Skill) -> _Inverted:
    """Solve [GDMP] eq. (17) for the forcing term along a uniform demonstration."""
    manifold, gains, points = blank.manifold, blank.gains, demonstration.flat_points
    duration, segments = demonstration.duration, blank.segments
    dt = duration / (len(points) - 1)
    s = np.linspace(0.0, 1.0, len(points))
    carried, _ = carry_frame(manifold, blank.frame, demonstration.points[0])
    if len(segments) > 1:
        own = _on_the_way(demonstration, segments.ends)
        segments = replace(segments, waypoints=own.reshape(len(own), -1))
    drawn = targets(manifold, segments, points[-1], s)
    if blank.connection == 'parallel':
        development = Development(manifold, points, carried, targets=drawn)
        velocity, acceleration = differentiate(development.steps, dt)
        to_goal, start_velocity = development.to_goal, velocity[0]
    else:
        velocity, acceleration, to_goal = published_derivatives(manifold, points, drawn, dt)
        start_velocity = in_frame(manifold, carried, velocity[0])
    x = np.exp(-gains.alpha_x * s)
    forcing = ((duration ** 2 * acceleration + gains.alpha_z * duration * velocity)
               / (gains.alpha_z * gains.beta_z) - to_goal + to_goal[0] * x[:, None])
    return _Inverted(s, forcing, duration * start_velocity)


def _smallest(make: Callable[[int], Skill], shown: list[Demonstration], tolerance: float,
              samples: int) -> Skill:
    """
    The skill with the fewest basis functions that meets the tolerance, found by bisection.

    :raises ParameterError: if none does
    """
    if not (isinstance(tolerance, (int, float)) and 0.0 < tolerance < 1.0):
        raise ParameterError(f'tolerance is {tolerance!r}, expected a number between 0 and 1')
    most = max(LEAST_BASIS, min(MOST_BASIS, samples // 2))
    error = _error_measure(make(most), shown)
    tried: dict[int, float] = {}

    def meets(count: int) -> bool:
        tried[count] = error(make(count))
        return tried[count] <= tolerance

    low, high = LEAST_BASIS - 1, LEAST_BASIS
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


def _error_measure(finest: Skill, shown: list[Demonstration]) -> Callable[[Skill], float]:
    """What `_smallest` compares: with the one demonstration, or with the finest roll-out."""
    times = np.linspace(0.0, finest.duration, 1000)
    if len(shown) == 1:
        span = shown[0].span()
        return lambda skill: mean_distance(deviation(skill, shown[0], times)) / span
    manifold = finest.manifold
    path = Rollout(finest).sample(times).points.reshape(len(times), -1)
    span = max(d.span() for d in shown)
    return lambda skill: mean_distance(distances(
        manifold, path, Rollout(skill).sample(times).points.reshape(len(times), -1))) / span
