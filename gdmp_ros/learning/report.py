"""Fit reports: how accurately a skill reproduces its demonstrations, and suspect samples."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.ndimage import median_filter

from gdmp_ros.dmp.demonstration import as_list, Demonstration, MIN_RESAMPLED
from gdmp_ros.dmp.evaluation import deviation, mean_distance, relative
from gdmp_ros.dmp.forcing import basis, periodic_basis, periodic_design
from gdmp_ros.dmp.rollout import Rollout
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import DataError
from gdmp_ros.learning.cleaning import noise_level
from gdmp_ros.learning.cycles import CycleFit, thinned
from gdmp_ros.learning.preparation import prepared
from gdmp_ros.learning.regression import scaled_design_matrix
from gdmp_ros.learning.rhythmic_fit import PHASES
from gdmp_ros.manifolds import Manifold

#: A sample is suspect if its deviation from its neighbours is this many times the local median.
_OUTLIER = 12.0
#: Window of the local median [samples].
_WINDOW = 31
#: A spacing of this many times the median is a gap.
_GAP = 5.0
#: Most suspect samples listed for one demonstration.
MAX_LISTED = 20
#: Points of the cycle, and steps by which its phase is searched, coarse and fine.
_PHASES, _STEPS = 4096, (64, 8, 1)


class Suspicion(NamedTuple):
    """A sample that may be wrong, at ``time`` [s] after the first, and the reason."""

    sample: int
    time: float
    reason: str


class DemonstrationFit(NamedTuple):
    """
    How one demonstration is reproduced.

    :ivar mean_error: by factor, geodesic
    :ivar largest_error: by factor
    :ivar relative_error: mean geodesic error / span
    :ivar noise: by factor, standard deviation of a coordinate of a sample
    :ivar cycles: of a rhythmic skill; 0 otherwise
    :ivar used: times of the first and last sample that belong to them, from the first one [s]
    :ivar closing: by factor, how far from its beginning a cycle ends (RMS)
    """

    duration: float
    samples: int
    mean_error: tuple[float, ...]
    largest_error: tuple[float, ...]
    relative_error: float
    suspicions: tuple[Suspicion, ...]
    noise: tuple[float, ...]
    cycles: float = 0.0
    used: tuple[float, float] = (0.0, 0.0)
    closing: tuple[float, ...] = ()


class Fit(NamedTuple):
    """
    Result of learning.

    :ivar condition: of the normal equations, columns scaled to unit length
    :ivar segments: progress s at which the motion is split at the cut locus, if it is
    """

    factors: tuple[str, ...]
    n_basis: int
    condition: float
    segments: tuple[float, ...]
    demonstrations: tuple[DemonstrationFit, ...]


def fit_report(skill: Skill, demonstrations: Demonstration | Sequence[Demonstration]) -> Fit:
    """
    Compare a skill with the demonstrations it was learned from.

    Each demonstration is reproduced between its own start and goal, in its own duration. Of a
    rhythmic skill the cycle is compared; the duration of a demonstration is then that of a cycle.
    """
    demos, alpha_x = as_list(demonstrations), skill.gains.alpha_x
    if skill.rhythmic:
        return _cycle_report(skill, demos)
    s = np.concatenate([np.linspace(0.0, 1.0, max(len(d.times), MIN_RESAMPLED)) for d in demos])
    matrix, _ = scaled_design_matrix(basis(skill.n_basis, alpha_x), alpha_x, s)
    return Fit(skill.manifold.names, skill.n_basis, float(np.linalg.cond(matrix) ** 2),
               tuple(skill.segments.ends.tolist()),
               tuple(_fit(skill, recorded, used) for recorded, used in zip(
                   demos, prepared(demos, None, tell=False))))


def _cycle_report(skill: Skill, demos: list[Demonstration]) -> Fit:
    matrix = np.empty((PHASES, skill.n_basis))
    periodic_design(periodic_basis(skill.n_basis), np.arange(PHASES) / PHASES, matrix)
    result = []
    for demo, take in zip(demos, cycle_takes(skill, demos)):
        result.append(DemonstrationFit(
            take.period, len(demo.times), tuple(take.away.mean(axis=0).tolist()),
            tuple(take.away.max(axis=0).tolist()),
            relative(mean_distance(take.away), demo.span()), tuple(suspect_samples(demo)),
            _noise(demo), take.cycles, take.times, tuple(take.closing.tolist())))
    return Fit(skill.manifold.names, skill.n_basis, float(np.linalg.cond(matrix) ** 2), (),
               tuple(result))


def _fit(skill: Skill, recorded: Demonstration, used: Demonstration) -> DemonstrationFit:
    shown = replace(used, frames=recorded.frames) if skill.views else used
    distances = deviation(skill, shown, used.times - used.times[0])
    error = relative(mean_distance(distances), used.span())
    return DemonstrationFit(used.duration, len(recorded.times),
                            tuple(distances.mean(axis=0).tolist()),
                            tuple(distances.max(axis=0).tolist()), error,
                            tuple(suspect_samples(recorded)), _noise(used))


def _noise(demonstration: Demonstration) -> tuple[float, ...]:
    curve, times = demonstration.unrolled, demonstration.times
    return tuple(noise_level(curve[:, columns], times)
                 for columns in demonstration.manifold.tangent_slices)


def suspect_samples(demonstration: Demonstration) -> list[Suspicion]:
    """Gaps in the stamps, jumps and repeated samples; at most `MAX_LISTED`."""
    times = demonstration.times - demonstration.times[0]
    spacing = np.diff(times)
    usual = float(np.median(spacing))
    result = [Suspicion(int(i), float(times[i]), f'a gap of {spacing[i]:.3g} s follows, '
                        f'{spacing[i] / usual:.0f} times the usual spacing')
              for i in np.flatnonzero(spacing > _GAP * usual)]
    curve = demonstration.unrolled
    scale = float(np.linalg.norm(curve - curve[0], axis=1).max())
    result += _repeats(times, curve, scale) + _jumps(times, curve, scale, _GAP * usual)
    first = {item.sample: item for item in reversed(result)}
    return sorted(first.values())[:MAX_LISTED]


def _jumps(times: np.ndarray, curve: np.ndarray, scale: float, gap: float) -> list[Suspicion]:
    """Samples far off the line between their neighbours, compared with those around them."""
    spacing = np.diff(times)
    share = ((times[1:-1] - times[:-2]) / (times[2:] - times[:-2]))[:, None]
    off = np.linalg.norm(curve[1:-1] - (1.0 - share) * curve[:-2] - share * curve[2:], axis=1)
    usual = median_filter(off, size=min(_WINDOW, len(off)), mode='nearest')
    off[(spacing[1:] > gap) | (spacing[:-1] > gap)] = 0.0
    ratio = off / np.maximum(usual, 1e-6 * scale)
    peak = (off >= np.roll(off, 1)) & (off > np.roll(off, -1))
    return [Suspicion(int(i) + 1, float(times[i + 1]),
                      f'jumps: {ratio[i]:.0f} times further from its neighbours '
                       'than nearby samples')
            for i in np.flatnonzero(peak & (ratio > _OUTLIER))]


def _repeats(times: np.ndarray, curve: np.ndarray, scale: float) -> list[Suspicion]:
    """Samples equal to the one before although the motion is under way."""
    steps = np.linalg.norm(np.diff(curve, axis=0), axis=1)
    around = median_filter(steps, size=min(_WINDOW, len(steps)), mode='nearest')
    frozen = np.flatnonzero((steps < 1e-3 * around) & (around > 1e-5 * scale))
    return [Suspicion(int(i) + 1, float(times[i + 1]), 'repeats the sample before it in motion')
            for i in frozen]


class CycleTake(NamedTuple):
    """
    One recording beside the cycle.

    :ivar cycles: how many it has
    :ivar period: of them, mean [s]
    :ivar times: of the first and last sample that were used, from the first one [s]
    :ivar away: distance of these samples from the cycle in each factor, shape ``(T, factors)``
    :ivar progress: cycles passed at these samples, on the phase of the skill
    :ivar points: these samples, flat
    :ivar closing: by factor, how far from its beginning a cycle ends (RMS)
    """

    cycles: float
    period: float
    times: tuple[float, float]
    away: np.ndarray
    progress: np.ndarray
    points: np.ndarray
    closing: np.ndarray


def cycle_takes(skill: Skill, demos: list[Demonstration]) -> list[CycleTake]:
    """
    Find the cycles of recordings, and their distances from that of a rhythmic skill.

    :raises GdmpError: if a recording does not repeat a cycle
    """
    manifold, uniform = skill.manifold, [
        thinned(item.uniform()) for item in prepared(demos, None, tell=False)]
    try:
        fitted = CycleFit(uniform, np.ones(len(demos)), None).fitted()
    except DataError:  # one cycle, learned with its period
        fitted = CycleFit(uniform, np.ones(len(demos)), skill.duration).fitted()
    s = np.arange(_PHASES) / _PHASES
    orbit = Rollout(skill).sample((1.0 + s) * skill.duration).points.reshape(_PHASES, -1)
    spans = manifold.factor_distances(np.repeat(orbit[:1], _PHASES, axis=0), orbit).max(axis=0)
    weights = 1.0 / np.maximum(spans, 1e-9)
    takes = []
    for item, take in zip(uniform, fitted.takes):
        first, last = take.samples
        points = np.array([manifold.flat(manifold.align(p, skill.start))
                           for p in item.points[first:last + 1]])
        at = np.rint(take.progress * _PHASES).astype(np.int64)
        few = slice(None, None, max(len(points) // 100, 1))
        at += _shift(manifold, points[few], at[few], orbit, weights)
        spacing = item.duration / (len(item.times) - 1)
        takes.append(CycleTake(take.cycles, take.period, (first * spacing, last * spacing),
                               manifold.factor_distances(points, orbit[at % _PHASES]),
                               at / _PHASES, points, take.closing))
    return takes


def _shift(manifold: Manifold, points: np.ndarray, at: np.ndarray, orbit: np.ndarray,
           weights: np.ndarray) -> int:
    """By how many phases points have to be shifted to be nearest to the cycle."""
    def apart(shift: int) -> float:
        offset = manifold.factor_distances(points, orbit[(at + shift) % _PHASES])
        return float(((weights * offset) ** 2).sum())
    shift, around = 0, _PHASES
    for step in _STEPS:
        shift = min(range(shift - around // 2, shift + around // 2 + 1, step), key=apart)
        around = 2 * step
    return shift
