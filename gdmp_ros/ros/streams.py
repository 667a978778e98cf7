"""Topics that are published in every tick."""
from __future__ import annotations

from collections.abc import Sequence

from geometry_msgs.msg import PoseStamped
import numpy as np
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from gdmp_ros.ros.lifecycle import ManagedNode
from gdmp_ros.ros.messages import fill_matrix, fill_pose_stamped, matrix_message
from gdmp_ros.ros.middleware import Publisher
from gdmp_ros.ros.serialized import SerializedTemplate

#: Ticks between two checks for subscribers.
CHECK_EVERY = 100


class Stream:
    """
    Messages that differ in numbers, stamp and integers only (`SerializedTemplate.bytes`).

    :ivar has_subscribers: result of the last `check`; without subscribers nothing need be
        published, because the topics are volatile
    """

    def __init__(self, publisher: Publisher, template: SerializedTemplate):
        self._publisher, self._template = publisher, template
        self.has_subscribers = False

    def check(self) -> None:
        """Find out whether there are subscribers."""
        self.has_subscribers = self._publisher.subscribers() > 0

    def publish(self, numbers: np.ndarray, stamp_ns: int = 0, *integers: int) -> None:
        """Publish; only useful if it `has_subscribers`."""
        self._publisher.send(self._template.bytes(numbers, stamp_ns, *integers))


def check_subscribers(*streams: Stream) -> None:
    """`Stream.check` of several streams."""
    for stream in streams:
        stream.check()


def pose_stream(node: ManagedNode, topic: str, frame: str) -> Stream:
    """Stream of poses (x, y, z, qw, qx, qy, qz) as PoseStamped."""
    message = PoseStamped()
    message.header.frame_id = frame
    return Stream(node.add_publisher(PoseStamped, topic, 10),
                  SerializedTemplate(message, 7, fill_pose_stamped))


def joints_stream(node: ManagedNode, topic: str, names: Sequence[str]) -> Stream:
    """Stream of positions, velocities and torques (one after the other) as JointState."""
    fields = ('position', 'velocity', 'effort')

    def fill(message: JointState, numbers: np.ndarray) -> None:
        for field, row in zip(fields, numbers.reshape(len(fields), -1)):
            setattr(message, field, row.tolist())
    return Stream(node.add_publisher(JointState, topic, 10),
                  SerializedTemplate(JointState(name=list(names)), len(fields) * len(names), fill))


def stiffness_stream(node: ManagedNode, topic: str) -> Stream:
    """Stream of 6×6 matrices, row by row."""
    return Stream(node.add_publisher(Float64MultiArray, topic, 10),
                  SerializedTemplate(matrix_message(6), 36, fill_matrix))
