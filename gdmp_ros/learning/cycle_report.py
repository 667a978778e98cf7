"""How a rhythmic skill agrees with the recordings of its cycle."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.primitive import Primitive
from gdmp_ros.dmp.rollout import Rollout
from gdmp_ros.errors import DataError
from gdmp_ros.learning.cycle_fit import CycleFit, thinned
from gdmp_ros.learning.preparation import prepared
from gdmp_ros.manifolds import Manifold

#: Points of the cycle, and steps by which its phase is searched, coarse and fine.
_PHASES, _STEPS = 4096, (64, 8, 1)


class CycleTake(NamedTuple):
    """
    One recording beside the cycle.

    :ivar cycles: how many it has
    :ivar period: of them, mean [s]
    :ivar times: of the first and last sample that were used, from the first one [s]
    :ivar away: distance of these samples from the cycle in each factor, shape ``(T, factors)``
    :ivar progress: cycles passed at these samples, on the phase of the skill
    :ivar points: these samples, flat
    """

    cycles: float
    period: float
    times: tuple[float, float]
    away: np.ndarray
    progress: np.ndarray
    points: np.ndarray


def cycle_takes(skill: Primitive, shown: list[Demonstration]) -> list[CycleTake]:
    """
    Find the cycles of recordings, and their distances from that of a rhythmic skill.

    :raises GdmpError: if a recording does not repeat a cycle
    """
    manifold, uniform = skill.manifold, [thinned(one) for one in prepared(shown, None)]
    try:
        fitted = CycleFit(uniform, np.ones(len(shown)), None).fitted()
    except DataError:  # one cycle, learned with its period
        fitted = CycleFit(uniform, np.ones(len(shown)), skill.duration).fitted()
    s = np.arange(_PHASES) / _PHASES
    orbit = Rollout(skill).sample((1.0 + s) * skill.duration).points.reshape(_PHASES, -1)
    spans = manifold.factor_distances(np.repeat(orbit[:1], _PHASES, axis=0), orbit).max(axis=0)
    weights = 1.0 / np.maximum(spans, 1e-9)
    takes = []
    for one, take in zip(uniform, fitted.takes):
        first, last = take.samples
        points = np.array([manifold.flat(manifold.align(p, skill.start))
                           for p in one.points[first:last + 1]])
        at = np.rint(take.progress * _PHASES).astype(np.int64)
        few = slice(None, None, max(len(points) // 100, 1))
        at += _shift(manifold, points[few], at[few], orbit, weights)
        spacing = one.duration / (len(one.times) - 1)
        takes.append(CycleTake(take.cycles, take.period, (first * spacing, last * spacing),
                               manifold.factor_distances(points, orbit[at % _PHASES]),
                               at / _PHASES, points))
    return takes


def _shift(manifold: Manifold, points: np.ndarray, at: np.ndarray, orbit: np.ndarray,
           weights: np.ndarray) -> int:
    """By how many phases points have to be shifted to be nearest to the cycle."""
    def apart(shift: int) -> float:
        away = manifold.factor_distances(points, orbit[(at + shift) % _PHASES])
        return float(((weights * away) ** 2).sum())
    shift, around = 0, _PHASES
    for step in _STEPS:
        shift = min(range(shift - around // 2, shift + around // 2 + 1, step), key=apart)
        around = 2 * step
    return shift
