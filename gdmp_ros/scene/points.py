"""Points as volumes: boxes around those of a mesh or of a cloud, and what a sensor still sees."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from gdmp_ros.errors import DataError
from gdmp_ros.kernels import allocating, kernel, local_numbers
from gdmp_ros.manifolds.poses import compose, IDENTITY
from gdmp_ros.manifolds.quaternion import rotate
from gdmp_ros.scene.distance import point_distance
from gdmp_ros.scene.volume import Volume, VOLUME_SIZE

#: Boxes of a mesh, and cells along its longest edge.
MESH_BOXES, MESH_CELLS = 6, 24
#: A box is not divided for less than this share of it.
LEAST_GAIN = 0.05
#: Rays of one cloud for what they pass, beside one to each cell that it shows.
RAYS = 3_000
#: What one cloud adds to a cell that it shows, and the most there can be: one that is not
#: shown any more counts as free after as many clouds.
SHOWN, MOST_SHOWN = 3, 6

_NO_CAPSULES, _NO_VOLUMES = np.empty((0, 7)), np.empty((0, VOLUME_SIZE))


@allocating
def _divide(cells, order, boxes, most, least_gain):
    """
    Write boxes around cells: again and again that which gains most is divided.

    :param cells: shape (n, 3)
    :param order: 0 to n - 1; sorted so that the cells of a box are together
    :param boxes: written: first and last cell of each box along each axis, and where in the order
        its cells begin and end; shape (most, 8)
    :returns: number of boxes
    """
    count, n = 1, cells.shape[0]
    gains = np.zeros(most, dtype=np.int64)
    cuts = np.zeros((most, 2), dtype=np.int64)
    _fit(cells, order, 0, n, boxes[0])
    gains[0] = _best_cut(cells, order, boxes[0], cuts[0])
    while count < most:
        k = 0
        for other in range(count):
            if gains[other] > gains[k]:
                k = other
        box = boxes[k]
        if gains[k] <= least_gain * _size(box):
            break
        # Those before the cut come first.
        axis, cut, low, high = cuts[k, 0], cuts[k, 1], box[6], box[7]
        middle = low
        for i in range(low, high):
            if cells[order[i], axis] < cut:
                order[middle], order[i] = order[i], order[middle]
                middle += 1
        _fit(cells, order, middle, high, boxes[count])
        _fit(cells, order, low, middle, box)
        gains[k] = _best_cut(cells, order, box, cuts[k])
        gains[count] = _best_cut(cells, order, boxes[count], cuts[count])
        count += 1
    return count


@kernel
def _size(box):
    return (box[3] - box[0] + 1) * (box[4] - box[1] + 1) * (box[5] - box[2] + 1)


@kernel
def _fit(cells, order, low, high, box):
    """Write the box around cells."""
    box[6], box[7] = low, high
    for j in range(3):
        box[j], box[3 + j] = cells[order[low], j], cells[order[low], j]
        for i in range(low + 1, high):
            value = cells[order[i], j]
            box[j], box[3 + j] = min(box[j], value), max(box[3 + j], value)


@allocating
def _best_cut(cells, order, box, cut):
    """Write the axis and the first cell behind the best cut of a box; how many cells it saves."""
    best, whole = 0, _size(box)
    for axis in range(3):
        length = box[3 + axis] - box[axis] + 1
        if length < 2:
            continue
        # Ranges of the other axes, slice by slice, then of all slices before and behind.
        ranges = np.empty((length, 6), dtype=np.int64)
        ranges[:, :3], ranges[:, 3:] = 1 << 40, -(1 << 40)
        for i in range(box[6], box[7]):
            at = cells[order[i], axis] - box[axis]
            for j in range(3):
                value = cells[order[i], j]
                ranges[at, j] = min(ranges[at, j], value)
                ranges[at, 3 + j] = max(ranges[at, 3 + j], value)
        behind = ranges.copy()
        for k in range(1, length):
            for j in range(3):
                ranges[k, j] = min(ranges[k, j], ranges[k - 1, j])
                ranges[k, 3 + j] = max(ranges[k, 3 + j], ranges[k - 1, 3 + j])
                back = length - 1 - k
                behind[back, j] = min(behind[back, j], behind[back + 1, j])
                behind[back, 3 + j] = max(behind[back, 3 + j], behind[back + 1, 3 + j])
        for k in range(1, length):
            saved = whole - _size(ranges[k - 1]) - _size(behind[k])
            if saved > best:
                best, cut[0], cut[1] = saved, axis, box[axis] + k
    return best


def boxes_around(cells: np.ndarray, most: int) -> np.ndarray:
    """
    Boxes that hold all cells, with little room for others.

    :param cells: shape (n, 3), integers
    :param most: most boxes, at least 1
    :returns: the first and the last cell of each along each axis, shape (k, 6)
    """
    cells = np.ascontiguousarray(cells, dtype=np.int64)
    if not len(cells):
        return np.empty((0, 6), dtype=np.int64)
    boxes = np.empty((most, 8), dtype=np.int64)
    count = _divide(cells, np.arange(len(cells)), boxes, most, LEAST_GAIN)
    return boxes[:count, :6]


def _volume(name: str, box: np.ndarray, low: np.ndarray, cell: float) -> Volume:
    size = (box[3:] - box[:3] + 1) * cell
    middle = low + box[:3] * cell + 0.5 * size
    return Volume(name, 'box', tuple(size), np.array([*middle, 1.0, 0.0, 0.0, 0.0]))


def volumes_around(name: str, points: Any, triangles: Any = (), most: int = MESH_BOXES,
                   thickness: float = 0.0, pose: np.ndarray = IDENTITY,
                   **others: Any) -> list[Volume]:
    """
    Boxes around points, or around the triangles between them: what a mesh counts as.

    :param points: shape (n, 3) [m]
    :param triangles: indices of points, shape (m, 3); what is inside of a closed mesh is not
        filled, but a box around it has no hole
    :param most: most boxes
    :param thickness: diameter of the points [m]
    :param pose: of the frame of the points
    :param others: fields of each `Volume`
    :returns: of the name, or several of the names ``name#1`` and so on
    :raises DataError: without a finite point
    """
    points = np.asarray(points, dtype=float).reshape(-1, 3)
    if not len(points) or not np.isfinite(points).all():
        raise DataError(f'volume {name!r}: expected finite points')
    triangles = np.asarray(triangles, dtype=np.int64).reshape(-1, 3)
    if triangles.size and not 0 <= triangles.min() <= triangles.max() < len(points):
        raise DataError(f'volume {name!r}: a triangle has a corner that is no point')
    low, high = points.min(axis=0), points.max(axis=0)
    cell = max(float((high - low).max()) / MESH_CELLS, 1e-4)
    if triangles.size:
        points = np.vstack([points, _on_triangles(points[triangles], 0.25 * cell)])
    cells = np.unique(np.minimum((points - low) // cell, MESH_CELLS).astype(np.int64), axis=0)
    found = []
    for box in boxes_around(cells, most):
        first, last = low + box[:3] * cell, np.minimum(low + (box[3:] + 1) * cell, high)
        if not triangles.size:
            # Cells round up: the box of the points is the smaller one.
            inside = ((points >= first - 1e-9) & (points <= last + 1e-9)).all(axis=1)
            first, last = points[inside].min(axis=0), points[inside].max(axis=0)
        size = np.maximum(last - first, 1e-4) + thickness
        found.append(Volume(name, 'box', tuple(size), compose(pose, np.array(
            [*(0.5 * (first + last)), 1.0, 0.0, 0.0, 0.0])), **others))
    return as_parts(name, found)


def as_parts(name: str, volumes: Sequence[Volume]) -> list[Volume]:
    """Volumes as the parts of one: of its name if it is alone, otherwise ``name#1`` and so on."""
    return [replace(volume, name=name if len(volumes) == 1 else f'{name}#{k}')
            for k, volume in enumerate(volumes, 1)]


