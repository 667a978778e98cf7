"""
A target of the joints, as one flat array.

Positions, velocities and stiffness of n joints, then the damping ratio: 3 n + 1 numbers.
"""
from __future__ import annotations

import numpy as np

from gdmp_ros.kernels import jitable

#: Smallest and largest stiffness of a joint [Nm/rad].
LEAST_STIFFNESS, MOST_STIFFNESS = 1.0, 5000.0


def joint_target_size(joints: int) -> int:
    """Numbers of a target for ``joints`` joints."""
    return 3 * joints + 1


@jitable
def joints_of(target: np.ndarray) -> int:
    """Number of joints of a target."""
    return (target.size - 1) // 3


def resting_joints(position: np.ndarray, stiffness: np.ndarray, damping_ratio: float = 0.7
                   ) -> np.ndarray:
    """
    Target at rest.

    :param position: [rad], shape (n,)
    :param stiffness: [Nm/rad], shape (n,)
    :returns: shape ``(3 n + 1,)``
    """
    return np.concatenate([position, np.zeros_like(position), stiffness, [damping_ratio]])
