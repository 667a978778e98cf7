"""What the tests of kernels against their formulas share."""

import numpy as np
from scipy.spatial.transform import Rotation

from gdmp_ros.control.target import (
    TWIST as TARGET_TWIST,
)
from gdmp_ros.manifolds import SymmetricPositiveDefinite

DRAWS = 50
TWIST_OF = slice(TARGET_TWIST, TARGET_TWIST + 6)


def pose_of(rng):
    """A random pose (x, y, z, qw, qx, qy, qz)."""
    turn = Rotation.random(random_state=int(rng.integers(1 << 30)))
    return np.concatenate([rng.normal(size=3), np.roll(turn.as_quat(), 1)])


def turn_of(pose):
    return Rotation.from_quat(np.roll(pose[3:], -1)).as_matrix()


def coupled(rng):
    """A stiffness with coupling of position and rotation."""
    scale = np.diag([20.0] * 3 + [5.0] * 3)
    return scale @ SymmetricPositiveDefinite(6).random_point(rng) @ scale


def within(v, limit):
    """A vector, shortened to a limit."""
    return v * min(1.0, limit / max(np.linalg.norm(v), 1e-300))


def record(dtype, **fields):
    """One record as a kernel takes it; what is not given is 0."""
    result = np.zeros(1, dtype=dtype)[0]
    for name, value in fields.items():
        result[name] = value
    return result