def _on_triangles(corners: np.ndarray, spacing: float) -> np.ndarray:
    """Points of triangles, at most a spacing apart."""
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    found = []
    for steps in np.unique(np.ceil(edges / spacing).astype(int)):
        share = np.array([(i, j) for i in range(steps + 1) for j in range(steps + 1 - i)]) / max(
            steps, 1)
        of = corners[np.ceil(edges / spacing).astype(int) == steps]
        found.append((of[:, None, 0] + share[None, :, :1] * (of[:, None, 1] - of[:, None, 0])
                      + share[None, :, 1:] * (of[:, None, 2] - of[:, None, 0])).reshape(-1, 3))
    return np.vstack(found)


@kernel
def _gather(points, pose, low, cell, shape, slots, cells, means, counts):
    """
    Write which cells points are in, how many, and where in the mean.

    :param points: in the frame of the sensor, shape (n, 3)
    :param pose: of that frame
    :param slots: -1 for each cell; changed for those that are found
    :returns: how many cells, and how many points are finite
    """
    found, finite = 0, 0
    at = local_numbers(3)
    for k in range(points.shape[0]):
        for i in range(3):
            at[i] = points[k, i]
        if not abs(at[0]) + abs(at[1]) + abs(at[2]) < 1e6:
            continue
        finite += 1
        rotate(pose[3:], at, at)
        number = 0
        for i in range(3):
            at[i] += pose[i]
            index = int(np.floor((at[i] - low[i]) / cell))
            if index < 0 or index >= shape[i]:
                number = -1
                break
            number = number * shape[i] + index
        if number < 0:
            continue
        slot = slots[number]
        if slot < 0:
            slot = slots[number] = found
            cells[found], counts[found] = number, 0
            means[found] = 0.0
            found += 1
        counts[slot] += 1
        for i in range(3):
            means[slot, i] += (at[i] - means[slot, i]) / counts[slot]
    for k in range(found):
        slots[cells[k]] = -1
    return found, finite


