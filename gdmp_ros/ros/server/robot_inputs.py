"""Where the robot is, from its topics."""
from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from geometry_msgs.msg import PoseStamped
import numpy as np
from sensor_msgs.msg import JointState

from gdmp_ros.data.message_numbers import joint_positions
from gdmp_ros.errors import GdmpError
from gdmp_ros.playback.measured_input import MeasuredInput
from gdmp_ros.playback.streamer import Streamer
from gdmp_ros.ros.frames import BaseFrame
from gdmp_ros.ros.lifecycle import ManagedNode
from gdmp_ros.ros.middleware import deserialized
from gdmp_ros.ros.serialized import PoseReader

T = TypeVar('T')


class RobotInputs:
    """
    Measured pose and joints; polled, and read only when they are needed.

    :ivar pose: of the tool
    :ivar joints: positions of the joints
    """

    _streamer: Streamer

    def __init__(self, node: ManagedNode, parameters: Any, base: BaseFrame):
        """Subscribe; `connect` follows."""
        joints = parameters.measured_joints_topic
        self._reader = PoseReader(base.name, base.pose)
        self._states = node.add_subscription(JointState, joints, None)
        self.pose = self.pose_of(node, parameters.measured_pose_topic)
        self.joints = MeasuredInput(node.clock, self._newest_joints,
                                    node.resolve_topic_name(joints), 'positions of the joints')

    def connect(self, streamer: Streamer) -> None:
        """Count refusals there, and ask it for the names of the joints."""
        self._streamer = streamer

    def read_pose(self, data: bytes) -> np.ndarray | None:
        """Read the measured pose of a serialised message, or refuse it."""
        return self._guarded('measured_pose', lambda: self._reader.read(data))

    def pose_of(self, node: ManagedNode, topic: str) -> MeasuredInput:
        """Subscribe to the measured pose of a tool."""
        poses = node.add_subscription(PoseStamped, topic, None)

        def newest() -> tuple[np.ndarray, float] | None:
            received = poses.newest()
            pose = None if received is None else self.read_pose(received.data)
            return (None if received is None or pose is None else
                    (pose, poses.age(received)))
        return MeasuredInput(node.clock, newest, node.resolve_topic_name(topic))

    def _newest_joints(self) -> tuple[np.ndarray, float] | None:
        received, player = self._states.newest(), self._streamer.player
        if received is None or player is None:
            return None
        position = self._guarded('joint_states', lambda: joint_positions(
            deserialized(received.data, JointState), player.joint_names))
        return None if position is None else (position, self._states.age(received))

    def _guarded(self, topic: str, use: Callable[[], T]) -> T | None:
        """Use a message, or refuse it; the next report logs the reason."""
        try:
            return use()
        except GdmpError as error:
            self._streamer.refusals.add(f'{topic}: {error}')
            return None
