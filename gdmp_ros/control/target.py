"""
A target: what the impedance law follows, as one flat array.

Pose (x, y, z, qw, qx, qy, qz), twist and acceleration (linear over angular, base frame), 6×6
stiffness (row by row), damping ratio. Optional: wrench that the tool is to exert, and the rate at
which the measured wrench is corrected.
"""
from __future__ import annotations

import numpy as np

from gdmp_ros.errors import ParameterError
from gdmp_ros.kernels import kernel
from gdmp_ros.manifolds.quaternion import rotate_by_vector

# Index of the first number of each part.
POSE, TWIST, ACCELERATION, STIFFNESS, DAMPING_RATIO, WRENCH, WRENCH_GAIN = (
    0, 7, 13, 19, 55, 56, 62)
TARGET_SIZE = 68
#: Numbers of a target without the optional parts.
REQUIRED_SIZE = 56
#: Stiffness before the first reference [N/m, Nm/rad].
HOLD_STIFFNESS = np.diag([400.0, 400.0, 400.0, 30.0, 30.0, 30.0])


def resting_target(pose: np.ndarray, stiffness: np.ndarray = HOLD_STIFFNESS,
                   damping_ratio: float = 0.7) -> np.ndarray:
    """
    Target at rest.

    :param pose: (x, y, z, qw, qx, qy, qz)
    :param stiffness: 6×6 [N/m, Nm/rad]
    :returns: shape ``(TARGET_SIZE,)``
    """
    target = np.zeros(TARGET_SIZE)
    target[POSE:POSE + 7] = pose
    target[STIFFNESS:STIFFNESS + 36] = np.asarray(stiffness).reshape(-1)
    target[DAMPING_RATIO] = damping_ratio
    return target


def whole_target(numbers: np.ndarray) -> np.ndarray:
    """
    Copy of a target; optional parts that are missing are 0.

    :param numbers: `REQUIRED_SIZE` or `TARGET_SIZE` numbers
    :raises ParameterError: with another number of them
    """
    if np.shape(numbers) not in ((REQUIRED_SIZE,), (TARGET_SIZE,)):
        raise ParameterError(f'a target has shape {np.shape(numbers)}, expected {REQUIRED_SIZE} '
                             f'or {TARGET_SIZE} numbers')
    whole = np.zeros(TARGET_SIZE)
    whole[:len(numbers)] = numbers
    return whole


@kernel
def extrapolate_pose(target, seconds, pose):
    """Write the pose of a target after moving with its own twist; ``pose`` may be part of it."""
    rotation = np.empty(3)
    for i in range(3):
        pose[i] = target[POSE + i] + seconds * target[TWIST + i]
        rotation[i] = seconds * target[TWIST + 3 + i]
    rotate_by_vector(target[POSE + 3:POSE + 7], rotation, pose[3:7])
