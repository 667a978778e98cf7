"""Distances of points and segments from volumes (`gdmp_ros.scene.volume`), compiled."""
from __future__ import annotations

import math

import numpy as np

from gdmp_ros.kernels import kernel, local_numbers, numbers_at
from gdmp_ros.manifolds.quaternion import rotate
from gdmp_ros.scene.volume import ALLOWED, HALF, POSE, RADIUS, VOLUME_SIZE


@kernel
def is_allowed(volume, bit):
    """Whether a link may touch a volume; bit 0 is no link."""
    return bit > 0.0 and math.floor(volume[ALLOWED] / bit) % 2.0 == 1.0


@kernel
def _into_box(volume, point, out):
    """Write a point in the frame of a volume."""
    back = local_numbers(4)
    back[0] = volume[POSE + 3]
    for i in range(3):
        out[i] = point[i] - volume[POSE + i]
        back[1 + i] = -volume[POSE + 4 + i]
    rotate(back, out, out)


@kernel
def _outside(volume, point, way):
    """
    Distance of a point, in the frame of the volume, from the box; negative inside of it.

    :param way: written: unit vector away from the box
    """
    square, nearest, depth = 0.0, 0, math.inf
    for i in range(3):
        half = volume[HALF + i]
        way[i] = point[i] - min(max(point[i], -half), half)
        square += way[i] * way[i]
        if half - abs(point[i]) < depth:
            nearest, depth = i, half - abs(point[i])
    distance = math.sqrt(square)
    if distance > 1e-12:
        scale = 1.0 / distance
        for i in range(3):
            way[i] *= scale
        return distance
    # Inside, the nearest face is the way out.
    for i in range(3):
        way[i] = 0.0
    way[nearest] = 1.0 if point[nearest] >= 0.0 else -1.0
    return -depth


@kernel
def distance_within(volume, point, way):
    """
    Distance of a point from a volume [m]; negative inside of it.

    :param volume: packed
    :param way: written: unit vector from the volume to the point, in the frame of the volume
    """
    inside = local_numbers(3)
    _into_box(volume, point, inside)
    return _outside(volume, inside, way) - volume[RADIUS]


@kernel
def point_distance(volume, point, way):
    """
    Distance of a point from a volume [m]; negative inside of it.

    :param volume: packed
    :param way: written: unit vector from the volume to the point, in the frame of the point
    """
    distance = distance_within(volume, point, way)
    rotate(numbers_at(volume, POSE + 3, 4), way, way)
    return distance


@kernel
def _slope(volume, first, along, t):
    """Half of the derivative, by t, of the squared distance of a point of a segment."""
    slope = 0.0
    for i in range(3):
        half, at = volume[HALF + i], first[i] + t * along[i]
        slope += (at - min(max(at, -half), half)) * along[i]
    return slope


@kernel
def segment_distance(volume, a, b, way):
    """
    Distance of a segment from a volume [m]; negative where it runs through it.

    The derivative of the squared distance along the segment increases, and is linear between the
    planes of the faces: so the nearest point is found exactly.

    :param volume: packed
    :param way: written: unit vector from the volume to the nearest point of the segment
    :returns: the distance, and where on the segment the point is, 0 to 1
    """
    first, along, point = local_numbers(3), local_numbers(3), local_numbers(3)
    _into_box(volume, a, first)
    _into_box(volume, b, along)
    for i in range(3):
        along[i] -= first[i]
    low, high = 0.0, 1.0
    slope_low, slope_high = _slope(volume, first, along, 0.0), _slope(volume, first, along, 1.0)
    if slope_low >= 0.0:
        t = 0.0
    elif slope_high <= 0.0:
        t = 1.0
    else:
        for i in range(6):
            speed = along[i // 2]
            if abs(speed) < 1e-15:
                continue
            face = volume[HALF + i // 2] * (1.0 if i % 2 == 0 else -1.0)
            t = (face - first[i // 2]) / speed
            if t <= low or t >= high:
                continue
            slope = _slope(volume, first, along, t)
            if slope <= 0.0:
                low, slope_low = t, slope
            else:
                high, slope_high = t, slope
        t = low - slope_low * (high - low) / (slope_high - slope_low)
    for i in range(3):
        point[i] = first[i] + t * along[i]
    distance = _outside(volume, point, way)
    rotate(numbers_at(volume, POSE + 3, 4), way, way)
    return distance - volume[RADIUS], t


def distances(volumes: np.ndarray, points: np.ndarray) -> np.ndarray:
    """
    Distances of points from the nearest of some volumes [m], shape (n,); inf without a volume.

    :param volumes: packed, shape (m, `VOLUME_SIZE`)
    :param points: shape (n, 3) [m]
    """
    result = np.empty(len(points))
    _distances(np.ascontiguousarray(volumes, dtype=float).reshape(-1, VOLUME_SIZE),
               np.ascontiguousarray(points, dtype=float), result)
    return result


@kernel
def _distances(volumes, points, result):
    way = local_numbers(3)
    for k in range(points.shape[0]):
        result[k] = math.inf
        for m in range(volumes.shape[0]):
            result[k] = min(result[k], point_distance(volumes[m], points[k], way))
