"""
MoveIt's objects as volumes, by the fields of their messages.

``moveit_msgs`` need not be installed. Octomaps are left out: `gdmp_ros.ros.scene.cloud` has cells
of its own.
"""
from __future__ import annotations

from collections.abc import Callable, Mapping
import importlib
import importlib.util
from typing import Any, NamedTuple

import numpy as np

from gdmp_ros.errors import DataError, GdmpError
from gdmp_ros.manifolds.poses import compose, inverse, turn_of_z
from gdmp_ros.ros.frames import Waiting
from gdmp_ros.ros.lifecycle import ManagedNode
from gdmp_ros.ros.scene.messages import numbers_of
from gdmp_ros.ros.scene.topics import SceneTopics
from gdmp_ros.scene.points import as_parts, volumes_around
from gdmp_ros.scene.volume import Volume

#: Operations of a ``CollisionObject``.
ADD, REMOVE, APPEND, MOVE = b'\x00', b'\x01', b'\x02', b'\x03'
#: Kinds of a ``shape_msgs/SolidPrimitive``.
_BOX, _SPHERE, _CYLINDER, _CONE = 1, 2, 3, 4


class _Object(NamedTuple):
    """
    An object.

    :ivar shapes: in its own frame
    :ivar pose: of that frame, in the base or in the tool
    :ivar carried: whether the tool carries it
    """

    shapes: tuple[Volume, ...]
    pose: np.ndarray
    carried: bool = False


class PlanningObjects:
    """Objects of MoveIt's topics, as a source of a scene."""

    def __init__(self, scene: SceneTopics, place_of: Callable[[Any], np.ndarray | None],
                 tool_frames: Callable[[], Mapping[str, np.ndarray]],
                 tool_pose: Callable[[], np.ndarray],
                 link_names: Callable[[], Mapping[str, str]], refuse: Callable[[str], None],
                 now: Callable[[], float]):
        """
        Begin without objects.

        :param scene: that has them too
        :param place_of: see `SceneTopics`, as ``tool_frames`` and ``refuse``
        :param tool_pose: gives the present pose of the tool
        :param link_names: gives the names of the arm's links in its description, and in its model
        :param now: gives the time [s]
        """
        self._scene, self._place_of = scene, place_of
        self._tool_frames, self._tool_pose = tool_frames, tool_pose
        self._objects: dict[str, _Object] = {}
        self._waiting = Waiting(now, lambda reason: refuse(f'MoveIt: {reason}'))
        self._link_names, self._allowed = link_names, dict[str, tuple[str, ...]]()

    def listen(self, node: ManagedNode) -> None:
        """Subscribe, where the messages are installed."""
        if importlib.util.find_spec('moveit_msgs') is None:
            return
        kinds = importlib.import_module('moveit_msgs.msg')
        node.add_subscription(kinds.CollisionObject, 'collision_object', self.take_object, 10)
        node.add_subscription(kinds.AttachedCollisionObject, 'attached_collision_object',
                              self.take_attached, 10)
        node.add_subscription(kinds.PlanningScene, 'planning_scene', self.take_scene, 10)
        node.add_report(self.look)

    def take_object(self, message: Any) -> None:
        """Take a ``moveit_msgs/CollisionObject``."""
        self._waiting.add(lambda _: self._take(True, [message], []))

    def take_attached(self, message: Any) -> None:
        """Take a ``moveit_msgs/AttachedCollisionObject``."""
        self._waiting.add(lambda _: self._take(True, [], [message]))

    def take_scene(self, message: Any) -> None:
        """Take a ``moveit_msgs/PlanningScene``, or a difference of one."""
        def take(_: float) -> None:
            matrix, names = message.allowed_collision_matrix, self._link_names()
            before = self._allowed
            if matrix.entry_names:
                self._allowed = {
                    name: tuple(names[other] for other, enabled in zip(
                        matrix.entry_names, row.enabled) if enabled and other in names)
                    for name, row in zip(matrix.entry_names, matrix.entry_values)}
            try:
                self._take(message.is_diff, message.world.collision_objects,
                           message.robot_state.attached_collision_objects)
            except GdmpError:
                self._allowed = before
                raise
        self._waiting.add(take)

    def look(self) -> None:
        """Take what waits for a frame."""
        self._waiting.look()

    def _take(self, difference: bool, free: Any, attached: Any) -> None:
        """:raises GdmpError: if nothing of it is taken"""
        objects = dict(self._objects) if difference else {}
        for given in free:
            self._change(objects, given)
        for given in attached:
            self._change_attached(objects, given)
        self._scene.beside('moveit', [
            volume for name, one in objects.items()
            for volume in _volumes(name, one, self._allowed.get(name, ()))])
        self._objects = objects

    def _change(self, objects: dict[str, _Object], given: Any) -> None:
        known = objects.get(given.id)
        if given.operation == REMOVE:
            # What is attached is no object of the world.
            for name in [given.id] if given.id else list(objects):
                if name in objects and not objects[name].carried:
                    del objects[name]
            return
        if known is not None and known.carried and given.operation in (MOVE, APPEND):
            raise DataError(f'object {given.id!r}: it is attached: detach it first')
        if '#' in given.id:
            raise DataError(f'object {given.id!r}: # is for the parts of an object')
        place = self._place_of(given.header)
        pose = numbers_of(given.pose) if place is None else compose(place, numbers_of(given.pose))
        if given.operation == MOVE:
            if known is None:
                raise DataError(f'object {given.id!r}: not known, it cannot be moved')
            objects[given.id] = known._replace(pose=pose)
            return
        shapes = _shapes(given)
        if given.operation == APPEND and known is not None:
            # Into the frame that the object has already.
            back = compose(inverse(known.pose), pose)
            objects[given.id] = known._replace(shapes=known.shapes + tuple(
                shape.at(compose(back, shape.pose)) for shape in shapes))
            return
        objects[given.id] = _Object(shapes, pose)

    def _change_attached(self, objects: dict[str, _Object], given: Any) -> None:
        name, one = given.object.id, objects.get(given.object.id)
        if given.object.operation == REMOVE:
            # What is let go stays where it is.
            for let_go in [name] if name else list(objects):
                one = objects.get(let_go)
                if one is not None and one.carried:
                    objects[let_go] = _Object(one.shapes, compose(self._tool_pose(), one.pose))
            return
        shapes = _shapes(given.object, may_be_empty=True)
        if not shapes:
            if one is None:
                raise DataError(f'object {name!r}: not known, and without a shape')
            if not one.carried:
                pose = compose(inverse(self._tool_pose()), one.pose)
                one = _Object(one.shapes, pose, True)
            objects[name] = one
            return
        frame, in_tool = given.object.header.frame_id or given.link_name, self._tool_frames()
        if frame not in in_tool:
            raise DataError(f'object {name!r}: attached in the frame {frame!r}, expected a link '
                            f'that moves with the tool: {", ".join(in_tool)}')
        objects[name] = _Object(shapes, compose(in_tool[frame], numbers_of(given.object.pose)),
                                True)


