"""
Task frames: poses of objects, and how points look from them.

A frame is a rigid pose: an object, a fixture, the robot's base. Everywhere inside it is
(x, y, z, qw, qx, qy, qz), one of the plane too: it turns about z.
"""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import math
from typing import Any

import numpy as np

from gdmp_ros.dmp.fusion import (
    MOVES,
    place_rows,
    STAYS,
    TURNS,
    TURNS_MATRIX,
    TURNS_QUATERNION,
    TURNS_ROTATION,
)
from gdmp_ros.errors import DataError, GdmpError, ParameterError
from gdmp_ros.manifolds import (
    Euclidean,
    Manifold,
    SpecialOrthogonal,
    Sphere,
    SymmetricPositiveDefinite,
    UnitQuaternion,
)
from gdmp_ros.manifolds.factors import work_size
from gdmp_ros.manifolds.poses import IDENTITY, POSE_SIZE
from gdmp_ros.util.numeric import numbers

#: Frame that is always there: a skill with one frame only is seen from the base, too.
BASE = 'base'
#: Largest deviation of a rotation from a rotation.
_TOLERANCE = 1e-3
#: Below this no turn about an axis brings an orientation nearer to another one.
_NO_DIRECTION = 1e-9
#: Words in the names of Euclidean factors that a frame turns and does not move.
_DIRECTIONS = ('wrench', 'force', 'torque', 'moment', 'velocity', 'direction')
#: Sizes of the factors of motions in space and in the plane; a factor of R¹ stays as it is.
_SIZES: dict[type[Manifold], dict[int, int]] = {
    Euclidean: {2: 2, 3: 3, 6: 3}, SpecialOrthogonal: {2: 2, 3: 3}, Sphere: {1: 2, 2: 3},
    SymmetricPositiveDefinite: {2: 2, 3: 3, 6: 3}}


@dataclass(frozen=True, eq=False)
class View:
    """
    A motion as seen from a task frame.

    :ivar name: of the frame
    :ivar pose: where the frame was when the motion was shown, (7,)
    :ivar shares: how much the frame matters along the motion, for each factor: coefficients of
        uniform cubic B-splines of s, shape ``(knots, factors)``; those of all frames sum to 1
    :ivar skill: the motion in the frame, a `gdmp_ros.dmp.primitive.Primitive`
    :ivar free_yaw: whether the object is symmetric about its z axis: the turn about it that is
        nearest to what is known already is taken
    :ivar grasped: progress from which the tool holds the object, and the frame rests; None for an
        object that is not grasped
    """

    name: str
    pose: np.ndarray
    shares: np.ndarray
    skill: Any
    free_yaw: bool = False
    grasped: float | None = None

    def __post_init__(self) -> None:
        for name in ('pose', 'shares'):
            array = np.ascontiguousarray(getattr(self, name), dtype=np.float64).copy()
            array.flags.writeable = False
            object.__setattr__(self, name, array)


def check_views(views: Sequence[View], manifold: Manifold) -> None:
    """
    Check the views of a skill, in their order: the start's first, the goal's last.

    :raises ParameterError: if a frame cannot move a factor, or the shares are wrong
    """
    actions_of(manifold)
    names = [view.name for view in views]
    if len(views) < 2 or len(set(names)) < len(names):
        raise ParameterError(f'frames: expected two or more with different names, got {names}')
    shape = views[0].shares.shape
    for view in views:
        if view.skill.manifold != manifold or view.skill.views:
            raise ParameterError(f'frame {view.name}: its motion is not a plain one on '
                                 f'{manifold!r}')
        if (view.shares.shape != shape or len(shape) != 2 or shape[0] < 2
                or shape[1] != len(manifold.factors)):
            raise ParameterError(f'frame {view.name}: shares have the shape {view.shares.shape}, '
                                 f'expected (knots, {len(manifold.factors)}) as the others')
    total = np.sum([view.shares for view in views], axis=0)
    for view in views:
        if view.grasped is not None and not 0.0 <= view.grasped <= 1.0:
            raise ParameterError(f'frame {view.name}: it is grasped at s = {view.grasped!r}, '
                                 'expected 0 to 1')
    if not (np.isfinite(total).all() and np.abs(total - 1.0).max() < 1e-6
            and all((view.shares >= 0.0).all() for view in views)):
        raise ParameterError('frames: the shares of all frames are not at least 0 with the sum 1')