@kernel
def _belongs(points, capsules, volumes, padding, result):
    """Write which points are in capsules or volumes, or within a distance of them."""
    way, along = local_numbers(3), local_numbers(3)
    for k in range(points.shape[0]):
        point = points[k]
        for c in range(capsules.shape[0]):
            length = dot = 0.0
            for i in range(3):
                along[i] = capsules[c, 3 + i] - capsules[c, i]
                length += along[i] * along[i]
                dot += along[i] * (point[i] - capsules[c, i])
            share = min(max(dot / length, 0.0), 1.0) if length > 0.0 else 0.0
            distance = 0.0
            for i in range(3):
                distance += (point[i] - capsules[c, i] - share * along[i]) ** 2
            if distance <= (capsules[c, 6] + padding) ** 2:
                result[k] = True
                break
        for v in range(volumes.shape[0]):
            if result[k]:
                break
            result[k] = point_distance(volumes[v], point, way) <= padding


@kernel
def _fade(shown, eye, ends, low, cell, shape, passed):
    """Take one from each cell that rays pass on their way, but only once."""
    way = local_numbers(3)
    for k in range(ends.shape[0]):
        length = 0.0
        for i in range(3):
            way[i] = ends[k, i] - eye[i]
            length += way[i] * way[i]
        length = np.sqrt(length)
        if length < cell:
            continue
        # From where the ray comes into the region, to one cell before its end.
        first, last = 0.0, 1.0 - cell / length
        for i in range(3):
            if abs(way[i]) < 1e-12:
                if eye[i] < low[i] or eye[i] > low[i] + shape[i] * cell:
                    last = -1.0
                continue
            one = (low[i] - eye[i]) / way[i]
            other = (low[i] + shape[i] * cell - eye[i]) / way[i]
            first, last = max(first, min(one, other)), min(last, max(one, other))
        step, before = 0.8 * cell / length, -1
        while first < last:
            number = 0
            for i in range(3):
                index = int(np.floor((eye[i] + first * way[i] - low[i]) / cell))
                number = number * shape[i] + min(max(index, 0), shape[i] - 1)
            if number != before and passed[number] == 0:
                passed[number] = 1
                if shown[number] > 0:
                    shown[number] -= 1
            before = number
            first += step


