"""How accurately a skill reproduces demonstrations."""
from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gdmp_ros.dmp.demonstration import as_list, Demonstration
from gdmp_ros.dmp.primitive import Primitive
from gdmp_ros.dmp.rollout import Rollout

#: A demonstration with a smaller span does not move.
STILL = 1e-12


def reproduction_error(skill: Primitive, demonstrations: Demonstration | Sequence[Demonstration],
                       dt: float = 1e-3) -> np.ndarray:
    """
    Mean geodesic error / span of each demonstration, rolled out between its own start and goal.

    The span is the largest distance from the start. Each sample of the roll-out is compared with a
    smooth curve through the demonstration's samples.

    :param dt: spacing of the roll-out's samples [s]
    """
    return np.array([_error(skill, demonstration, dt)
                     for demonstration in as_list(demonstrations)])


def _error(skill: Primitive, demonstration: Demonstration, dt: float) -> float:
    duration = demonstration.duration
    times = np.append(np.arange(0.0, duration - 1e-9, dt), duration)
    return relative(mean_distance(deviation(skill, demonstration, times)), demonstration.span())


def relative(distance: float, span: float) -> float:
    """A distance as a part of the span; if nothing moves, the distance itself."""
    return distance / span if span > STILL else distance


def mean_distance(distances: np.ndarray) -> float:
    """Mean geodesic distance, given those in each factor, shape ``(count, factors)``."""
    return float(np.linalg.norm(distances, axis=1).mean())


def deviation(skill: Primitive, demonstration: Demonstration, times: np.ndarray) -> np.ndarray:
    """
    Geodesic distance in each factor between a demonstration and its reproduction.

    A skill with task frames is rolled out with the frames of the demonstration.

    :param times: since the start [s]
    :returns: shape ``(len(times), factors)``
    """
    manifold = skill.manifold
    path = (_among_objects(skill, demonstration, times) if skill.views
            else _between_ends(skill, demonstration, times))
    points = demonstration.at(demonstration.times[0] + times)
    # The roll-out may use the other representative (-q) of the same motion.
    other = manifold.align(points[0], path[0])
    if not np.array_equal(other, points[0]):
        points[0] = other
        for i in range(1, len(points)):
            points[i] = manifold.align(points[i], points[i - 1])
    return manifold.factor_distances(path.reshape(len(times), -1), points.reshape(len(times), -1))


def _between_ends(skill: Primitive, demonstration: Demonstration, times: np.ndarray) -> np.ndarray:
    # From the skill's own start the frame needs no transport, and to its own goal no switch.
    start, goal = (None if np.array_equal(point, own) else point for point, own in (
        (demonstration.points[0], skill.start), (demonstration.points[-1], skill.goal)))
    return Rollout(skill, start=start, goal=goal,
                   duration=demonstration.duration).sample(times).points


def _among_objects(skill: Primitive, demonstration: Demonstration, times: np.ndarray
                   ) -> np.ndarray:
    """The roll-out of a skill with task frames, where the objects were in the demonstration."""
    names = [view.name for view in skill.views if view.name in demonstration.frames]
    poses = {name: np.atleast_2d(demonstration.frames[name]) for name in names}
    rollout = Rollout(skill, start=demonstration.points[0], duration=demonstration.duration,
                      frames={name: given[0] for name, given in poses.items()})
    moving = [name for name in names if len(poses[name]) > 1]
    if not moving:
        return rollout.sample(times).points
    stamps, points = demonstration.times - demonstration.times[0], []
    for step, time in zip(np.diff(times, prepend=0.0), times):
        points.append(rollout.advance(float(step)).point)
        for name in moving:
            at = int(np.searchsorted(stamps, time, side='right')) - 1
            rollout.move_frame(name, poses[name][at], stamp=float(stamps[at]))
    return np.array(points)
