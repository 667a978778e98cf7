"""A take that may be paused: the time of its pauses is cut out of the bag."""
from __future__ import annotations

from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rclpy.serialization import deserialize_message, serialize_message

from gdmp_ros.data.bags import BagWriter, ns_of
from gdmp_ros.errors import ParameterError
from gdmp_ros.manifolds.quaternion import rotation_angles
from gdmp_ros.realtime.loop import NS
from gdmp_ros.ros import messages
from gdmp_ros.ros.recorder.record import message_class

#: A take goes on at most this far from where it was paused [m, rad].
NEAR_M, NEAR_RAD = 0.02, 0.2
#: Speed at which the recorded motion passes what is between [m/s, rad/s].
SPEED_M_S, SPEED_RAD_S = 0.1, 0.5


class _Message(NamedTuple):
    """What `gdmp_ros.data.bags.BagWriter.raw` gets."""

    topic: str
    kind: str
    published: int
    data: bytes
    definition: str | None
    digest: str | None


class Take:
    """
    The bag of one take; it has the method ``raw`` of a `gdmp_ros.data.bags.BagWriter`.

    :ivar paused: whether it is paused
    :ivar count: messages that were written
    """

    def __init__(self, path: Path, storage: str, pose_topic: str, rare: Collection[str]):
        """
        Begin it.

        :param pose_topic: of the tool, PoseStamped
        :param rare: topics whose messages are kept during a pause, as of its beginning
        :raises DataError: if the bag cannot be written
        """
        self.paused, self.count = False, 0
        self._writer = BagWriter(path, storage).open()
        self._pose_topic, self._rare = pose_topic, rare
        # The last two poses, and messages that came before the first pose after a pause.
        self._last: _Message | None = None
        self._before: _Message | None = None
        self._newest: _Message | None = None
        self._waiting: list[_Message] | None = None
        # How much earlier messages are written: by stamp, by publication [ns].
        self._cut = 0, 0

    @property
    def path(self) -> Path:
        """Of the bag, when it is closed."""
        return self._writer.path

    def raw(self, topic: str, msgtype: str, stamp_ns: int, data: bytes,
            definition: str | None = None, digest: str | None = None) -> None:
        """Write a message, unless the take is paused."""
        message = _Message(topic, msgtype, stamp_ns, data, definition, digest)
        is_pose = topic == self._pose_topic
        if self.paused:
            if is_pose:
                self._newest = message
            elif message.topic in self._rare and self._last is not None:
                self._write_at_pause(message, self._last)
        elif self._waiting is None:
            self._write(message)
        elif not is_pose:
            self._waiting.append(message)
        else:
            self._go_on(message)

    def pause(self) -> None:
        """Write nothing until `resume`."""
        self.paused, self._newest = True, None

    def resume(self) -> None:
        """
        Go on.

        :raises ParameterError: if the tool is not near where the take was paused
        """
        if self._last is not None and self._newest is not None:
            distance, angle = _between(self._last, self._newest)
            if distance > NEAR_M or angle > NEAR_RAD:
                raise ParameterError(
                    f'the tool is {distance:.3f} m and {angle:.2f} rad from where the take was '
                    f'paused: bring it back to {NEAR_M:g} m and {NEAR_RAD:g} rad, or end the take')
        self.paused, self._waiting = False, []

    def close(self, keep: bool) -> None:
        """Give the bag its name, or delete it."""
        for message in self._waiting or ():
            if self._last is not None:
                self._write_at_pause(message, self._last)
        self._writer.close(keep)

    def _go_on(self, pose: _Message) -> None:
        """Write the first pose after a pause, and what came meanwhile."""
        waiting, self._waiting = self._waiting or [], None
        if self._last is not None:
            distance, angle = _between(self._last, pose)
            usual = 0 if self._before is None else _stamp(self._last) - _stamp(self._before)
            step = max(usual, round(NS * max(distance / SPEED_M_S, angle / SPEED_RAD_S)))
            # The last pose is what was received; it was written earlier by the cut so far.
            self._cut = (self._cut[0] + _stamp(pose) - _stamp(self._last) - step,
                         self._cut[1] + pose.published - self._last.published - step)
        for message in (pose, *waiting):
            self._write(message)

    def _write(self, message: _Message) -> None:
        if message.topic == self._pose_topic:
            self._before, self._last = self._last, message
        self._put(message, *self._cut)

    def _write_at_pause(self, message: _Message, last: _Message) -> None:
        """Write a message as if it had come with the last pose before the pause."""
        self._put(message, self._cut[0] + _stamp(message) - _stamp(last),
                  self._cut[1] + message.published - last.published)

    def _put(self, message: _Message, stamps: int, published: int) -> None:
        data, self.count = message.data, self.count + 1
        if stamps:
            data = _earlier(data, message_class(message.kind), stamps)
        self._writer.raw(message.topic, message.kind, message.published - published, data,
                         message.definition, message.digest)


def _decoded(message: _Message) -> Any:
    return deserialize_message(message.data, message_class(message.kind))


def _stamp(message: _Message) -> int:
    """Stamp of a message [ns]; time of its publication if it has no header."""
    header = getattr(_decoded(message), 'header', None)
    return message.published if header is None else ns_of(header.stamp)


def _between(first: _Message, second: _Message) -> tuple[float, float]:
    """Distance and angle between two poses [m, rad]."""
    one, other = (messages.pose_numbers(_decoded(message).pose) for message in (first, second))
    return (float(np.linalg.norm(one[:3] - other[:3])),
            float(rotation_angles(one[3:], other[3:])))


def _earlier(data: bytes, kind: Callable[[], Any], nanoseconds: int) -> bytes:
    """A serialised message with earlier stamps."""
    message = deserialize_message(data, kind)
    for part in (message, *getattr(message, 'transforms', ())):
        header = getattr(part, 'header', None)
        # 0 is no stamp.
        if header is not None and ns_of(header.stamp):
            header.stamp = messages.stamp_of(ns_of(header.stamp) - nanoseconds)
    return bytes(serialize_message(message))