def actions_of(manifold: Manifold) -> tuple[int, np.ndarray]:
    """
    What a rigid motion does with the points of a manifold.

    :returns: dimension of the frames, 2 or 3, and an action of `gdmp_ros.dmp.fusion` for each
        factor
    :raises ParameterError: if a factor, such as joints, is nothing that a rigid motion moves
    """
    names = (manifold.names if len(manifold.factors) > 1 else (manifold.kind,))
    found = [_action(name, factor) for name, factor in zip(names, manifold.factors)]
    dimensions = {dimension for dimension, _ in found if dimension}
    if len(dimensions) != 1:
        raise ParameterError(f'frames: {manifold!r} has nothing that a frame moves'
                             if not dimensions else
                             f'frames: {manifold!r} has parts in the plane and in space')
    return dimensions.pop(), np.array([action for _, action in found], dtype=np.float64)


def _action(name: str, factor: Manifold) -> tuple[int, int]:
    """Dimension of the frames, 0 for any, and the action."""
    if isinstance(factor, UnitQuaternion):
        return 3, TURNS_QUATERNION
    if isinstance(factor, Euclidean) and factor.size == 1:
        return 0, STAYS
    dimension = _SIZES.get(type(factor), {}).get(factor.size)
    if dimension is None or 'joint' in name:
        raise ParameterError(
            f'frames: {name} is on {factor!r}, which no rigid motion moves; expected positions '
            '(R² or R³), orientations, poses, directions, stiffness or a wrench')
    if isinstance(factor, SpecialOrthogonal):
        return dimension, TURNS_ROTATION
    if isinstance(factor, SymmetricPositiveDefinite):
        return dimension, TURNS_MATRIX
    turns = (not isinstance(factor, Euclidean) or factor.size == 6
             or any(word in name for word in _DIRECTIONS))
    return dimension, TURNS if turns else MOVES


def poses_of(name: str, given: Any, dimension: int, count: int | None = None,
             error: type[GdmpError] = ParameterError) -> np.ndarray:
    """
    A frame as a pose, shape ``(7,)``, or as one for each sample, shape ``(count, 7)``.

    :param given: pose (x, y, z, qw, qx, qy, qz), or rotation (d, d) and origin (d,); with an axis
        of the samples in front where ``count`` is given
    :param dimension: 2 or 3
    :raises GdmpError: ``error``, if it is none
    """
    what = f'frame {name}'
    if isinstance(given, (tuple, list)) and len(given) == 2:
        poses = _from_pair(what, given, error)
    else:
        poses = np.array(numbers(what, given, error))
    if poses.shape != (POSE_SIZE,) and (count is None or poses.shape != (count, POSE_SIZE)):
        expected = f'a pose (7,) or a rotation and an origin of {dimension} dimensions'
        if count is not None:
            expected += f', or {count} of them'
        raise error(f'{what}: shape is {poses.shape}, expected {expected}')
    norms = np.linalg.norm(poses[..., 3:], axis=-1, keepdims=True)
    if not (np.isfinite(poses).all() and np.abs(norms - 1.0).max() < _TOLERANCE):
        raise error(f'{what}: it has numbers that are not finite, or a quaternion that is not of '
                    'norm 1')
    poses[..., 3:] /= norms
    if dimension == 2 and np.abs(poses[..., 4:6]).max() > _TOLERANCE:
        raise error(f'{what}: the motion is in the plane, the frame turns about another axis '
                    'than z')
    if poses.ndim == 2:  # the representatives ±q that follow one another
        poses[:, 3:] = UnitQuaternion().continuous(poses[:, 3:])
    return poses


def _from_pair(what: str, given: Sequence[Any], error: type[GdmpError]) -> np.ndarray:
    rotation, origin = (numbers(f'{what}: {part}', item, error)
                        for part, item in zip(('rotation', 'origin'), given))
    d = origin.shape[-1] if origin.ndim else 0
    if d not in (2, 3) or rotation.shape != (*origin.shape, d):
        raise error(f'{what}: rotation has the shape {rotation.shape} and origin {origin.shape}, '
                    'expected (d, d) and (d,) with d = 2 or 3')
    square = rotation @ np.swapaxes(rotation, -1, -2) - np.eye(d)
    if not (np.isfinite(rotation).all() and np.abs(square).max() < _TOLERANCE
            and (np.linalg.det(rotation) > 0.0).all()):
        raise error(f'{what}: {rotation.tolist()!r:.200} is no rotation')
    from scipy.spatial.transform import Rotation
    matrix, place = np.zeros((*origin.shape[:-1], 3, 3)), np.zeros((*origin.shape[:-1], 3))
    matrix[..., 2, 2] = 1.0
    matrix[..., :d, :d], place[..., :d] = rotation, origin
    turned = Rotation.from_matrix(matrix).as_quat(scalar_first=True)
    return np.concatenate([place, turned], axis=-1)


