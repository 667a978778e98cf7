"""What all drawings have in common (figures, pages, studio, RViz): colours and ellipsoids."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from gdmp_ros.manifolds.manifold import Manifold
from gdmp_ros.playback.prediction import LIKELY

INK = ('#1b4f8a', '#c1440e', '#2e7d32', '#6a3d9a', '#444444', '#b8860b')
#: Length of the longest half-axis of all ellipsoids of a stiffness [m].
ELLIPSOID_M = 0.035
#: Ellipsoids along a path.
ELLIPSOIDS = 12
#: Shortest half-axis that is drawn [m].
_THIN_M = 5e-5


class Ellipsoids(NamedTuple):
    """
    Ellipsoids along a path.

    :ivar positions: of the centres [m], shape ``(T, 3)``
    :ivar matrices: symmetric; the half-axes are their eigenvalues [m], shape ``(T, 3, 3)``
    """

    positions: np.ndarray
    matrices: np.ndarray

    def oriented(self) -> tuple[np.ndarray, np.ndarray]:
        """Half-axes [m], shape ``(T, 3)``, and the rotations (w, x, y, z) that they belong to."""
        lengths, axes = np.linalg.eigh(self.matrices)
        axes[:, :, 0] *= np.sign(np.linalg.det(axes))[:, None]
        rotations = np.roll(Rotation.from_matrix(axes).as_quat(), 1, axis=-1)
        return np.maximum(lengths, _THIN_M), rotations


def of_stiffness(positions: np.ndarray, matrices: np.ndarray) -> tuple[Ellipsoids, float]:
    """
    Ellipsoids of a stiffness at equal distances along a path; the longest axis is the stiffest.

    :param positions: shape ``(T, 3)`` [m]
    :param matrices: shape ``(T, 3, 3)`` [N/m]
    :returns: the ellipsoids, and the largest stiffness, which is drawn `ELLIPSOID_M` long [N/m]
    """
    at = evenly(positions, ELLIPSOIDS)
    largest = float(np.linalg.eigvalsh(matrices[at]).max())
    return Ellipsoids(positions[at], matrices[at] * ELLIPSOID_M / largest), largest


def of_takes(positions: np.ndarray, covariances: np.ndarray) -> Ellipsoids:
    """
    Ellipsoids in which 95 % of takes lie.

    :param covariances: shape ``(T, 3, 3)`` [m²]
    """
    values, axes = np.linalg.eigh(covariances)
    roots = np.einsum('tij,tj,tkj->tik', axes, np.sqrt(np.maximum(values, 0.0)), axes)
    return Ellipsoids(positions, LIKELY * roots)


def stiffness_of(manifold: Manifold, points: np.ndarray) -> np.ndarray | None:
    """
    Translational stiffness of points of a tool [N/m], shape ``(T, 3, 3)``; None without one.

    :param points: shape ``(T, *point_shape)``
    """
    if 'stiffness' not in manifold.names:
        return None
    at = list(manifold.names).index('stiffness')
    flat = points.reshape(len(points), -1)[:, manifold.point_slices[at]]
    return flat.reshape(-1, *manifold.factors[at].point_shape)[:, :3, :3].copy()


def evenly(positions: np.ndarray, count: int) -> np.ndarray:
    """
    Samples at equal distances along a path.

    :param positions: shape ``(T, 3)``
    :returns: indices, shape ``(count,)``
    """
    steps = np.linalg.norm(np.diff(positions, axis=0, prepend=positions[:1]), axis=1)
    passed = np.cumsum(steps)
    at = np.searchsorted(passed, np.linspace(0.0, passed[-1], count))
    return np.minimum(at, len(positions) - 1)
