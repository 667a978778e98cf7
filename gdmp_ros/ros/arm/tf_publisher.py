"""Publishes where the links of an arm are: /tf and /tf_static."""
from __future__ import annotations

from collections.abc import Sequence

from builtin_interfaces.msg import Time
from geometry_msgs.msg import TransformStamped
import numpy as np
from tf2_msgs.msg import TFMessage

from gdmp_ros.ros.lifecycle import ManagedNode
from gdmp_ros.ros.messages import set_transform, stamp_of
from gdmp_ros.sim.link_frames import LinkFrames


class TfPublisher:
    """The frames of the links in ``robot_description``, so that RViz shows the robot."""

    def __init__(self, node: ManagedNode):
        self._node = node
        self._moving_out = node.add_publisher(TFMessage, '/tf', 100)
        self._fixed_out = node.add_publisher(TFMessage, '/tf_static', 1, latched=True)
        self._links: LinkFrames | None = None
        self._message = TFMessage()

    def describe(self, links: LinkFrames) -> None:
        """Use these links from now on, and publish those that are fixed."""
        now = self._node.get_clock().now().to_msg()
        self._fixed_out.publish(_message([(parent, child) for parent, child, _ in links.fixed],
                                         [pose for _, _, pose in links.fixed], now))
        self._message = _message(links.moving, [], now)
        self._links = links

    def publish(self, position: np.ndarray, stamp_ns: int) -> None:
        """Publish the links that move, at joint positions [rad, m]."""
        if self._links is None or self._moving_out.get_subscription_count() == 0:
            return
        stamp = stamp_of(stamp_ns)
        for one, pose in zip(self._message.transforms, self._links.at(position)):
            one.header.stamp = stamp
            set_transform(one.transform, pose)
        self._moving_out.publish(self._message)


def _message(names: Sequence[tuple[str, str]], poses: Sequence[np.ndarray], stamp: Time
             ) -> TFMessage:
    message = TFMessage()
    for parent, child in names:
        one = TransformStamped(child_frame_id=child)
        one.header.frame_id, one.header.stamp = parent, stamp
        message.transforms.append(one)
    for one, pose in zip(message.transforms, poses):
        set_transform(one.transform, pose)
    return message
