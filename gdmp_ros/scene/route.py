"""
A way for the tool around volumes: shortest on a coarse grid, then drawn tight.

Dijkstra's algorithm on the cells that are free; 26 neighbours. It says which volume is in the way
if there is none.
"""
from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from gdmp_ros.kernels import kernel, local_numbers
from gdmp_ros.manifolds.quaternion import rotate
from gdmp_ros.scene.distance import is_allowed, segment_distance
from gdmp_ros.scene.volume import CARRIED, MARGIN, THERE

#: Edge of a cell [m], how far around the plain path ways are searched [m], and most cells.
CELL, AROUND, MOST_CELLS = 0.025, 0.35, 300_000
#: Points of a way, and rounds in which it is drawn tight.
POINTS, ROUNDS = 81, 200


class Tool(NamedTuple):
    """
    Shape of what moves: capsules in its frame.

    :ivar capsules: both ends of the axis, radius [m], the bit of its link; shape (m, 8)
    :ivar bits: of the links of the arm, which volumes may allow to touch them
    """

    capsules: np.ndarray
    bits: Mapping[str, int] = {}

    @classmethod
    def ball(cls, radius: float) -> Tool:
        """Return a sphere around the tool point [m]."""
        return cls(np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, radius, 0.0]]))

    @property
    def links(self) -> set[str]:
        """Names of the links that it consists of."""
        return {name for name, bit in self.bits.items() if bit in self.capsules[:, 7]}

    def carrying(self, carried: np.ndarray) -> Tool:
        """
        Return it with what it carries.

        :param carried: `gdmp_ros.scene.scene.Scene.carried`
        """
        bit = np.full((len(carried), 1), float(self.bits.get(CARRIED, 0)))
        return self._replace(capsules=np.vstack([self.capsules, np.hstack([carried, bit])]))


@kernel
def _clearances(volumes, capsules, points, turns, extra, result, which):
    """Write the least distance, without margin, of a tool at each point, and from which volume."""
    first, second, way = local_numbers(3), local_numbers(3), local_numbers(3)
    for k in range(points.shape[0]):
        result[k], which[k] = np.inf, -1
        for c in range(capsules.shape[0]):
            rotate(turns[k], capsules[c, 0:3], first)
            rotate(turns[k], capsules[c, 3:6], second)
            for i in range(3):
                first[i] += points[k, i]
                second[i] += points[k, i]
            for v in range(volumes.shape[0]):
                if volumes[v, THERE] == 0.0 or is_allowed(volumes[v], capsules[c, 7]):
                    continue
                distance, _ = segment_distance(volumes[v], first, second, way)
                left = distance - capsules[c, 6] - extra * volumes[v, MARGIN]
                if left < result[k]:
                    result[k], which[k] = left, v


