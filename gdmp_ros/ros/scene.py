"""The topic ``~/scene``: markers as volumes around an arm, with DELETE and lifetime."""
from __future__ import annotations

from collections.abc import Callable
import math
from typing import Any

import numpy as np
from visualization_msgs.msg import Marker, MarkerArray

from gdmp_ros.errors import DataError, GdmpError
from gdmp_ros.manifolds.poses import compose
from gdmp_ros.manifolds.quaternion import rotation_between
from gdmp_ros.realtime.loop import NS
from gdmp_ros.ros.frames import FrameError
from gdmp_ros.ros.lifecycle import ManagedNode
from gdmp_ros.ros.parameters import Spec
from gdmp_ros.scene.scene import read_scene, Scene
from gdmp_ros.scene.volume import box_around, DEFAULT_MARGIN, Volume

#: A volume that comes again within this time moves as it has moved since [s].
AGAIN_S = 0.5
#: Slower ones rest: what a camera sees shakes [m/s, rad/s].
RESTS_M_S, RESTS_RAD_S = 0.01, 0.1
SPECS = (
    Spec('scene_file', '', 'what is around the arm: a scene file (docs/obstacles.md), beside '
         '~/scene', changes='configure'),
    Spec('scene_margin', DEFAULT_MARGIN, 'distance that is kept from what is around the arm; a '
         'scene file has its own', 'm', 0.0, 1.0, changes='configure'),
)
#: Kinds of markers that are lists of points.
_POINTS = (Marker.POINTS, Marker.LINE_STRIP, Marker.LINE_LIST, Marker.TRIANGLE_LIST,
           Marker.SPHERE_LIST, Marker.CUBE_LIST)


def volume_of(marker: Marker) -> Volume:
    """
    Volume of a marker, in the frame of the marker; its name is its text, or namespace and number.

    :raises DataError: if it is none
    """
    name = marker.text or f'{marker.ns}/{marker.id}'
    place, turn, scale = marker.pose.position, marker.pose.orientation, marker.scale
    pose = np.array([place.x, place.y, place.z, turn.w, turn.x, turn.y, turn.z])
    size = scale.x, scale.y, scale.z
    if not np.isfinite([*pose, *size]).all():
        raise DataError(f'marker {name!r}: not finite')
    if not pose[3:].any():
        pose[3] = 1.0  # as viewers take it
    if marker.type == Marker.CUBE:
        return Volume(name, 'box', size, pose)
    if marker.type == Marker.SPHERE:
        return Volume(name, 'sphere', (0.5 * max(size),), pose)
    if marker.type == Marker.CYLINDER:
        return Volume(name, 'capsule', (0.5 * max(size[:2]), size[2]), pose)
    if marker.type in _POINTS:
        points = np.array([(point.x, point.y, point.z) for point in marker.points])
        box = box_around(name, points)
        thick = max(size) if marker.type in (Marker.SPHERE_LIST, Marker.CUBE_LIST) else 0.0
        return Volume(name, 'box', tuple(edge + thick for edge in box.size),
                      compose(pose, box.pose))
    raise DataError(f'marker {name!r}: type {marker.type} is no volume; expected CUBE, SPHERE, '
                    'CYLINDER, or a list of points or triangles')


def only_in(frame: str) -> Callable[[Any], None]:
    """What gives no pose of any frame but one."""
    def place_of(header: Any) -> None:
        if header.frame_id != frame:
            raise FrameError(f'the frame is {header.frame_id!r}, expected {frame!r}')
    return place_of


