"""Poses (x, y, z, qw, qx, qy, qz) in the frames of others, and the manifolds of a tool."""
from __future__ import annotations

import numpy as np

from gdmp_ros.manifolds.euclidean import Euclidean
from gdmp_ros.manifolds.manifold import Manifold
from gdmp_ros.manifolds.product import Product
from gdmp_ros.manifolds.quaternion import multiply, rotate, rotate_by_vector, UnitQuaternion
from gdmp_ros.manifolds.spd import SymmetricPositiveDefinite

#: Numbers of a pose, and that of a frame in itself.
POSE_SIZE = 7
IDENTITY = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])


def compose(outer: np.ndarray, inner: np.ndarray) -> np.ndarray:
    """Pose in the frame in which ``outer`` is given, of what is at ``inner`` in ``outer``."""
    result = np.empty(POSE_SIZE)
    rotate(outer[3:], inner[:3], result[:3])
    result[:3] += outer[:3]
    multiply(outer[3:], inner[3:], result[3:])
    return result


def inverse(pose: np.ndarray) -> np.ndarray:
    """Pose of the outer frame in the inner one."""
    result = np.empty(POSE_SIZE)
    result[3:] = pose[3:] * [1.0, -1.0, -1.0, -1.0]
    rotate(result[3:], -pose[:3], result[:3])
    return result


def moved_on(pose: np.ndarray, twist: np.ndarray, time: float) -> np.ndarray:
    """
    A pose after it has moved with a twist.

    :param twist: velocity of its origin and angular velocity, both in the outer frame
        [m/s, rad/s]
    :param time: [s]
    """
    result = np.empty(POSE_SIZE)
    result[:3] = pose[:3] + time * twist[:3]
    rotate_by_vector(pose[3:], time * twist[3:], result[3:])
    return result


def turned(pose: np.ndarray, twist: np.ndarray) -> np.ndarray:
    """
    A twist in the frame in which ``pose`` is given, of one that is given at ``pose``.

    :param twist: linear and angular velocity [m/s, rad/s]; the pose itself rests
    """
    result = np.empty(6)
    rotate(pose[3:], twist[:3], result[:3])
    rotate(pose[3:], twist[3:], result[3:])
    return result


def turn_of_z(way: np.ndarray) -> np.ndarray:
    """Quaternion that turns z to a direction of length 1; to -z half a turn around x."""
    if way[2] < -1.0 + 1e-9:
        return np.array([0.0, 1.0, 0.0, 0.0])
    turn = np.array([1.0 + way[2], -way[1], way[0], 0.0])
    return np.asarray(turn / np.linalg.norm(turn))


def tool_manifold(stiffness_size: int | None, wrench: bool = False) -> Product:
    """R³ × S³, with SPD(3) or SPD(6) if there is a stiffness, and R⁶ if there is a wrench."""
    factors: dict[str, Manifold] = {'position': Euclidean(3), 'orientation': UnitQuaternion()}
    if stiffness_size is not None:
        factors['stiffness'] = SymmetricPositiveDefinite(stiffness_size)
    if wrench:
        factors['wrench'] = Euclidean(6)
    return Product(*factors.values(), names=tuple(factors))
