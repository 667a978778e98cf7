"""
Demonstrations beyond the cut locus: segments, and the target that attracts the motion.

Where a demonstration leaves the region in which ``Log_Y(G)`` is unique, it is split into segments,
each with a target inside the region: the end of the segment. When a segment begins, the target
moves to the segment's end along the geodesic, with a continuous velocity. The forcing term is
learned with the same moving target, so position, velocity and acceleration are continuous at the
joins, and one set of weights covers all segments. Only the factors that need it are split; the
others are attracted by the goal throughout. The target of the last segment is the goal itself: a
new goal acts at once on a factor that is not split, and in the last segment on one that is.

Source: [GDMP] Remark 1 and Fig. 2b, which leave the cut locus to the user.
"""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
import math

import numpy as np

from gdmp_ros.kernels import kernel, noinline, numbers_at
from gdmp_ros.manifolds import Manifold
from gdmp_ros.manifolds.factors import factor_exp, factor_log
from gdmp_ros.manifolds.linalg import copy_numbers
from gdmp_ros.util.profiles import smoothstep

#: Longest way within a segment [rad]: point and target stay far from each other's cut locus.
LONGEST_SEGMENT = 0.45 * math.pi


@dataclass(frozen=True, eq=False)
class Segments:
    """
    Where a motion is split.

    :ivar ends: progress s at which each segment but the last ends, increasing, within 0 … 1
    :ivar waypoints: the targets of these segments, flat points, shape ``(len(ends), point_size)``
    :ivar split: for each factor, whether it is split
    """

    ends: np.ndarray = field(default_factory=lambda: np.empty(0))
    waypoints: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))
    split: tuple[bool, ...] = ()

    def __post_init__(self) -> None:
        for array in (self.ends, self.waypoints):
            array.flags.writeable = False

    def __len__(self) -> int:
        """Number of segments: 1 if nothing is split."""
        return len(self.ends) + 1


@kernel
def target_at(factors, split, count, ends, waypoints, goal, s, out, tangent, work):
    """
    Write the target that attracts the motion at ``s``: the goal for factors not split.

    :param count: number of waypoints
    """
    noinline()
    size, index = factors[factors.size - 1].point_end, 0
    copy_numbers(size, goal, out)
    while index < count and s >= ends[index]:
        index += 1
    for i in range(factors.size):
        factor = factors[i]
        if split[i] == 0.0:
            continue
        if index == 0:
            for k in range(factor.point, factor.point_end):
                out[k] = waypoints[0, k]
            continue
        begin, end, last = ends[index - 1], 1.0, numbers_at(goal, 0, size)
        if index < count:
            end, last = ends[index], numbers_at(waypoints, index * size, size)
        u = (s - begin) / (end - begin)
        if u >= 1.0:
            continue
        previous = numbers_at(waypoints, (index - 1) * size, size)
        factor_log(factor, previous, last, tangent, work)
        for k in range(factor.tangent, factor.tangent_end):
            tangent[k] *= smoothstep(u)
        factor_exp(factor, previous, tangent, out, work)


@kernel
def _target_rows(factors, split, ends, waypoints, goal, s, out, tangent, work):
    for i in range(s.size):
        target_at(factors, split, ends.size, ends, waypoints, goal, s[i],
                  numbers_at(out, i * out.shape[1], out.shape[1]), tangent, work)


def targets(manifold: Manifold, segments: Segments, goal: np.ndarray, s: np.ndarray) -> np.ndarray:
    """
    Target of the motion at each of ``s``, flat points, shape ``(len(s), point_size)``.

    :param goal: flat point
    """
    out = np.empty((len(s), manifold.point_size))
    if len(segments) == 1:
        out[:] = goal
        return out
    _target_rows(manifold.factor_table, np.array(segments.split, dtype=np.float64),
                 segments.ends.copy(), np.array(segments.waypoints), np.array(goal),
                 np.array(s, dtype=np.float64), out, np.empty(manifold.tangent_size),
                 manifold.scratch())
    return out


def cut_locus_distances(manifold: Manifold, points: np.ndarray,
                        goal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """
    Distance of each factor of the samples from the cut locus of the goal, and their spacing.

    :param points: flat samples, shape ``(samples, point_size)``
    :returns: distances [rad], shape ``(factors, samples)`` (inf where there is no cut locus), and
        distances between neighbours, shape ``(factors, samples - 1)``
    """
    factors = manifold.factors
    distances = np.full((len(factors), len(points)), np.inf)
    spacing = np.zeros((len(factors), len(points) - 1))
    for i, (factor, part) in enumerate(zip(factors, manifold.point_slices)):
        if factor.has_cut_locus:
            path = factor.unflat(points[:, part])
            distances[i] = factor.log_anyway(path, factor.unflat(goal[part]))[1]
            spacing[i] = factor.distance(path[:-1], path[1:])
    return distances, spacing


def split_factors(manifold: Manifold, distances: np.ndarray,
                  spacing: np.ndarray) -> tuple[bool, ...]:
    """Which factors come too near the cut locus, or within two samples (`split_margin`)."""
    return tuple(bool(least < max(factor.split_margin, 2.0 * step)) for factor, least, step
                 in zip(manifold.factors, distances.min(axis=1), spacing.max(axis=1)))


def segment_ends(spacing: Sequence[np.ndarray], split: Sequence[bool]) -> np.ndarray:
    """
    Progress at which to split, so that no segment is longer than `LONGEST_SEGMENT`.

    :param spacing: of each demonstration, uniform in time, from `cut_locus_distances`
    """
    grid = np.linspace(0.0, 1.0, 2001)
    rate = np.zeros(len(grid))
    for steps in spacing:
        largest = steps[np.array(split)].max(axis=0)
        travelled = np.concatenate([[0.0], np.cumsum(largest)])
        resampled = np.interp(grid, np.linspace(0.0, 1.0, len(travelled)), travelled)
        rate = np.maximum(rate, np.gradient(resampled, grid))
    total = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(grid))])
    count = max(2, math.ceil(total[-1] / LONGEST_SEGMENT))
    return np.asarray(np.interp(total[-1] * np.arange(1, count) / count, total, grid))