def _volumes(name: str, one: _Object, links: tuple[str, ...]) -> list[Volume]:
    """The volumes of an object, which links may touch."""
    return as_parts(name, [Volume(name, shape.kind, shape.size, compose(one.pose, shape.pose),
                                  allowed=links, carried=one.carried) for shape in one.shapes])


def _shapes(given: Any, may_be_empty: bool = False) -> tuple[Volume, ...]:
    """Shapes of a ``moveit_msgs/CollisionObject``, in its frame."""
    name, found = given.id, list[Volume]()
    for shape, pose in zip(given.primitives, given.primitive_poses):
        found.append(_primitive(name, shape, numbers_of(pose)))
    for mesh, pose in zip(given.meshes, given.mesh_poses):
        points = [(corner.x, corner.y, corner.z) for corner in mesh.vertices]
        found += volumes_around(name, points, [face.vertex_indices for face in mesh.triangles],
                                pose=numbers_of(pose))
    for plane, pose in zip(given.planes, given.plane_poses):
        found.append(_plane(name, plane.coef, numbers_of(pose)))
    if not found and not may_be_empty:
        raise DataError(f'object {name!r}: no shape')
    return tuple(found)


def _primitive(name: str, shape: Any, pose: np.ndarray) -> Volume:
    size = tuple(shape.dimensions)
    expected = {_BOX: 3, _SPHERE: 1, _CYLINDER: 2, _CONE: 2}.get(shape.type)
    if len(size) != expected:
        raise DataError(f'object {name!r}: a primitive of type {shape.type} with {len(size)} '
                        'dimensions, expected BOX, SPHERE, CYLINDER or CONE with theirs')
    if shape.type == _BOX:
        return Volume(name, 'box', size, pose)
    if shape.type == _SPHERE:
        return Volume(name, 'sphere', size, pose)
    return Volume(name, 'capsule', size[::-1], pose)


def _plane(name: str, coefficients: Any, pose: np.ndarray) -> Volume:
    """``a x + b y + c z + d = 0``; solid where that is negative."""
    normal, offset = np.array(coefficients[:3], dtype=float), float(coefficients[3])
    length = float(np.linalg.norm(normal))
    if not length > 0.0:
        raise DataError(f'object {name!r}: a plane without a normal')
    way = normal / length
    place = np.concatenate([-offset / length * way, turn_of_z(way)])
    return Volume(name, 'plane', (), compose(pose, place))
