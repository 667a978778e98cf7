"""Arms as obstacles of each other: ``~/body``, and the bodies of other arms."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

from gdmp_msgs.msg import Scene as SceneMessage
import numpy as np

from gdmp_ros.control.controller import ImpedanceController
from gdmp_ros.manifolds.poses import compose
from gdmp_ros.manifolds.quaternion import rotate
from gdmp_ros.realtime.loop import Clock, Loop, NS, periodic
from gdmp_ros.ros.frames import Waiting
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
_UP = np.array([0.0, 0.0, 1.0])
#: How the names of the parts of other arms begin.
_PREFIX = 'arm '
SPECS = (
    Spec('other_arms', [''], 'topics ~/body of other arms, from which this arm keeps away',
         changes='configure'),
    Spec('other_arms_allowed', [''], 'links that may touch those of the same names of other arms, '
         'and what these carry: the hand, for two arms that hold one thing', changes='configure'),
)


def body_volumes(controller: ImpedanceController) -> list[Volume]:
    """An arm, and what it carries, as volumes that move, in its base."""
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
            pose[3:] = _turn_to(axis / length)
            twist[3:] = np.cross(axis, moved_last - moved_first) / length ** 2
            size += (length,)
        result.append(Volume(f'{link}#{number}', 'capsule' if length > _SHORTEST else 'sphere',
                             size, pose, twist))
    return result


def _turn_to(axis: np.ndarray) -> np.ndarray:
    """Quaternion that turns z to an axis of length 1."""
    turn = np.concatenate([[1.0 + axis[2]], np.cross(_UP, axis)])
    if turn[0] < 1e-9:
        return np.array([0.0, 1.0, 0.0, 0.0])
    return np.asarray(turn / np.linalg.norm(turn))


def source_of(topic: str) -> str:
    """Name of the arm whose body a topic has: that of its node."""
    return topic.strip('/').removesuffix('/body')


def is_of_arm(volume: Volume) -> bool:
    """Whether a volume is a part of another arm."""
    return volume.name.startswith(_PREFIX)


class BodyTopics:
    """Publishes the body of an arm, and keeps the arm away from those of others."""

    def __init__(self, node: ManagedNode, topics: SceneTopics,
                 place_of: Callable[[Any], np.ndarray | None], parameters: Any,
                 own: Callable[[], list[Volume]], refuse: Callable[[str], None]):
        """
        Subscribe.

        :param topics: has the bodies of the others, too
        :param place_of: see `SceneTopics`, as ``refuse``
        :param parameters: with `SPECS`
        :param own: gives the body of this arm now
        """
        self._node, self._topics, self._place_of = node, topics, place_of
        self._own, self._frame = own, parameters.frame_id
        self._allowed = tuple(filter(None, parameters.other_arms_allowed))
        self._out = node.add_publisher(SceneMessage, '~/body', 1)

        def refused(topic: str, reason: str) -> None:
            refuse(f'{topic}: {reason}')
        for topic in filter(None, parameters.other_arms):
            waiting = Waiting(lambda: node.clock.now() / NS, partial(refused, topic))
            node.add_subscription(SceneMessage, topic, partial(
                self._on_body, waiting, source_of(topic)), 1)

    def publish(self, clock: Clock) -> Loop:
        """Publish the body, if somebody wants it."""
        def step(deadline_ns: int, now_ns: int) -> None:
            if self._out.subscribers() > 0:
                self._out.publish(scene_message(Scene(self._own()), self._frame,
                                                self._node.stamp()))
        return periodic(step, round(NS / RATE_HZ), clock)

    def _on_body(self, waiting: Waiting, source: str, message: SceneMessage) -> None:
        """Take the newest body; one whose frame is not known yet waits for it."""
        waiting.clear()
        waiting.add(lambda came: self._take(source, message))

    def _take(self, source: str, message: SceneMessage) -> None:
        """:raises GdmpError: if it is refused, or its frame is not known yet"""
        place, volumes = self._place_of(message.header), []
        for volume in scene_of(message).around:
            pose, twist = volume.pose, volume.twist.copy()
            if place is not None:
                pose = compose(place, pose)
                for part in (slice(0, 3), slice(3, 6)):
                    rotate(place[3:], volume.twist[part], twist[part])
            meets = volume.name.partition('#')[0] in (*self._allowed, CARRIED)
            volumes.append(replace(volume, name=f'{_PREFIX}{source} {volume.name}', pose=pose,
                                   twist=twist, allowed=self._allowed if meets else ()))
        self._topics.beside(source, volumes)
