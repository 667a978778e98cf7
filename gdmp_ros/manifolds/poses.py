"""Poses (x, y, z, qw, qx, qy, qz) in the frames of others."""
from __future__ import annotations

import numpy as np

from gdmp_ros.manifolds.quaternion import multiply, rotate

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