def checked_frames(given: Mapping[str, Any], manifold: Manifold, count: int
                   ) -> dict[str, np.ndarray]:
    """
    The frames of a demonstration; see `poses_of`.

    :raises DataError: if one is none, or the manifold has points that no frame moves
    """
    if not isinstance(given, Mapping):
        raise DataError(f'frames: expected names with poses, got {type(given).__name__}')
    if not given:
        return {}
    try:
        dimension, _ = actions_of(manifold)
    except ParameterError as error:
        raise DataError(str(error)) from None
    return {str(name): poses_of(str(name), frame, dimension, count, DataError)
            for name, frame in given.items()}


def seen_from(manifold: Manifold, poses: np.ndarray, points: np.ndarray) -> np.ndarray:
    """
    Points as they are seen from a frame: ``T⁻¹ y``.

    :param poses: of the frame, shape (7,) or (count, 7)
    :param points: shape ``(count, *point_shape)``
    """
    inverse = np.array(poses)
    inverse[..., 4:] *= -1.0
    w, axis, place = inverse[..., 3:4], inverse[..., 4:], -inverse[..., :3]
    twice = 2.0 * np.cross(axis, place)
    inverse[..., :3] = place + w * twice + np.cross(axis, twice)
    return placed(manifold, inverse, points)


def placed(manifold: Manifold, poses: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points that are given in a frame, in the base: ``T y``; see `seen_from`."""
    dimension, actions = actions_of(manifold)
    flat = np.ascontiguousarray(points.reshape(len(points), -1))
    out = np.empty_like(flat)
    place_rows(manifold.factor_table, actions, dimension,
               np.ascontiguousarray(np.broadcast_to(poses, (len(flat), POSE_SIZE))), flat, out,
               np.empty(work_size(max(factor.size for factor in manifold.factors))))
    return out.reshape(points.shape)


def tool_poses(manifold: Manifold, points: np.ndarray) -> np.ndarray | None:
    """
    Poses of the tool in points, shape (count, 7); None if they have no position.

    Without an orientation the tool is not turned.
    """
    dimension, actions = actions_of(manifold)
    places = np.flatnonzero(actions == MOVES)
    if not len(places):
        return None
    flat = points.reshape(len(points), -1)
    result = np.tile(IDENTITY, (len(flat), 1))
    result[:, :dimension] = flat[:, manifold.point_slices[places[0]]]
    for factor in np.flatnonzero(actions == TURNS_QUATERNION)[:1]:
        result[:, 3:] = flat[:, manifold.point_slices[factor]]
    for factor in np.flatnonzero(actions == TURNS_ROTATION)[:1]:
        turns = flat[:, manifold.point_slices[factor]].reshape(-1, dimension, dimension)
        result[:, 3:] = _from_pair('tool', (turns, result[:, :dimension]), ParameterError)[:, 3:]
    return result


def nearest_turn(pose: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """
    A pose turned about its own z axis, as near to the orientation of another one as possible.

    :param pose: shape (7,), of an object that is symmetric about this axis
    """
    result = np.array(pose)
    w, x, y, z = result[3:]
    turned = np.array([-z, y, -x, w])  # by half a turn
    same, other = float(result[3:] @ reference[3:]), float(turned @ reference[3:])
    length = math.hypot(same, other)
    if length > _NO_DIRECTION:
        result[3:] = (same * result[3:] + other * turned) / length
    return result


def mean_pose(poses: np.ndarray) -> np.ndarray:
    """Mean of poses, shape (count, 7), that are not opposite each other."""
    array = np.array(poses)
    array[:, 3:] *= np.where(array[:, 3:] @ array[0, 3:] < 0.0, -1.0, 1.0)[:, None]
    result = array.mean(axis=0)
    norm = np.linalg.norm(result[3:])
    result[3:] = result[3:] / norm if norm > 1e-6 else array[0, 3:]
    return np.asarray(result)
