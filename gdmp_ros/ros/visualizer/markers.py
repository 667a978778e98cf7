"""Markers of a motion: paths, ellipsoids, frames, the arm."""
from __future__ import annotations

from collections.abc import Sequence

from geometry_msgs.msg import Point
import numpy as np
from scipy.spatial.transform import Rotation
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker

from gdmp_ros.manifolds.poses import IDENTITY
from gdmp_ros.ros.messages import set_pose
from gdmp_ros.sim.urdf import Shape
from gdmp_ros.view.style import Ellipsoids, of_takes

_KINDS = {'sphere': Marker.SPHERE, 'box': Marker.CUBE, 'cylinder': Marker.CYLINDER}
#: Red, green, blue, opacity. Blue and orange are distinct with colour blindness too.
PAST, PREDICTED, GOAL = (0.2, 0.2, 0.25, 0.9), (0.0, 0.45, 0.7, 0.9), (0.9, 0.4, 0.0, 0.9)
STIFFNESS, MANIPULABILITY = (0.0, 0.62, 0.45, 0.35), (0.8, 0.47, 0.65, 0.3)
TUBE = (0.35, 0.7, 0.9, 0.12)
_AXES = ((0.85, 0.15, 0.1, 1.0), (0.15, 0.65, 0.2, 1.0), (0.15, 0.3, 0.85, 1.0))
#: Width of a line [m].
_WIDTH = 0.004


def _marker(space: str, number: int, kind: int, colour: Sequence[float] | np.ndarray,
            pose: np.ndarray = IDENTITY,
            size: Sequence[float] | np.ndarray = (1.0, 1.0, 1.0)) -> Marker:
    result = Marker(ns=space, id=number, type=kind, action=Marker.ADD)
    set_pose(result.pose, pose)
    result.scale.x, result.scale.y, result.scale.z = (float(value) for value in size)
    result.color = ColorRGBA(**{key: float(value) for key, value in zip('rgba', colour)})
    return result


def line(space: str, positions: np.ndarray, colour: Sequence[float]) -> Marker:
    """Line through positions [m], shape ``(T, 3)``."""
    result = _marker(space, 0, Marker.LINE_STRIP, colour, size=(_WIDTH, 0.0, 0.0))
    result.points = [Point(x=float(x), y=float(y), z=float(z)) for x, y, z in positions]
    return result


def tube(space: str, positions: np.ndarray, covariances: np.ndarray) -> list[Marker]:
    """
    Ellipsoids in which 95 % of positions lie.

    :param covariances: shape ``(T, 3, 3)`` [m²]
    """
    return _ellipsoids(space, of_takes(positions, covariances), TUBE)


def ellipsoid(space: str, position: np.ndarray, matrix: np.ndarray,
              colour: Sequence[float]) -> Marker:
    """
    Ellipsoid of a symmetric positive definite matrix.

    :param matrix: shape ``(3, 3)``; the half-axes are its eigenvalues [m]
    """
    return _ellipsoids(space, Ellipsoids(position[None], matrix[None]), colour)[0]


def _ellipsoids(space: str, drawn: Ellipsoids, colour: Sequence[float]) -> list[Marker]:
    return [_marker(space, number, Marker.SPHERE, colour, np.concatenate([position, rotation]),
                    2.0 * lengths)
            for number, (position, lengths, rotation) in enumerate(
                zip(drawn.positions, *drawn.oriented()))]


def frame(space: str, pose: np.ndarray, length: float) -> list[Marker]:
    """Three arrows along the axes of a pose (x, y, z, qw, qx, qy, qz)."""
    rotation = Rotation.from_quat(np.roll(pose[3:], -1)).as_matrix()
    result = []
    for i, colour in enumerate(_AXES):
        arrow = _marker(space, i, Marker.ARROW, colour,
                        size=(0.08 * length, 0.16 * length, 0.25 * length))
        tip = pose[:3] + length * rotation[:, i]
        arrow.points = [Point(x=float(p[0]), y=float(p[1]), z=float(p[2]))
                        for p in (pose[:3], tip)]
        result.append(arrow)
    return result


def body(space: str, drawn: Sequence[Shape], poses: Sequence[np.ndarray]) -> list[Marker]:
    """Shapes at poses."""
    return [_marker(space, i, _KINDS[shape.kind], shape.colour, pose, shape.size)
            for i, (shape, pose) in enumerate(zip(drawn, poses))]


def sphere(colour: Sequence[float], radius: float) -> Marker:
    """Sphere at the origin, the body of a handle."""
    return _marker('', 0, Marker.SPHERE, colour, size=[2.0 * radius] * 3)
