"""The topics of a scene: what others tell of the surroundings of an arm."""
from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
import math
from typing import Any

import numpy as np
from visualization_msgs.msg import Marker, MarkerArray

from gdmp_ros.control.surroundings import LAST_SEEN_S
from gdmp_ros.errors import DataError, GdmpError
from gdmp_ros.manifolds.poses import compose, moved_on
from gdmp_ros.manifolds.quaternion import rotation_between
from gdmp_ros.realtime.loop import NS
from gdmp_ros.ros.frames import Waiting
from gdmp_ros.ros.lifecycle import ManagedNode
from gdmp_ros.ros.parameters import Spec
from gdmp_ros.ros.scene.messages import marker_name, volumes_of
from gdmp_ros.scene.scene import read_scene, Scene
from gdmp_ros.scene.volume import DEFAULT_MARGIN, Volume

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


def _by_now(volume: Volume, passed: float) -> Volume:
    """A volume where it is by now [s]; one that was not told again stands."""
    if not volume.twist.any():
        return volume
    moved = moved_on(volume.pose, volume.twist, min(passed, LAST_SEEN_S))
    return replace(volume, pose=moved,
                   twist=volume.twist if passed < LAST_SEEN_S else np.zeros(6))


class SceneTopics:
    """
    Keeps a scene from a file, from ``~/scene``, and from other sources.

    :ivar scene: in the frame of the base
    """

    def __init__(self, node: ManagedNode, place_of: Callable[[Any], np.ndarray | None],
                 parameters: Any, use: Callable[[Scene], None], refuse: Callable[[str], None],
                 tool_frames: Callable[[], Mapping[str, np.ndarray]]):
        """
        Read the file, and subscribe.

        :param place_of: gives the pose of the frame of a header in the base, None for the base
            itself; raises a `FrameError`
        :param parameters: with `SPECS`
        :param use: called with the scene when it has changed; raises a `GdmpError` to refuse it
        :param refuse: called with the reason
        :param tool_frames: gives `gdmp_ros.sim.tool_shape.tool_frames`
        :raises DataError: if the file cannot be read
        """
        self._node, self._place_of, self._use = node, place_of, use
        self._tool_frames = tool_frames
        file = parameters.scene_file
        self._told = read_scene(file) if file else Scene(margin=parameters.scene_margin)
        self.scene = self._told.copy()
        # Of each other source its volumes, and when they were told.
        self._beside: dict[str, tuple[list[Volume], float]] = {}
        self._ends: dict[str, float] = {}
        self._seen: dict[str, float] = {}
        # Names of markers by namespace and number: DELETE need not repeat the text.
        self._names: dict[tuple[str, int], str] = {}
        self._waiting = Waiting(lambda: node.clock.now() / NS,
                                lambda reason: refuse(f'~/scene: {reason}'))
        if len(self.scene):
            use(self.scene)
        node.add_subscription(MarkerArray, '~/scene', self._on_markers, 10)
        node.add_report(self._forget)

    def beside(self, source: str, volumes: Iterable[Volume]) -> None:
        """
        Use these volumes of another source, instead of its last ones.

        :raises GdmpError: if they are refused
        """
        self._change(self._told, {**self._beside, source: (list(volumes),
                                                           self._node.clock.now() / NS)})

    def _change(self, told: Scene, beside: dict[str, tuple[list[Volume], float]] | None = None
                ) -> None:
        scene, beside = told.copy(), self._beside if beside is None else beside
        now = self._node.clock.now() / NS
        for volume in told:
            scene.put(_by_now(volume, now - self._seen.get(volume.name, now)))
        for volumes, came in beside.values():
            for volume in volumes:
                if volume.name not in scene:
                    scene.put(_by_now(volume, now - came))
        self._use(scene)
        self.scene, self._told, self._beside = scene, told, beside

    def _on_markers(self, message: MarkerArray) -> None:
        self._waiting.add(lambda came: self._use_markers(message, came))

    def _use_markers(self, message: MarkerArray, came: float) -> None:
        """:raises GdmpError: if they are refused; nothing has changed then"""
        told, before = self._told.copy(), (dict(self._seen), dict(self._ends), dict(self._names))
        try:
            for marker in message.markers:
                self._take(told, marker, came)
            self._change(told)
        except GdmpError:
            self._seen, self._ends, self._names = before
            raise

    def _take(self, told: Scene, marker: Marker, now: float) -> None:
        if marker.action == Marker.DELETEALL:
            told.clear()
            return
        number = marker.ns, marker.id
        name = marker_name(marker)
        if marker.action == Marker.DELETE:
            told.remove(name if marker.text else self._names.get(number, name))
            return
        if '#' in name:
            raise DataError(f'marker {name!r}: # is for the parts of a volume')
        self._names[number] = name
        volumes, frame = volumes_of(marker), marker.header.frame_id
        # The arm carries what is locked to a frame of its tool.
        in_tool = self._tool_frames() if marker.frame_locked else {}
        carried = frame in in_tool
        place = in_tool[frame] if carried else self._place_of(marker.header)
        told.remove(name)
        for volume in volumes:
            pose = volume.pose if place is None else compose(place, volume.pose)
            # Parts change from time to time: only what is whole has a velocity.
            told.put(volume.at(pose, None if carried or len(volumes) > 1 else
                               self._twist(name, pose, now), carried))
        self._seen[name] = now
        life = marker.lifetime.sec + 1e-9 * marker.lifetime.nanosec
        self._ends[name] = now + life if life > 0.0 else math.inf

    def _twist(self, name: str, pose: np.ndarray, now: float) -> np.ndarray:
        """How a volume moves that has come before."""
        twist, passed = np.zeros(6), now - self._seen.get(name, -math.inf)
        if name not in self._told or not 1e-3 < passed < AGAIN_S or self._told[name].carried:
            return twist
        last = self._told[name].pose
        twist[:3] = (pose[:3] - last[:3]) / passed
        rotation_between(last[3:], pose[3:], twist[3:])
        twist[3:] /= passed
        for part, least in ((slice(0, 3), RESTS_M_S), (slice(3, 6), RESTS_RAD_S)):
            if np.linalg.norm(twist[part]) < least:
                twist[part] = 0.0
        self._check_margin(self._told[name], float(np.linalg.norm(twist[:3])), passed)
        return twist

    def _check_margin(self, volume: Volume, speed: float, passed: float) -> None:
        """
        Warn if a volume may come nearer than its margin before that is known.

        :param passed: time between two messages [s]
        """
        margin = self._told.margin if volume.margin is None else volume.margin
        if speed * passed > margin:
            self._node.get_logger().warning(
                f'{volume.name} moves with {speed:.2f} m/s and is told every {passed:.2f} s: it '
                f'may come {1e3 * speed * passed:.0f} mm nearer before that is known, its margin '
                f'is {1e3 * margin:.0f} mm. Tell it more often, or take a larger margin',
                throttle_duration_sec=5.0)

    def _forget(self) -> None:
        """Remove what has outlived its lifetime, and read what has waited."""
        self._waiting.look()
        now = self._node.clock.now() / NS
        gone = [name for name, ends in self._ends.items() if ends < now]
        if not gone:
            return
        told = self._told.copy()
        for name in gone:
            del self._ends[name]
            told.remove(name)
        self._change(told)
