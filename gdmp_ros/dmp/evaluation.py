"""How well a skill reproduces what it was shown."""
from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gdmp_ros.dmp.demonstration import Demonstration, one_or_several
from gdmp_ros.dmp.development import distances
from gdmp_ros.dmp.rollout import Rollout
from gdmp_ros.dmp.skill import Skill


def reproduction_error(skill: Skill, demonstrations: Demonstration | Sequence[Demonstration],
                       dt: float = 1e-3) -> np.ndarray:
    """
    Mean geodesic error / span of each demonstration, rolled out from its own start to its own
    goal.

    The span is the largest distance from the start. The error is taken where the roll-out was
    sampled, against a smooth curve through the demonstration's samples.

    :param dt: spacing of the roll-out's samples [s]
    """
    return np.array([_error(skill, demonstration, dt)
                     for demonstration in one_or_several(demonstrations)])


def _error(skill: Skill, demonstration: Demonstration, dt: float) -> float:
    whole = demonstration.duration
    times = np.append(np.arange(0.0, whole - 1e-9, dt), whole)
    return mean_distance(deviation(skill, demonstration, times)) / demonstration.span()


def mean_distance(away: np.ndarray) -> float:
    """Mean geodesic distance from those in each factor, shape ``(count, factors)``."""
    return float(np.linalg.norm(away, axis=1).mean())


def deviation(skill: Skill, demonstration: Demonstration, times: np.ndarray) -> np.ndarray:
    """
    Geodesic distance in each factor between a demonstration and its reproduction.

    :param times: since the start [s]
    :returns: shape ``(len(times), factors)``
    """
    manifold = skill.manifold
    # The skill's own start and goal need not be carried anywhere.
    own = np.array_equal(demonstration.points[0], skill.start)
    start, goal = (None, None) if own else (demonstration.points[0], demonstration.points[-1])
    path = Rollout(skill, start=start, goal=goal, duration=demonstration.duration).sample(times)
    shown = demonstration.at(demonstration.times[0] + times)
    # The roll-out may be in the other representative of the same motion, from the start on.
    other = manifold.align(shown[0], path.points[0])
    if not np.array_equal(other, shown[0]):
        shown[0] = other
        for i in range(1, len(shown)):
            shown[i] = manifold.align(shown[i], shown[i - 1])
    return distances(manifold, path.points.reshape(len(times), -1), shown.reshape(len(times), -1))
