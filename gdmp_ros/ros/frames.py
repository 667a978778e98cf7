"""Poses of messages in the frame of the robot's base, by what /tf and /tf_static tell."""
from __future__ import annotations

import threading
from typing import Any

from geometry_msgs.msg import TransformStamped
import numpy as np
from rclpy.time import Time
from tf2_msgs.msg import TFMessage

from gdmp_ros.errors import GdmpError
from gdmp_ros.manifolds.quaternion import rotate
from gdmp_ros.ros.frame_tree import compose, FrameError, Frames, FrameTree, NS, Transform
from gdmp_ros.ros.lifecycle import ManagedNode
from gdmp_ros.ros.messages import checked_numbers, set_transform, transform_numbers
from gdmp_ros.ros.polling import take

try:
    import tf2_py
except ImportError:  # it has no wheel
    tf2_py = None

#: History of /tf: it is read ten times a second.
DEPTH = 1000
_AUTHORITY = 'gdmp_ros'


class Tf2Frames:
    """Frames in the buffer of tf2."""

    def __init__(self) -> None:
        self._buffer: Any = tf2_py.BufferCore()

    def add(self, transform: Transform, fixed: bool) -> None:
        """Remember a transform."""
        message = TransformStamped(child_frame_id=transform.child)
        message.header.frame_id = transform.parent
        message.header.stamp = Time(nanoseconds=transform.stamp_ns).to_msg()
        set_transform(message.transform, transform.pose)
        (self._buffer.set_transform_static if fixed else self._buffer.set_transform)(
            message, _AUTHORITY)

    def pose_of(self, frame: str, base: str, stamp_ns: int) -> np.ndarray:
        """Pose of a frame in another one; see `Frames`."""
        try:
            found = self._buffer.lookup_transform_core(base, frame, Time(nanoseconds=stamp_ns))
        except tf2_py.TransformException as error:
            raise FrameError(str(error)) from None
        return transform_numbers(found.transform)


def new_frames() -> Frames:
    """The buffer of tf2 where the system has it, otherwise ours."""
    return FrameTree() if tf2_py is None else Tf2Frames()


class BaseFrame:
    """
    The frame of a robot's base, and where others are in it.

    The node begins to listen to /tf with the first pose in another frame. Any thread may use it.
    """

    def __init__(self, node: ManagedNode, name: str):
        """:param name: ``frame_id`` of the base"""
        self.name = name
        self.wanted = False
        self._node, self._frames = node, new_frames()
        self._lock = threading.Lock()
        self._inputs: list[tuple[Any, bool]] = []
        node.add_report(self._listen)

    def pose(self, message: Any) -> np.ndarray:
        """
        Pose of a stamped message in the base (x, y, z, qw, qx, qy, qz).

        :raises FrameError: if its frame is not known, now or at its stamp
        :raises ManifoldError: if it is no pose
        """
        numbers = checked_numbers(message.pose)
        place = self.place_of(message.header)
        return numbers if place is None else compose(place, numbers)

    def moving(self, message: Any, twist: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """
        Pose of a stamped message, as `pose`, and its twist, in the base.

        :param twist: in its frame [m/s, rad/s]; that frame itself is taken to rest
        """
        numbers, turned = checked_numbers(message.pose), twist.copy()
        place = self.place_of(message.header)
        if place is None:
            return numbers, turned
        rotate(place[3:], twist[:3], turned[:3])
        rotate(place[3:], twist[3:], turned[3:])
        return compose(place, numbers), turned

    def place_of(self, header: Any) -> np.ndarray | None:
        """
        Pose of the frame of a message in the base; None for the base itself.

        :raises FrameError: as `pose`
        """
        if header.frame_id == self.name:
            return None
        if not header.frame_id:
            raise FrameError(f"the frame is '', expected {self.name!r} or one that /tf connects "
                             'to it')
        self.wanted = True
        with self._lock:
            self._read()
            return self._frames.pose_of(header.frame_id, self.name,
                                        header.stamp.sec * NS + header.stamp.nanosec)

    def knows(self, header: Any) -> bool:
        """Whether `place_of` would find the frame of a message."""
        try:
            self.place_of(header)
        except FrameError:
            return False
        return True

    def _listen(self) -> None:
        """Subscribe once it is wanted, and read what has come."""
        if not self.wanted:
            return
        with self._lock:
            if not self._inputs:
                self._inputs = [
                    (self._node.add_subscription(TFMessage, topic, None, DEPTH, latched=fixed),
                     fixed) for topic, fixed in (('/tf', False), ('/tf_static', True))]
            self._read()

    def _read(self) -> None:
        for subscription, fixed in self._inputs:
            while (message := take(subscription)) is not None:
                for one in message.transforms:
                    try:
                        pose = transform_numbers(one.transform)
                    except GdmpError:
                        continue  # as tf2: what is no transform is left out
                    stamp = one.header.stamp
                    self._frames.add(Transform(one.header.frame_id.lstrip('/'),
                                               one.child_frame_id.lstrip('/'), pose,
                                               stamp.sec * NS + stamp.nanosec), fixed)
