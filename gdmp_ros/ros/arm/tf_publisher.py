"""Publishes where the links of an arm are: /tf and /tf_static."""
from __future__ import annotations

from collections.abc import Sequence

from geometry_msgs.msg import TransformStamped
import numpy as np
from tf2_msgs.msg import TFMessage

from gdmp_ros.ros.lifecycle import ManagedNode, Stream
from gdmp_ros.ros.messages import set_transform, stamp_of
from gdmp_ros.ros.serialized import SerializedTemplate
from gdmp_ros.sim.urdf import LinkFrames


class TfPublisher:
    """The frames of the links in ``robot_description``, so that RViz shows the robot."""

    def __init__(self, node: ManagedNode):
        self._node = node
        self._moving_out = node.add_publisher(TFMessage, '/tf', 100)
        self._fixed_out = node.add_publisher(TFMessage, '/tf_static', 1, late=True)
        # One attribute, because one thread describes the links and another publishes them.
        self._moving: tuple[LinkFrames, Stream] | None = None

    def describe(self, links: LinkFrames) -> None:
        """Use these links from now on, and publish those that are fixed."""
        now = self._node.time_ns()
        self._fixed_out.publish(_message([(parent, child) for parent, child, _ in links.fixed],
                                         [pose for _, _, pose in links.fixed], now))
        message = _message(links.moving, [], now)

        def fill(message: TFMessage, numbers: np.ndarray) -> None:
            for transform, pose in zip(message.transforms, numbers.reshape(-1, 7)):
                set_transform(transform.transform, pose)
        template = SerializedTemplate(message, 7 * len(links.moving), fill,
                                      [transform.header for transform in message.transforms])
        self._moving = links, Stream(self._moving_out, template)

    def check(self) -> None:
        """Find out whether /tf has subscribers."""
        if self._moving is not None:
            self._moving[1].check()

    @property
    def has_subscribers(self) -> bool:
        """Result of the last `check`."""
        return self._moving is not None and self._moving[1].has_subscribers

    def publish(self, position: np.ndarray, stamp_ns: int) -> None:
        """Publish the links that move, at joint positions [rad, m]."""
        moving = self._moving
        if moving is not None:
            moving[1].publish(moving[0].at(position).ravel(), stamp_ns)


def _message(names: Sequence[tuple[str, str]], poses: Sequence[np.ndarray], stamp_ns: int
             ) -> TFMessage:
    message = TFMessage()
    for parent, child in names:
        item = TransformStamped(child_frame_id=child)
        item.header.frame_id, item.header.stamp = parent, stamp_of(stamp_ns)
        message.transforms.append(item)
    for transform, pose in zip(message.transforms, poses):
        set_transform(transform.transform, pose)
    return message
