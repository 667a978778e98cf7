"""
A target: what the impedance law follows, as one flat array.

Pose (x, y, z, qw, qx, qy, qz), twist and acceleration (linear over angular, base frame), 6×6
stiffness (row by row), damping ratio. Optional: wrench that the tool is to exert, and the rate at
which the measured wrench is corrected.
"""
from __future__ import annotations

import numpy as np

from gdmp_ros.errors import ParameterError
from gdmp_ros.kernels import kernel, local_matrix, local_numbers
from gdmp_ros.manifolds.linalg import copy_into
from gdmp_ros.manifolds.quaternion import conjugate_multiply, rotate, rotate_by_vector

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
    full = np.zeros(TARGET_SIZE)
    full[:len(numbers)] = numbers
    return full


@kernel
def extrapolate_pose(target, seconds, pose):
    """Write the pose of a target after moving with its own twist; ``pose`` may be part of it."""
    rotation = local_numbers(3)
    for i in range(3):
        pose[i] = target[POSE + i] + seconds * target[TWIST + i]
        rotation[i] = seconds * target[TWIST + 3 + i]
    rotate_by_vector(target[POSE + 3:POSE + 7], rotation, pose[3:7])


@kernel
def target_in_frame(target, frame, out):
    """
    Write a target as it is in another frame.

    :param frame: pose of that frame in the one of the target
    """
    axes, turn, inverse = local_matrix(3, 3), local_matrix(3, 3), local_numbers(4)
    for i in range(4):
        inverse[i] = -frame[3 + i] if i > 0 else frame[3]
    copy_into(target, out)
    for i in range(3):
        out[POSE + i] -= frame[i]
        for j in range(3):
            axes[i, j] = 1.0 if i == j else 0.0
        # Row i: axis i of the target's frame in the other one.
        rotate(inverse, axes[i], turn[i])
    for first in (POSE, TWIST, TWIST + 3, ACCELERATION, ACCELERATION + 3, WRENCH, WRENCH + 3):
        rotate(inverse, out[first:first + 3], out[first:first + 3])
    conjugate_multiply(frame[3:], target[POSE + 3:POSE + 7], out[POSE + 3:POSE + 7])
    for row in range(6):
        for column in range(6):
            value = 0.0
            for i in range(3):
                for j in range(3):
                    value += (turn[i, row % 3] * turn[j, column % 3] * target[
                        STIFFNESS + 6 * (row - row % 3 + i) + column - column % 3 + j])
            out[STIFFNESS + 6 * row + column] = value