class PointMap:
    """
    Cells around a base in which a sensor sees something.

    A cell that a cloud shows counts as full. It counts as free again when several clouds have
    looked through it: what is hidden, by the arm for example, stays.

    :ivar cell: edge [m]
    """

    def __init__(self, reach: float, cell: float, least_points: int = 1):
        """
        Begin with free cells.

        :param reach: half of the edge of the region [m]
        :param least_points: fewer points in a cell do not count
        """
        side = int(np.ceil(2.0 * reach / cell))
        self.cell, self._least = cell, least_points
        self._low, self._shape = np.full(3, -0.5 * side * cell), np.full(3, side)
        self._shown = np.zeros(side ** 3, dtype=np.int8)
        self._slots = np.full(side ** 3, -1, dtype=np.int64)
        self._boxes: list[tuple[str, np.ndarray]] = []

    def see(self, points: np.ndarray, pose: np.ndarray, capsules: np.ndarray = _NO_CAPSULES,
            volumes: np.ndarray = _NO_VOLUMES, padding: float = 0.0, looks: bool = True) -> int:
        """
        Take a cloud.

        :param points: in the frame of the sensor, which is at its origin; shape (n, 3) [m]
        :param pose: of that frame in the base
        :param capsules: of the arm, in the base; shape (m, 7), see `Volume.capsules`
        :param volumes: that are known, packed
        :param padding: points within this distance of them belong to them [m]
        :param looks: whether the sensor is at the origin of the frame; otherwise cells are free
            that the clouds do not show
        :returns: number of finite points
        """
        points = np.ascontiguousarray(points, dtype=np.float64)
        pose = np.ascontiguousarray(pose, dtype=float)
        most = min(len(points), len(self._shown))
        cells, counts = np.empty(most, dtype=np.int64), np.empty(most, dtype=np.int64)
        means = np.empty((most, 3))
        found, finite = _gather(points, pose, self._low, self.cell, self._shape, self._slots,
                                cells, means, counts)
        if not finite:
            return 0  # a cloud that shows nothing makes nothing free
        keep = counts[:found] >= self._least
        cells, means = cells[:found][keep], means[:found][keep]
        belongs = np.zeros(len(means), dtype=bool)
        _belongs(means, capsules, volumes, padding, belongs)
        if looks:
            every = points[::max(len(points) // RAYS, 1)]
            turned = np.empty_like(every)
            _turn(every, pose, turned)
            _fade(self._shown, pose[:3].copy(), np.vstack([turned, means]), self._low, self.cell,
                  self._shape, np.zeros(len(self._shown), dtype=np.int8))
        else:
            self._shown[self._shown > 0] -= 1
        seen = cells[~belongs]
        self._shown[seen] = np.minimum(self._shown[seen] + SHOWN, MOST_SHOWN)
        return int(finite)

    def volumes(self, most: int, name: str = 'cloud') -> list[Volume]:
        """
        Boxes around all full cells; a box keeps its name while it changes little.

        :param most: most boxes
        """
        full = np.flatnonzero(self._shown)
        boxes = boxes_around(np.column_stack(np.unravel_index(full, self._shape)), most)
        self._boxes = _named(boxes, self._boxes, name)
        return [_volume(named, box, self._low, self.cell) for named, box in self._boxes]


@kernel
def _turn(points, pose, result):
    for k in range(points.shape[0]):
        rotate(pose[3:], points[k], result[k])
        for i in range(3):
            result[k, i] += pose[i]
            if not abs(result[k, i]) < 1e6:
                # No ray.
                result[k, 0], result[k, 1], result[k, 2] = pose[0], pose[1], pose[2]
                break


def _named(boxes: np.ndarray, before: list[tuple[str, np.ndarray]], name: str
           ) -> list[tuple[str, np.ndarray]]:
    """Names for boxes: that of the box before that differs least."""
    names = dict[int, str]()
    if before and len(boxes):
        differ = np.abs(boxes[:, None] - np.array([box for _, box in before])[None]).sum(axis=2)
        for k in np.argsort(differ, axis=None):
            new, old = np.unravel_index(int(k), differ.shape)
            if int(new) not in names and before[old][0] not in names.values():
                names[int(new)] = before[old][0]
    free = (f'{name}#{k}' for k in range(1, len(boxes) + len(before) + 1)
            if f'{name}#{k}' not in set(names.values()))
    return [(names.get(k) or next(free), box) for k, box in enumerate(boxes)]
