"""
Public data sets: the 2D letters (``.mat`` files) and RoboTasks9 (``.npy`` files).

RoboTasks9 are real kinesthetic demonstrations of a Franka, several takes of each task: takes ×
samples × (x, y, z [cm], qw, qx, qy, qz), without times.

Source of RoboTasks9: Auddy, Hollenstein, Saveriano, Rodriguez-Sanchez, Piater 2023.
"""
from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.io import loadmat

from gdmp_ros.control.manipulability import manipulability as jacobian_ellipsoid
from gdmp_ros.data.lasa import riemannian, Stroke
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.errors import DataError
from gdmp_ros.manifolds.poses import tool_manifold
from gdmp_ros.manifolds.spd import SymmetricPositiveDefinite

#: Duration that is assumed of RoboTasks9 [s], and metres of its unit.
TASK_S, _METRES = 5.0, 0.01
#: Where the letters are public.
ADDRESS = ('https://gitlab.idiap.ch/rli/pbdlib-matlab (folder data/2Dletters: A.mat to Z.mat), or '
           'https://gitlab.com/geometry-aware/ga-dmp')
#: Spacing of the samples [s]; the files' velocities are differences divided by it.
DT_S = 0.01
#: Positions are divided by this before they are mapped to a manifold.
SCALE = 8.0
#: Smallest and largest distance of a letter from the base, relative to the reach.
NEAREST, FURTHEST = 0.3, 0.9
#: Damping of the inverse Jacobian [m²].
_DAMPING = 1e-6
#: Share of the distance to the rest posture that one step removes.
_POSTURE_GAIN = 0.01
POSTURE = np.array([-0.6, 1.1, 0.7])


