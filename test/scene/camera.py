"""Clouds of points of a camera that looks down at boxes."""
import numpy as np

from experiments.bench.clouds import seen
from gdmp_ros.scene import Volume

#: A camera one metre above the base that looks down: its axes x, y, z in the base are x, -y, -z.
CAMERA = np.array([0.4, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0])
CELL = 0.025


def picture(volumes, rng, count=60_000, noise=0.001, pose=CAMERA):
    """Points that a camera sees of boxes and of the floor, in the frame of the camera."""
    return seen(volumes, rng, count, noise, pose, (0.7, 0.7))


def box(name, place, size):
    return Volume(name, 'box', size, np.array([*place, 1.0, 0.0, 0.0, 0.0]))