def clearances(volumes: np.ndarray, tool: Tool, points: np.ndarray, turns: np.ndarray,
               margins: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """
    Distance of a tool from the nearest volume, less its margin [m], and which it is.

    :param volumes: packed, shape (m, `VOLUME_SIZE`)
    :param points: where the tool is, shape (n, 3) [m]
    :param turns: its orientations, shape (n, 4) or (4,)
    :param margins: how many margins are kept
    :returns: shapes (n,); inf and -1 without a volume
    """
    points = np.ascontiguousarray(points, dtype=float)
    turns = np.ascontiguousarray(np.broadcast_to(turns, (len(points), 4)), dtype=float)
    result, which = np.empty(len(points)), np.empty(len(points), dtype=np.int64)
    _clearances(np.ascontiguousarray(volumes), np.ascontiguousarray(tool.capsules), points, turns,
                float(margins), result, which)
    return result, which


class Grid:
    """Cells around a path that are free or not."""

    def __init__(self, volumes: np.ndarray, tool: Tool, path: np.ndarray, turn: np.ndarray,
                 margins: float, lowest: float):
        """
        Find out which cells are free.

        :param path: positions, shape (n, 3) [m]
        :param turn: orientation of the tool
        :param margins: how many are kept
        :param lowest: height below which nothing is searched [m]
        """
        low, high = path.min(axis=0) - AROUND, path.max(axis=0) + AROUND
        low[2] = max(low[2], min(lowest, path[:, 2].min()))
        self.cell = max(CELL, float(np.prod(high - low) / MOST_CELLS) ** (1.0 / 3.0))
        self.shape = tuple(np.maximum(np.ceil((high - low) / self.cell).astype(int), 1) + 1)
        self.low = low
        places = np.indices(self.shape).reshape(3, -1).T * self.cell + low
        free, _ = clearances(volumes, tool, places, turn, margins)
        self.free = (free > 0.0).reshape(self.shape)

    def index(self, point: np.ndarray) -> int:
        """Return the free cell that is nearest to a point; -1 if none is near."""
        at = np.argwhere(self.free)
        if not len(at):
            return -1
        away = np.linalg.norm(at * self.cell + self.low - point, axis=1)
        k = int(np.argmin(away))
        if away[k] > 2.0 * self.cell:
            return -1
        return int(np.ravel_multi_index(tuple(at[k]), self.shape))

    def shortest(self, start: np.ndarray, goal: np.ndarray) -> np.ndarray | None:
        """Return the shortest way through free cells, shape (n, 3); None without one."""
        first, last = self.index(start), self.index(goal)
        if first < 0 or last < 0:
            return None
        numbers = np.arange(self.free.size).reshape(self.shape)
        rows, columns, lengths = [], [], []
        for step in np.ndindex(3, 3, 3):
            way = np.array(step) - 1
            if tuple(way) <= (0, 0, 0):
                continue  # the opposite one is the same edge
            here = tuple(slice(max(-w, 0), n - max(w, 0)) for w, n in zip(way, self.shape))
            there = tuple(slice(max(w, 0), n - max(-w, 0)) for w, n in zip(way, self.shape))
            both = self.free[here] & self.free[there]
            rows.append(numbers[here][both])
            columns.append(numbers[there][both])
            lengths.append(np.full(int(both.sum()), float(np.linalg.norm(way))))
        size = self.free.size
        graph = coo_matrix((np.concatenate(lengths), (np.concatenate(rows),
                                                      np.concatenate(columns))), (size, size))
        _, before = dijkstra(graph.tocsr(), directed=False, indices=first,
                             return_predecessors=True)
        if last != first and before[last] < 0:
            return None
        way_back = [last]
        while way_back[-1] != first:
            way_back.append(int(before[way_back[-1]]))
        cells = np.array(np.unravel_index(way_back[::-1], self.shape)).T
        return np.asarray(cells * self.cell + self.low)


def tight(volumes: np.ndarray, tool: Tool, way: np.ndarray, turn: np.ndarray, margins: float
          ) -> np.ndarray:
    """
    Draw a way tight, as a band that keeps its distance.

    :param way: positions, shape (n, 3) [m]; its ends stay
    :returns: as many points as `POINTS`, about evenly spaced
    """
    points = _resampled(way, POINTS)
    left, _ = clearances(volumes, tool, points, turn, margins)
    for k in range(ROUNDS):
        moved = points.copy()
        moved[1:-1] = 0.5 * (points[:-2] + points[2:])
        found, _ = clearances(volumes, tool, moved, turn, margins)
        # A point may go where it keeps its distance, or more of it than before.
        good = (found > 0.0) | (found >= left)
        points[good], left[good] = moved[good], found[good]
        if k % 20 == 19:
            points = _resampled(points, POINTS)
            left, _ = clearances(volumes, tool, points, turn, margins)
    return points


def _resampled(way: np.ndarray, count: int) -> np.ndarray:
    return points_at(way, np.linspace(0.0, 1.0, count))


def lengths_of(way: np.ndarray) -> np.ndarray:
    """Length of a way up to each of its points [m], shape (n,)."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1))])


def points_at(way: np.ndarray, shares: np.ndarray) -> np.ndarray:
    """
    Return the points of a way at shares of its length, shape (n, 3) [m].

    :param way: positions, shape (m, 3) [m]
    """
    lengths = lengths_of(way)
    if lengths[-1] == 0.0:
        return np.repeat(way[:1], len(shares), axis=0)
    return np.column_stack([np.interp(shares * lengths[-1], lengths, way[:, i])
                            for i in range(3)])