class PlanarArm:
    """Serial arm with revolute joints and its base at the origin; angles are relative."""

    def __init__(self, lengths: Sequence[float]):
        """:param lengths: of the links [m]"""
        self.lengths = np.asarray(lengths, dtype=float)

    def position(self, q: np.ndarray) -> np.ndarray:
        """Position of the tip, shape ``(2,)`` [m]."""
        return np.asarray(self.joints(q)[-1])

    def joints(self, q: np.ndarray) -> np.ndarray:
        """Positions of base, joints and tip, shape ``(n + 1, 2)`` [m]."""
        angles = np.cumsum(q)
        links = self.lengths[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
        return np.vstack([np.zeros(2), np.cumsum(links, axis=0)])

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """Jacobian of the tip, shape ``(2, n)`` [m/rad]."""
        points = self.joints(q)
        to_tip = points[-1] - points[:-1]
        return np.array([-to_tip[:, 1], to_tip[:, 0]])

    def follow(self, path: np.ndarray, q: np.ndarray, substeps: int = 4) -> np.ndarray:
        """
        Joint angles that keep the tip on a path, close to the initial posture.

        :param path: shape ``(T, 2)`` [m]
        :param q: initial angles; the tip is moved to the path first
        :returns: shape ``(T, n)``
        """
        rest, result = np.array(q, dtype=float), []
        q = self._move_to(path[0], rest.copy(), rest, 200)
        for point in path:
            q = self._move_to(point, q, rest, substeps)
            result.append(q)
        return np.array(result)

    def _move_to(self, point: np.ndarray, q: np.ndarray, rest: np.ndarray, steps: int
                 ) -> np.ndarray:
        for _ in range(steps):
            jacobian = self.jacobian(q)
            inverse = jacobian.T @ np.linalg.inv(jacobian @ jacobian.T + _DAMPING * np.eye(2))
            posture = _POSTURE_GAIN * (rest - q)
            error = point - self.position(q)
            q = q + posture + inverse @ (error - jacobian @ posture)
        return q


#: The arm whose manipulability is computed, and its initial posture [m, rad].
ARM = PlanarArm([1.0 / 3.0] * 3)


def files(folder: Path) -> list[Path]:
    """
    Files of the letters found in a folder, in order.

    :raises DataError: if there is none
    """
    result = sorted(path for path in folder.glob('*.mat') if len(path.stem) == 1)
    if not result:
        raise DataError(f'{folder}: no letters there (A.mat to Z.mat); they are public: {ADDRESS}')
    return result


def strokes(path: Path) -> list[Stroke]:
    """
    All demonstrations of a letter.

    :raises DataError: if the file is not one of the data set
    """
    try:
        demos = loadmat(str(path))['demos'].reshape(-1)
        positions = [np.array(d['pos'][0, 0], dtype=float) for d in demos]
    except Exception as error:  # a damaged file fails in scipy, zlib or struct, in many ways
        raise DataError(f'{path}: not a letter of the data set (demos{{n}}.pos is expected): '
                        f'{error}') from None
    if not positions:
        raise DataError(f'{path}: the file has no demonstrations')
    result = []
    for number, position in enumerate(positions, 1):
        if position.ndim != 2 or position.shape[0] != 2 or position.shape[1] < 3:
            raise DataError(f'{path}: demonstration {number} has shape {position.shape}, '
                            'expected 2 × samples')
        if not np.isfinite(position).all() or not np.ptp(position, axis=1).any():
            raise DataError(f'{path}: demonstration {number} has NaN or infinite positions, or '
                            'never moves')
        result.append(Stroke(DT_S * np.arange(position.shape[1]), position.T))
    return result


def on_manifold(stroke: Stroke, mapping: str) -> Demonstration:
    """
    Map a stroke to a manifold as LASA strokes are; on SPD(2) to the manipulability of an arm.

    :param mapping: one of `gdmp_ros.data.lasa.MAPPINGS`
    """
    if mapping == 'SPD2':
        return manipulability(stroke)
    return riemannian(stroke, mapping, SCALE)


def manipulability(stroke: Stroke) -> Demonstration:
    """
    ``J Jᵀ`` of `ARM` while its tip follows the stroke, [GDMP] section 5.

    At its base the arm is singular: the letter is moved in front of it, between `NEAREST` and
    `FURTHEST` of its reach.
    """
    low, high = stroke.positions.min(axis=0), stroke.positions.max(axis=0)
    centred = stroke.positions - 0.5 * (low + high)
    radius = 0.5 * (FURTHEST - NEAREST)
    path = centred * (radius / np.linalg.norm(centred, axis=1).max())
    path[:, 0] += NEAREST + radius
    matrices = []
    for q in ARM.follow(path, POSTURE):
        matrices.append(jacobian_ellipsoid(ARM.jacobian(q)))
    return Demonstration(stroke.times, np.array(matrices), SymmetricPositiveDefinite(2))


def task_files(folder: Path) -> list[Path]:
    """
    Files of the tasks in a folder.

    :raises DataError: if there are none
    """
    result = sorted(folder.glob('*.npy'))
    if not result:
        raise DataError(f'{folder}: no task of RoboTasks9 (.npy)')
    return result


def task_takes(path: Path) -> list[Demonstration]:
    """
    Takes of a task on R³ × S³, with consistent signs.

    :raises DataError: if the file is no array of takes
    """
    try:
        array = np.load(path, allow_pickle=False)
    except (OSError, ValueError) as error:
        raise DataError(f'{path}: cannot be read: {error}') from None
    if array.ndim != 3 or array.shape[2] != 7 or array.shape[1] < 3:
        raise DataError(f'{path}: shape is {array.shape}, expected (takes, samples, 7)')
    points = np.array(array, dtype=np.float64)
    points[:, :, :3] *= _METRES
    points[:, :, 3:] /= np.linalg.norm(points[:, :, 3:], axis=2, keepdims=True)
    times = np.linspace(0.0, TASK_S, array.shape[1])
    demos = [Demonstration(times, point, tool_manifold(None)) for point in points]
    return [demo.aligned(demos[0].points[0]) for demo in demos]