class SceneTopic:
    """Keeps a scene from a file and from ``~/scene``, in the frame of the base."""

    def __init__(self, node: ManagedNode, place_of: Callable[[Any], np.ndarray | None],
                 parameters: Any, use: Callable[[Scene], None], refuse: Callable[[str], None]):
        """
        Read the file, and subscribe.

        :param place_of: gives the pose of the frame of a header in the base, None for the base
            itself; raises a `FrameError`
        :param parameters: with `SPECS`
        :param use: called with the scene when it has changed; raises a `GdmpError` to refuse it
        :param refuse: called with the reason
        :raises DataError: if the file cannot be read
        """
        self._node, self._place_of, self._use, self._refuse = node, place_of, use, refuse
        file = parameters.scene_file
        self.scene = read_scene(file) if file else Scene(margin=parameters.scene_margin)
        self._ends: dict[str, float] = {}
        self._seen: dict[str, float] = {}
        if len(self.scene):
            use(self.scene)
        node.add_subscription(MarkerArray, '~/scene', self._on_markers, 10)
        node.add_report(self._forget)

    def _on_markers(self, message: MarkerArray) -> None:
        scene, now = self.scene.copy(), self._node.clock.now() / NS
        try:
            for marker in message.markers:
                self._take(scene, marker, now)
            self._use(scene)
        except GdmpError as error:
            self._refuse(f'~/scene: {error}')
            return
        self.scene = scene

    def _take(self, scene: Scene, marker: Marker, now: float) -> None:
        if marker.action == Marker.DELETEALL:
            scene.clear()
            return
        name = marker.text or f'{marker.ns}/{marker.id}'
        if marker.action == Marker.DELETE:
            if name in scene:
                scene.remove(name)
            return
        volume = volume_of(marker)
        place = self._place_of(marker.header)
        pose = volume.pose if place is None else compose(place, volume.pose)
        scene.put(volume.at(pose, self._twist(scene, volume.name, pose, now)))
        life = marker.lifetime.sec + 1e-9 * marker.lifetime.nanosec
        self._seen[name], self._ends[name] = now, now + life if life > 0.0 else math.inf

    def _twist(self, scene: Scene, name: str, pose: np.ndarray, now: float) -> np.ndarray:
        """How a volume moves that has come before."""
        twist, passed = np.zeros(6), now - self._seen.get(name, -math.inf)
        if name not in scene or not 1e-3 < passed < AGAIN_S:
            return twist
        last = scene[name].pose
        twist[:3] = (pose[:3] - last[:3]) / passed
        rotation_between(last[3:], pose[3:], twist[3:])
        twist[3:] /= passed
        for part, least in ((slice(0, 3), RESTS_M_S), (slice(3, 6), RESTS_RAD_S)):
            if np.linalg.norm(twist[part]) < least:
                twist[part] = 0.0
        return twist

    def _forget(self) -> None:
        """Remove what has outlived its lifetime."""
        now = self._node.clock.now() / NS
        gone = [name for name, ends in self._ends.items() if ends < now]
        if not gone:
            return
        scene = self.scene.copy()
        for name in gone:
            del self._ends[name]
            if name in scene:
                scene.remove(name)
        self._use(scene)
        self.scene = scene


def markers_of(scene: Scene, frame: str, stamp: Any) -> MarkerArray:
    """
    Markers of a scene, for ``~/scene`` and for viewers; planes are left out.

    :param frame: ``frame_id`` of the base
    """
    result = MarkerArray()
    for number, volume in enumerate(scene):
        if volume.kind == 'plane':
            continue
        marker = Marker(ns='scene', id=number, text=volume.name)
        marker.header.frame_id, marker.header.stamp = frame, stamp
        place, turn = marker.pose.position, marker.pose.orientation
        place.x, place.y, place.z, turn.w, turn.x, turn.y, turn.z = volume.pose.tolist()
        size = {'sphere': (2.0 * volume.radius,) * 3, 'box': volume.size,
                'capsule': (2.0 * volume.radius, 2.0 * volume.radius, volume.size[-1])}
        marker.type = {'sphere': Marker.SPHERE, 'box': Marker.CUBE,
                       'capsule': Marker.CYLINDER}[volume.kind]
        marker.scale.x, marker.scale.y, marker.scale.z = size[volume.kind]
        colour = marker.color
        colour.r, colour.g, colour.b, colour.a = 0.85, 0.45, 0.2, 0.7
        result.markers.append(marker)
    return result
