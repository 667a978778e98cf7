"""Task frames of skills: objects that are shown, and dragged where no camera sees them."""
from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import InteractiveMarkerFeedback

from gdmp_ros.ros.frames import BaseFrame, FrameError
from gdmp_ros.ros.lifecycle import ManagedNode
from gdmp_ros.ros.messages import stamped_transform
from gdmp_ros.ros.visualizer import markers
from gdmp_ros.ros.visualizer.handles import handle, InteractiveMarkers

#: Where the handle of an object stands that is not known yet, in front of an arm.
UNKNOWN = np.array([0.5, 0.0, 0.2, 1.0, 0.0, 0.0, 0.0])
_PREFIX = 'object '


class ObjectHandles:
    """
    A handle for each object.

    :ivar poses: of those that are known, by name
    """

    def __init__(self, node: ManagedNode, handles: InteractiveMarkers, frame: str,
                 names: Sequence[str]):
        """:param frame: that of the base"""
        self._node, self._handles, self._frame, self._names = node, handles, frame, names
        self._placed: dict[str, np.ndarray] = {}
        self.poses: dict[str, np.ndarray] = {}
        if names:
            self._base = BaseFrame(node, frame)
            self._out = node.add_publisher(TFMessage, '/tf', 100)

    def update(self) -> None:
        """Publish what was dragged, and move the handles to where the objects are."""
        for name in self._names:
            if name in self._placed:
                self._publish(name)
            else:
                try:
                    self.poses[name] = self._base.newest(name)[0]
                except FrameError:
                    self.poses.pop(name, None)
            title = _PREFIX + name
            if title not in self._handles.names():
                self._handles.put(handle(title, name, self._frame, 0.15,
                                         [markers.sphere(markers.GOAL, 0.015)]))
            self._handles.move(title, self.poses.get(name, UNKNOWN))

    def drag(self, message: InteractiveMarkerFeedback) -> None:
        """Place an object where a user drags it; feedback about other markers is ignored."""
        name = message.marker_name.removeprefix(_PREFIX)
        if name != message.marker_name and name in self._names and message.event_type in (
                message.POSE_UPDATE, message.MOUSE_UP):
            pose = self._handles.pose(message.marker_name)
            pose[3:] /= np.linalg.norm(pose[3:])
            self._placed[name] = self.poses[name] = pose
            self._publish(name)

    def _publish(self, name: str) -> None:
        self._out.publish(TFMessage(transforms=[stamped_transform(
            self._frame, name, self._placed[name], self._node.stamp())]))
