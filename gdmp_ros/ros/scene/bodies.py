"""Arms as obstacles of each other: ``~/body``, and the bodies of other arms."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

from gdmp_msgs.msg import Scene as SceneMessage
import numpy as np
from std_msgs.msg import Header

from gdmp_ros.control.controller import ImpedanceController
from gdmp_ros.errors import GdmpError
from gdmp_ros.manifolds.poses import compose, turn_of_z, turned
from gdmp_ros.realtime.loop import Clock, Loop, NS, periodic
from gdmp_ros.ros.frames import FrameError, PATIENCE_S
from gdmp_ros.ros.lifecycle import ManagedNode
from gdmp_ros.ros.parameters import Spec
from gdmp_ros.ros.scene.messages import scene_message, scene_of
from gdmp_ros.ros.scene.topics import SceneTopics
from gdmp_ros.scene.scene import Scene
from gdmp_ros.scene.volume import CARRIED, Volume

#: Bodies are published so often [Hz]; in between they move on with their velocities.
RATE_HZ = 20.0
#: Time over which the velocities of a body are measured [s].
STEP_S = 1e-3
#: Shortest axis of a capsule; a shorter one is a sphere [m].
_SHORTEST = 1e-3
SPECS = (
    Spec('other_arms', [''], 'topics ~/body of other arms, from which this arm keeps away',
         changes='configure'),
    Spec('other_arms_allowed', [''], 'links that may touch those of the same names of other arms, '
         'and what these carry: the hand, for two arms that hold one thing', changes='configure'),
)


def body_volumes(controller: ImpedanceController, moves: bool = True) -> list[Volume]:
    """
    An arm, and what it carries, as volumes that move, in its base.

    :param moves: False: it stands, whatever its last velocities were
    """
    result, count, step = [], dict[str, int](), STEP_S
    for link, now, then in zip(controller.links, *controller.body(step)):
        if now[6] <= 0.0:
            continue  # nothing is carried
        count[link] = number = count.get(link, 0) + 1
        first, last = now[:3], now[3:6]
        moved_first, moved_last = (then[:3] - first) / step, (then[3:6] - last) / step
        axis = last - first
        length = float(np.linalg.norm(axis))
        pose, twist = np.zeros(7), np.zeros(6)
        pose[:3], pose[3] = 0.5 * (first + last), 1.0
        twist[:3] = 0.5 * (moved_first + moved_last)
        size: tuple[float, ...] = (float(now[6]),)
        if length > _SHORTEST:
            pose[3:] = turn_of_z(axis / length)
            twist[3:] = np.cross(axis, moved_last - moved_first) / length ** 2
            size += (length,)
        result.append(Volume(f'{link}#{number}', 'capsule' if length > _SHORTEST else 'sphere',
                             size, pose, twist if moves else np.zeros(6)))
    return result


def source_of(topic: str) -> str:
    """Name of the arm whose body a topic has: that of its node."""
    return topic.strip('/').removesuffix('/body')


class BodyTopics:
    """Publishes the body of an arm, and keeps the arm away from those of others."""

    def __init__(self, node: ManagedNode, topics: SceneTopics,
                 place_of: Callable[[Any], np.ndarray | None], parameters: Any,
                 own: Callable[[], list[Volume] | None], names: set[str],
                 refuse: Callable[[str], None]):
        """
        Subscribe.

        :param topics: has the bodies of the others, too
        :param place_of: see `SceneTopics`, as ``refuse``
        :param parameters: with `SPECS`
        :param own: gives the body of this arm now; None: nothing is published
        :param names: gets the names of the parts of other arms in the scene
        """
        self._node, self._topics, self._place_of = node, topics, place_of
        self._own, self._frame = own, parameters.frame_id
        self._allowed = tuple(filter(None, parameters.other_arms_allowed))
        self._names, self._refuse = names, refuse
        # When the frame of a body was found to be unknown [s].
        self._unknown: dict[str, float] = {}
        self._out = node.add_publisher(SceneMessage, '~/body', 1)
        for topic in filter(None, parameters.other_arms):
            node.add_subscription(SceneMessage, topic, partial(self._on_body, topic), 1)

    def publish(self, clock: Clock) -> Loop:
        """Publish the body, if it has subscribers."""
        def step(deadline_ns: int, now_ns: int) -> None:
            try:
                own = self._own() if self._out.subscribers() > 0 else None
                if own is not None:
                    self._out.publish(scene_message(Scene(own), self._frame, self._node.stamp()))
            except GdmpError as error:  # others stop hearing of it: the arm itself goes on
                self._refuse(f'~/body: {error}')
        return periodic(step, round(NS / RATE_HZ), clock)

    def _on_body(self, topic: str, message: SceneMessage) -> None:
        """Take a body, or refuse it; a frame has some time to become known."""
        now = self._node.clock.now() / NS
        try:
            self._take(source_of(topic), message)
        except FrameError as error:
            if now - self._unknown.setdefault(topic, now) > PATIENCE_S:
                self._refuse(f'{topic}: {error}')
        except GdmpError as error:
            self._refuse(f'{topic}: {error}')
        else:
            self._unknown.pop(topic, None)

    def _take(self, source: str, message: SceneMessage) -> None:
        """:raises GdmpError: if it is refused, or its frame is not known yet"""
        # Where the other base is now: the stamp may be newer than the last transform.
        place, volumes = self._place_of(Header(frame_id=message.header.frame_id)), []
        for volume in scene_of(message).around:
            pose, twist = (volume.pose, volume.twist) if place is None else (
                compose(place, volume.pose), turned(place, volume.twist))
            meets = self._allowed and volume.name.partition('#')[0] in (*self._allowed, CARRIED)
            volumes.append(replace(volume, name=f'arm {source} {volume.name}', pose=pose,
                                   twist=twist,
                                   allowed=(*self._allowed, CARRIED) if meets else ()))
        self._names.update(volume.name for volume in volumes)
        self._topics.beside(source, volumes)
