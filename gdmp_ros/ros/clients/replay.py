"""Sends recorded references again, with new stamps."""
from __future__ import annotations

from typing import NamedTuple

from gdmp_msgs.msg import ArmStatus, Reference
import numpy as np

from gdmp_ros.control.modes import ArmMode, StreamMode
from gdmp_ros.control.target import TARGET_SIZE
from gdmp_ros.data.runs import RecordedReferences
from gdmp_ros.errors import GdmpError
from gdmp_ros.realtime.loop import Loop, NS
from gdmp_ros.ros.clients.server_client import Client, DISCOVERY_S
from gdmp_ros.ros.messages import fill_reference
from gdmp_ros.ros.middleware import ANOTHER_NODE, DEEP
from gdmp_ros.ros.serialized import SerializedTemplate
from gdmp_ros.ros.server.reference_publisher import first_sequence
from gdmp_ros.util.terminal import progress, rising

#: An arm that does not follow a motion for this time will not [s].
FOLLOW_S = 0.5
#: Time in which the name of a node is found that is known to publish [s].
_NAMES_S = 2.0
#: Time between two looks at the status of the arm [s].
LOOK_S = 0.05


class ReplayRequest(NamedTuple):
    """
    What to replay.

    :ivar topic: on which to send
    :ivar arm: name of the node that follows, with its namespace
    :ivar wait: timeout for the arm [s]
    """

    topic: str
    arm: str
    wait: float


def replay(references: RecordedReferences, request: ReplayRequest) -> None:
    """
    Send references in the rhythm in which they were recorded; the arm decides whether to follow.

    At the end, and after Ctrl-C, the arm is told that the stream has ended: it holds.

    :raises GdmpError: if another node publishes on the topic, no arm listens, or it does not
        follow
    """
    replayer = _Replayer(references, request)
    try:
        replayer.prepare()
        replayer.send()
    finally:
        replayer.close()


class _Replayer:

    def __init__(self, references: RecordedReferences, request: ReplayRequest):
        self._references, self._request = references, request
        self._client = Client('replay')
        self._status: ArmStatus | None = None
        self._not_followed_since = 0.0
        message = Reference()
        message.header.frame_id = references.frame
        self._template = SerializedTemplate(message, TARGET_SIZE, fill_reference)
        self._sequence, self._sent = first_sequence(), 0
        self._publisher = self._client.publisher(Reference, request.topic, DEEP)
        self._client.subscribe(ArmStatus, f'{request.arm}/status', self._on_status)

    def close(self) -> None:
        """Say that the stream has ended, and disconnect."""
        if self._sent:
            self._publish(self._sent - 1, 1, StreamMode.ENDED)
            # What was sent must leave this process.
            self._client.spend(0.1)
        self._client.close()

    def prepare(self) -> None:
        """
        Wait for the arm.

        :raises GdmpError: if there is none, or the topic is in use
        """
        request = self._request
        self._client.wait(f'an arm that follows {request.topic}, and the status of {request.arm}',
                          lambda: (self._publisher.subscribers() > 0
                                   and self._status is not None), request.wait)
        self._client.spend(DISCOVERY_S)
        if ANOTHER_NODE in self._others():
            self._client.spend(_NAMES_S)
        self._check_alone()

    def _others(self) -> list[str]:
        """Other nodes that publish on the topic."""
        participant = self._client.participant
        return [name for name in participant.publishers(self._request.topic)
                if name != participant.name]

    def _check_alone(self) -> None:
        """:raises GdmpError: if another node publishes on the topic"""
        others = self._others()
        if others:
            raise GdmpError(f'{", ".join(others)} publishes on {self._request.topic}: deactivate '
                            'it first (ros2 lifecycle set NODE deactivate, then cleanup)')

    def send(self) -> None:
        """:raises GdmpError: if the arm does not follow"""
        client, seconds = self._client, self._references.times[-1]
        self._not_followed_since = client.now()
        stream = client.clock.start(self._stream(), -1)
        try:
            with progress('replaying, seconds', round(float(seconds))) as step:
                show = rising(step)
                while self._sent < len(self._references.times) and stream.failure is None:
                    client.spend(LOOK_S)
                    last = max(self._sent - 1, 0)
                    show(self._references.times[last])
                    self._check(self._references.modes[last], client.now())
                    # On a busy machine others are discovered late.
                    self._check_alone()
        finally:
            stream.end()
        if stream.failure is not None:
            raise GdmpError(f'replaying failed: {stream.failure!r}')

    def _stream(self) -> Loop:
        """Send until the end."""
        begun = self._client.clock.now()
        for k, seconds in enumerate(self._references.times):
            yield begun + round(seconds * NS)
            self._publish(k, int(self._references.steps[k]), self._references.modes[k])
            self._sent = k + 1

    def _publish(self, k: int, step: int, mode: StreamMode) -> None:
        self._sequence += step
        self._publisher.send(self._template.bytes(
            np.ascontiguousarray(self._references.targets[k]), self._client.clock.wall(),
            self._sequence, mode))

    def _check(self, mode: StreamMode, now: float) -> None:
        status = self._status
        if status is None or status.mode == ArmMode.FOLLOW or mode is not StreamMode.STREAMING:
            self._not_followed_since = now
        elif now - self._not_followed_since > FOLLOW_S:
            why = status.reason or status.last_refusal or 'it says no reason'
            raise GdmpError(f'{self._request.arm} does not follow: {why}')

    def _on_status(self, status: ArmStatus) -> None:
        self._status = status
