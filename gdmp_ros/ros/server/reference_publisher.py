"""Publishes references on three topics."""
from __future__ import annotations

import secrets

from gdmp_msgs.msg import Reference
import numpy as np

from gdmp_ros.control.modes import StreamMode
from gdmp_ros.control.target import POSE, STIFFNESS, TARGET_SIZE
from gdmp_ros.ros.lifecycle import DEEP, ManagedNode
from gdmp_ros.ros.messages import fill_reference
from gdmp_ros.ros.serialized import SerializedTemplate
from gdmp_ros.ros.streams import (
    CHECK_EVERY,
    check_subscribers,
    pose_stream,
    stiffness_stream,
    Stream,
)


class ReferencePublisher:
    """Publishes ``~/reference``, ``~/reference_pose`` and ``~/reference_stiffness``."""

    def __init__(self, node: ManagedNode, frame: str):
        """:param frame: ``frame_id`` of the references"""
        reference = Reference()
        reference.header.frame_id = frame
        self._whole = Stream(node.add_publisher(Reference, '~/reference', DEEP),
                             SerializedTemplate(reference, TARGET_SIZE, fill_reference))
        self._pose = pose_stream(node, '~/reference_pose', frame)
        self._stiffness = stiffness_stream(node, '~/reference_stiffness')
        # A random start: a subscriber can distinguish the numbers of two publishers.
        self._sequence = secrets.randbelow(1 << 31) << 30
        self._ticks = 0
        self._last: tuple[np.ndarray, int] | None = None

    def publish(self, target: np.ndarray, stamp_ns: int,
                mode: StreamMode = StreamMode.STREAMING) -> None:
        """
        Publish the reference of a tick.

        :param target: `TARGET_SIZE` numbers
        """
        if self._ticks % CHECK_EVERY == 0:
            check_subscribers(self._whole, self._pose, self._stiffness)
        self._ticks += 1
        self._last = target, stamp_ns
        self._sequence += 1
        if self._whole.has_subscribers:
            self._whole.publish(target, stamp_ns, self._sequence, mode)
        if mode is StreamMode.ENDED:
            return
        if self._pose.has_subscribers:
            self._pose.publish(target[POSE:POSE + 7], stamp_ns)
        if self._stiffness.has_subscribers:
            self._stiffness.publish(target[STIFFNESS:STIFFNESS + 36])

    def end(self) -> None:
        """Publish that the stream ends here."""
        if self._last is not None:
            self.publish(*self._last, StreamMode.ENDED)
            self._last = None
