"""What the tests of single kernels share."""
import numpy as np
from scipy.spatial.transform import Rotation

from gdmp_ros.control.own_body import clearances, KEEP
from gdmp_ros.control.settings import LIMIT_NUMBERS, LimitSettings
from gdmp_ros.control.target import TWIST
from gdmp_ros.manifolds import SymmetricPositiveDefinite
from gdmp_ros.scene import Volume
from gdmp_ros.util.settings import numbers

DRAWS = 50
TWIST_OF = slice(TWIST, TWIST + 6)
#: A pose of a tool.
HERE = np.array([0.4, 0.0, 0.5, 0.0, 1.0, 0.0, 0.0])
#: A stiffness without coupling.
PLAIN = np.diag([400.0] * 3 + [30.0] * 3)
#: Radius of a ball around an arm, and the margin that is kept from it [m].
BALL, MARGIN = 0.05, 0.02


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


def limit_record():
    """The default limits as one record."""
    return numbers(LimitSettings()).view(LIMIT_NUMBERS)[0]


def ball(place, velocity=(0.0, 0.0, 0.0), radius=BALL):
    """A ball around an arm, as numbers for kernels."""
    pose = np.array([*place, 1.0, 0.0, 0.0, 0.0])
    return Volume('ball', 'sphere', (radius,), pose,
                  twist=np.array([*velocity, 0.0, 0.0, 0.0])).packed(MARGIN, {})


def too_near(arm):
    """A posture in which the hand is half of the distance from the arm that it keeps."""
    folded = np.array([0.0, -0.9, 0.0, -2.95, 0.0, 2.2, 0.785])
    while clearances(arm.chain, arm.shape, folded).min() > 0.5 * KEEP:
        folded[5] -= 0.005
    return folded
