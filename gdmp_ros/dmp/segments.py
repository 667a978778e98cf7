"""
Demonstrations beyond the cut locus, and what draws a motion along them.

Where a demonstration leaves the region in which ``Log_Y(G)`` is unique, it is cut into segments,
each with a target inside it: the end of the segment. When a segment begins, the target moves on to
the segment's end along the geodesic, with a continuous velocity; the forcing term is learned with
the target where it will be. So position, velocity and acceleration are continuous at the joins,
and one set of weights spans them all. Only the factors that need it are split; the others are
drawn to the goal throughout. The last segment's target is the goal itself, wherever it moves: a
new goal acts at once on a factor that is not split, and in the last segment on one that is.

Source: the remark on the cut locus in [GDMP] (Remark 1, Fig. 2b), which is left to the user there.
"""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
import math

import numpy as np

from gdmp_ros.compilation import compiled, kept_apart
from gdmp_ros.manifolds import Manifold
from gdmp_ros.manifolds import operations as ops
from gdmp_ros.manifolds.registry import (
    apply_factor,
    factor_table,
    map_factors,
    POINT,
    VECTOR,
    work_array,
)

#: A sample this near the cut locus of the goal [rad], or within two steps of it, splits a factor.
#: The logarithm turns π / gap times as fast as the point moves there, too fast to be learned; and
#: on a sphere a goal further away than π/2 pushes sideways: at a distance r, what is beside the
#: path grows as exp(α_z/2 (√(1 - r cot r) - 1) s), threefold in a tenth of a duration at 2.04.
MARGINS = {'sphere': 1.1, 'quaternion': 1.1, 'rotation': 0.5}
#: Longest way within a segment [rad]: point and target stay well inside each other's region.
LONGEST = 0.45 * math.pi


@dataclass(frozen=True, eq=False)
class Segments:
    """
    Where a motion is cut.

    :ivar ends: progress s at which each segment but the last ends, increasing, within 0 … 1
    :ivar waypoints: the targets of these segments, flat points, shape ``(len(ends), point_size)``
    :ivar split: for each factor, whether it is cut
    """

    ends: np.ndarray = field(default_factory=lambda: np.empty(0))
    waypoints: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))
    split: tuple[bool, ...] = ()

    def __post_init__(self) -> None:
        for array in (self.ends, self.waypoints):
            array.flags.writeable = False

    def __len__(self) -> int:
        """How many segments there are: 1 where nothing is cut."""
        return len(self.ends) + 1


@compiled
def target_at(table, split, ends, waypoints, goal, s, out, vector, work):
    """Write what draws the motion at ``s`` to ``out``: for factors not split, the goal."""
    kept_apart()
    for i in range(goal.size):
        out[i] = goal[i]
    index = 0
    while index < ends.size and s >= ends[index]:
        index += 1
    for factor in range(table.shape[0]):
        if split[factor] == 0:
            continue
        first, last = table[factor, POINT], table[factor, POINT + 1]
        if index == 0:
            for i in range(first, last):
                out[i] = waypoints[0, i]
            continue
        begin, end = ends[index - 1], 1.0
        where = goal
        if index < ends.size:
            end, where = ends[index], waypoints[index]
        u = (s - begin) / (end - begin)
        if u >= 1.0:
            continue
        apply_factor(table, factor, ops.LOG, waypoints[index - 1], where, vector, work)
        for i in range(table[factor, VECTOR], table[factor, VECTOR + 1]):
            vector[i] *= u * u * (3.0 - 2.0 * u)
        apply_factor(table, factor, ops.EXP, waypoints[index - 1], vector, out, work)


@compiled
def _targets(table, split, ends, waypoints, goal, s, out, vector, work):
    for i in range(s.size):
        target_at(table, split, ends, waypoints, goal, s[i], out[i], vector, work)


def targets(manifold: Manifold, segments: Segments, goal: np.ndarray, s: np.ndarray) -> np.ndarray:
    """
    What draws the motion at each of ``s``, flat points, shape ``(len(s), point_size)``.

    :param goal: flat point
    """
    out = np.empty((len(s), manifold.point_size))
    if len(segments) == 1:
        out[:] = goal
        return out
    table = factor_table(manifold.factors)
    _targets(table, np.array(segments.split, dtype=np.int64), segments.ends.copy(),
             np.array(segments.waypoints), np.array(goal), np.array(s, dtype=np.float64), out,
             np.empty(manifold.tangent_size), work_array(table))
    return out


def cut_locus_gaps(manifold: Manifold, points: np.ndarray,
                   goal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """
    How near each factor of the samples comes to the cut locus of the goal, and its steps.

    :param points: flat samples, shape ``(samples, point_size)``
    :returns: gaps [rad], shape ``(factors, samples)`` (inf where there is no cut locus), and the
        distances between neighbours, shape ``(factors, samples - 1)``
    """
    whole = factor_table(manifold.factors)
    gaps = np.full((len(whole), len(points)), np.inf)
    lengths = np.zeros((len(whole), len(points) - 1))
    for i, factor in enumerate(manifold.factors):
        if factor.kind in ('euclidean', 'spd'):
            continue
        columns = slice(whole[i, POINT], whole[i, POINT + 1])
        part = np.array(points[:, columns], order='C')
        end = np.array(np.broadcast_to(goal[columns], part.shape), order='C')
        table = factor_table([factor])
        out, work = np.empty((len(part), factor.tangent_size)), work_array(table)
        map_factors(table, ops.LOG, part, end, out, gaps[i], work)
        answers = np.empty(len(part) - 1)
        map_factors(table, ops.LOG, part[:-1].copy(), part[1:].copy(), out[1:], answers, work)
        # SO(m): the norm of coordinates, as for the others, is the distance.
        lengths[i] = np.linalg.norm(out[1:], axis=1)
    return gaps, lengths


def split_factors(manifold: Manifold, gaps: np.ndarray, lengths: np.ndarray) -> tuple[bool, ...]:
    """Which factors of a demonstration come too near the cut locus, from its `cut_locus_gaps`."""
    return tuple(bool(low < max(MARGINS.get(factor.kind, 0.0), 2.0 * step)) for factor, low, step
                 in zip(manifold.factors, gaps.min(axis=1), lengths.max(axis=1)))


def segment_ends(lengths: Sequence[np.ndarray], split: Sequence[bool]) -> np.ndarray:
    """
    Where to cut: no split factor goes further than `LONGEST` within a segment.

    :param lengths: of each demonstration, uniform in time, from its `cut_locus_gaps`
    """
    grid = np.linspace(0.0, 1.0, 2001)
    way = np.zeros(len(grid))
    for steps in lengths:
        rates = steps[np.array(split)].max(axis=0)
        travelled = np.concatenate([[0.0], np.cumsum(rates)])
        resampled = np.interp(grid, np.linspace(0.0, 1.0, len(travelled)), travelled)
        way = np.maximum(way, np.gradient(resampled, grid))
    total = np.concatenate([[0.0], np.cumsum(0.5 * (way[1:] + way[:-1]) * np.diff(grid))])
    count = max(2, math.ceil(total[-1] / LONGEST))
    return np.asarray(np.interp(total[-1] * np.arange(1, count) / count, total, grid))
