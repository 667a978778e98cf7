"""Topics that are published in every tick."""
from __future__ import annotations

from typing import Any

from geometry_msgs.msg import PoseStamped
import numpy as np
from std_msgs.msg import Float64MultiArray

from gdmp_ros.ros.lifecycle import ManagedNode
from gdmp_ros.ros.messages import (
    fill_matrix,
    fill_pose_stamped,
    matrix_message,
    SerializedTemplate,
)

#: Interval of the check for subscribers, in messages.
CHECK_EVERY = 10


class Stream:
    """
    Messages that differ in numbers, stamp and sequence number only.

    Without subscribers no message is made; the topics are volatile.
    """

    def __init__(self, publisher: Any, template: SerializedTemplate):
        self._publisher, self._template = publisher, template
        self._has_subscribers = False
        self._until_check = 0

    def publish(self, numbers: np.ndarray, stamp_ns: int = 0, sequence: int = 0) -> None:
        """Publish, if there are subscribers."""
        if self._until_check == 0:
            self._until_check = CHECK_EVERY
            self._has_subscribers = self._publisher.get_subscription_count() > 0
        self._until_check -= 1
        if self._has_subscribers:
            self._publisher.publish(self._template.bytes(numbers, stamp_ns, sequence))


def pose_stream(node: ManagedNode, topic: str, frame: str) -> Stream:
    """Stream of poses (x, y, z, qw, qx, qy, qz) as PoseStamped."""
    message = PoseStamped()
    message.header.frame_id = frame
    return Stream(node.add_publisher(PoseStamped, topic, 10),
                  SerializedTemplate(message, 7, fill_pose_stamped))


def stiffness_stream(node: ManagedNode, topic: str) -> Stream:
    """Stream of 6×6 matrices, row by row."""
    return Stream(node.add_publisher(Float64MultiArray, topic, 10),
                  SerializedTemplate(matrix_message(6), 36, fill_matrix))
