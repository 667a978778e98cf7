"""From demonstrations to a primitive."""
from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from gdmp_ros.dmp.demonstration import as_list, Demonstration
from gdmp_ros.dmp.evaluation import deviation, mean_distance, relative
from gdmp_ros.dmp.rollout import Rollout
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import ParameterError
from gdmp_ros.learning.alignment import aligned, SAMPLES
from gdmp_ros.learning.forcing_fit import fit_forcing
from gdmp_ros.learning.frames_fit import frame_names, FrameSettings, learn_in_frames
from gdmp_ros.learning.output_fit import OutputFit
from gdmp_ros.learning.preparation import check_tolerance, FitSettings, prepared, warn_tolerance
from gdmp_ros.learning.rhythmic_fit import learn_cycle
from gdmp_ros.learning.variation_fit import Contexts, variation_of
from gdmp_ros.util.parallel import one_thread

__all__ = ['FitSettings', 'FrameSettings', 'learn', 'learn_cycle']

#: Range of basis functions that ``n_basis='auto'`` searches.
MIN_BASIS, MAX_BASIS = 5, 500
#: Alignments of takes with the motions of their contexts.
PASSES = 2


@one_thread
def learn(demonstrations: Demonstration | Sequence[Demonstration], n_basis: int | str,
          settings: FitSettings, tolerance: float, frames: FrameSettings | None = None
          ) -> Skill:
    """Learn a primitive; see `gdmp_ros.dmp.Skill.learn`."""
    if not isinstance(n_basis, (int, np.integer, str)) or isinstance(n_basis, bool) or (
            isinstance(n_basis, str) and n_basis != 'auto'):
        raise ParameterError(f"n_basis is {n_basis!r}, expected an integer >= 2 or 'auto'")
    given = as_list(demonstrations)
    frames = frames or FrameSettings()
    names = frame_names(given, frames) if given else []
    if names:
        return learn_in_frames(given, names, frames, settings, lambda one: learn(
            one, n_basis, settings, tolerance))
    demos = prepared(given, settings.smoothing)
    settings.contexts_of(len(demos))
    if settings.fit == 'output':
        return _fit_output(demos, n_basis, settings, tolerance)
    demos = [item.uniform() for item in demos]
    with_basis = fit_forcing(demos, settings)
    if n_basis == 'auto':
        return _smallest(with_basis, demos, tolerance, sum(len(d.times) for d in demos))
    return with_basis(int(n_basis))


def _fit_output(demos: list[Demonstration], n_basis: int | str, settings: FitSettings,
                tolerance: float) -> Skill:
    several, contexts = len(demos) > 1, settings.contexts_of(len(demos))
    if several and settings.align and contexts is None:
        demos = aligned(demos)
    primitive = _fitted(demos, n_basis, settings, tolerance, contexts)
    if contexts is None or not settings.align:
        return primitive
    for _ in range(PASSES):
        # Motions of different contexts differ: each take is aligned with the one of its context.
        expected = _in_contexts(primitive, contexts)
        primitive = _fitted(aligned(demos, expected), n_basis, settings, tolerance, contexts)
    return primitive


def _fitted(demos: list[Demonstration], n_basis: int | str, settings: FitSettings,
            tolerance: float, contexts: Contexts | None) -> Skill:
    fit = OutputFit(demos, settings)
    primitive = fit.primitive(fit.best_count(tolerance) if n_basis == 'auto' else int(n_basis))
    if len(demos) == 1:
        return primitive
    return replace(primitive, variation=variation_of(
        primitive, demos, settings.weights(len(demos)), contexts))


def _in_contexts(primitive: Skill, contexts: Contexts) -> list[Demonstration]:
    """The motion of a primitive in each context."""
    result: list[Demonstration] = []
    around = primitive.distribution
    if around is None:
        return result
    for numbers in contexts.numbers:
        moved = around.condition(context=numbers)
        times = moved.duration * np.linspace(0.0, 1.0, SAMPLES)
        result.append(Demonstration(times, Rollout(moved).sample(times).points,
                                    primitive.manifold))
    return result


def _smallest(make: Callable[[int], Skill], demos: list[Demonstration], tolerance: float,
              samples: int) -> Skill:
    """
    The primitive with the fewest basis functions that meets the tolerance, found by bisection.

    If none does, the most accurate one is returned with a warning.
    """
    check_tolerance(tolerance)
    most = max(MIN_BASIS, min(MAX_BASIS, samples // 2))
    error = _error_measure(make(most), demos)
    tried: dict[int, float] = {}

    def meets(count: int) -> bool:
        tried[count] = error(make(count))
        return tried[count] <= tolerance

    low, high = MIN_BASIS - 1, MIN_BASIS
    while not meets(high):
        if high == most:
            best = min(tried, key=lambda count: tried[count])
            warn_tolerance(best, tried[best], tolerance)
            return make(best)
        low, high = high, min(2 * high, most)
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if meets(middle) else (middle, high)
    return make(high)


def _error_measure(finest: Skill, demos: list[Demonstration]) -> Callable[[Skill], float]:
    """Error for `_smallest`: from the one demonstration, or from the finest roll-out."""
    times = np.linspace(0.0, finest.duration, 1000)
    if len(demos) == 1:
        span = demos[0].span()
        return lambda primitive: relative(mean_distance(deviation(primitive, demos[0], times)),
                                          span)
    manifold = finest.manifold
    path = Rollout(finest).sample(times).points.reshape(len(times), -1)
    span = max(d.span() for d in demos)
    return lambda primitive: relative(mean_distance(manifold.factor_distances(
        path, Rollout(primitive).sample(times).points.reshape(len(times), -1))), span)
