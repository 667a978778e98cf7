"""Topics published at the rate of the loop."""
from __future__ import annotations

import math
import time
from typing import Any

from geometry_msgs.msg import PoseStamped
import numpy as np
from std_msgs.msg import Float64MultiArray

from gdmp_ros.ros import messages as wire
from gdmp_ros.ros.lifecycle import ManagedNode

#: Time between two looks whether somebody listens [s].
LOOK_S = 0.01


class Stream:
    """
    Messages that differ in numbers, stamp and sequence number only.

    While nobody listens no message is made: what a volatile topic carried then would reach no one.
    """

    def __init__(self, publisher: Any, message: wire.Patched):
        self._publisher = publisher
        self._message = message
        self._listened = False
        self._looked = -math.inf

    def publish(self, numbers: np.ndarray, stamp_ns: int = 0, sequence: int = 0) -> None:
        """Publish, if somebody listens."""
        now = time.monotonic()
        if now - self._looked >= LOOK_S:
            self._looked = now
            self._listened = self._publisher.get_subscription_count() > 0
        if self._listened:
            self._publisher.publish(self._message.bytes(numbers, stamp_ns, sequence))


def pose_stream(node: ManagedNode, topic: str, frame: str) -> Stream:
    """Poses (x, y, z, qw, qx, qy, qz) in a frame, as PoseStamped."""
    message = PoseStamped()
    message.header.frame_id = frame
    return Stream(node.add_publisher(PoseStamped, topic, 10),
                  wire.Patched(message, 7, wire.fill_pose_stamped))


def stiffness_stream(node: ManagedNode, topic: str) -> Stream:
    """6×6 matrices, row by row."""
    return Stream(node.add_publisher(Float64MultiArray, topic, 10),
                  wire.Patched(wire.matrix_message(6), 36, wire.fill_matrix))
