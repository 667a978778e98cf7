"""Clouds of points of a camera that looks down at boxes."""
import numpy as np

from gdmp_ros.scene import Volume

#: A camera one metre above the base that looks down: its axes x, y, z in the base are x, -y, -z.
CAMERA = np.array([0.4, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0])
CELL = 0.025


def picture(volumes, rng, count=60_000, noise=0.001, pose=CAMERA):
    """Points that a camera sees of boxes and of the floor, in the frame of the camera."""
    ways = np.column_stack([rng.uniform(-0.7, 0.7, (count, 2)), np.ones(count)])
    turn = np.array([1.0, -1.0, -1.0])
    base, eye = ways * turn, pose[:3]
    depth = eye[2] / -base[:, 2]
    for volume in volumes:
        low, high = (volume.pose[:3] + side * volume.half - eye for side in (-1.0, 1.0))
        first, last = np.minimum(low / base, high / base), np.maximum(low / base, high / base)
        first, last = first.max(axis=1), last.min(axis=1)
        depth = np.where((first < last) & (first < depth), first, depth)
    return ways * depth[:, None] + rng.normal(0.0, noise, (count, 3))


def box(name, place, size):
    return Volume(name, 'box', size, np.array([*place, 1.0, 0.0, 0.0, 0.0]))
