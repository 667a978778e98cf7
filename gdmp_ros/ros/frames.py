"""Poses of messages in the frame of the robot's base, by what /tf and /tf_static tell."""
from __future__ import annotations

from collections import deque
import threading
from typing import Any

from geometry_msgs.msg import TransformStamped
import numpy as np
from rclpy.time import Time
from tf2_msgs.msg import TFMessage

from gdmp_ros.errors import GdmpError
from gdmp_ros.manifolds.poses import compose
from gdmp_ros.manifolds.quaternion import rotate
from gdmp_ros.ros.frame_tree import FrameError, Frames, FrameTree, NS, Transform
from gdmp_ros.ros.lifecycle import ManagedNode
from gdmp_ros.ros.messages import checked_numbers, set_transform, transform_numbers
from gdmp_ros.ros.middleware import deserialized

try:
    import tf2_py
except ImportError:  # it has no wheel
    tf2_py = None

#: Messages on /tf that are kept: ten seconds of an arm.
DEPTH = 1000
#: Messages that are read at once where time matters; one takes 0.1 ms.
AT_ONCE = 30
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

    Messages on /tf are kept as they come, and read from the first pose in another frame on. Any
    thread may use it.
    """

    def __init__(self, node: ManagedNode, name: str):
        """:param name: ``frame_id`` of the base"""
        self.name = name
        self._frames, self._wanted = new_frames(), False
        self._lock = threading.Lock()
        self._inputs = [(node.add_subscription(TFMessage, topic, None, DEPTH, late=fixed), fixed)
                        for topic, fixed in (('/tf', False), ('/tf_static', True))]
        self._unread: deque[tuple[bytes, bool]] = deque()
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
        self._wanted = True
        with self._lock:
            self._collect()
            if len(self._unread) > AT_ONCE:
                raise FrameError(f'frame {header.frame_id!r}: /tf is being read')
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
        with self._lock:
            self._collect()
            if self._wanted:
                self._read()

    def _collect(self) -> None:
        """Take the messages that have come, without reading them."""
        for subscription, fixed in self._inputs:
            while (received := subscription.take()) is not None:
                self._unread.append((received.data, fixed))
        while not self._wanted and len(self._unread) > DEPTH:
            self._drop_oldest()

    def _drop_oldest(self) -> None:
        """Forget the oldest message of a frame that moves; fixed frames are sent once."""
        for k, (_, fixed) in enumerate(self._unread):
            if not fixed:
                del self._unread[k]
                return
        self._unread.popleft()

    def _read(self) -> None:
        while self._unread:
            data, fixed = self._unread.popleft()
            try:
                transforms = deserialized(data, TFMessage).transforms
            except GdmpError:
                continue
            for one in transforms:
                try:
                    pose = transform_numbers(one.transform)
                except GdmpError:
                    continue  # as tf2: what is no transform is left out
                stamp = one.header.stamp
                self._frames.add(Transform(one.header.frame_id.lstrip('/'),
                                           one.child_frame_id.lstrip('/'), pose,
                                           stamp.sec * NS + stamp.nanosec), fixed)
