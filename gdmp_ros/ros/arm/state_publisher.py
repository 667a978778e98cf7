"""Publishes the state of the arm."""
from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from gdmp_msgs.msg import RobotState
import numpy as np
from sensor_msgs.msg import JointState

from gdmp_ros.control.tick import Tick
from gdmp_ros.ros.arm.tf_publisher import TfPublisher
from gdmp_ros.ros.lifecycle import DEEP, ManagedNode
from gdmp_ros.ros.messages import (
    fill_robot_state,
    ROBOT_STATE_FIXED,
    robot_state_numbers,
    stamp_of,
)
from gdmp_ros.ros.serialized import SerializedTemplate
from gdmp_ros.ros.streams import (
    CHECK_EVERY,
    check_subscribers,
    pose_stream,
    stiffness_stream,
    Stream,
)

NOTHING = np.empty(0)


class StatePublisher:
    """
    Publishes ``~/state`` in every tick; pose, stiffness, joints and links for viewers.

    :ivar tf: publisher of the links
    """

    def __init__(self, node: ManagedNode, frame: str, joints: Sequence[str], viewer_every: int):
        """
        Create the publishers.

        :param frame: ``frame_id`` of the states
        :param joints: names of the joints
        :param viewer_every: ticks between two messages for viewers
        """
        states = node.add_publisher(RobotState, '~/state', DEEP)

        def stream(rows: int) -> Stream:
            state = RobotState()
            state.header.frame_id = frame
            return Stream(states, SerializedTemplate(
                state, ROBOT_STATE_FIXED + rows * len(joints),
                partial(fill_robot_state, rows=rows)))
        # Without and with a reference of the joints: the messages have different sizes.
        self._state, self._joint_state = stream(3), stream(6)
        self._pose = pose_stream(node, '~/measured_pose', frame)
        self._applied = stiffness_stream(node, '~/applied_stiffness')
        self._requested = stiffness_stream(node, '~/requested_stiffness')
        self._joints = node.add_publisher(JointState, 'joint_states', 10)
        self._joint_message = JointState(name=list(joints))
        self.tf = TfPublisher(node)
        self._viewer_every = viewer_every
        self._ticks = 0

    def publish(self, tick: Tick, stamp_ns: int, sequence: int,
                others: np.ndarray = NOTHING) -> None:
        """
        Publish the state of a tick.

        :param sequence: of the reference that was followed
        :param others: positions of a gripper and of objects
        """
        if self._ticks % CHECK_EVERY == 0:
            check_subscribers(self._state, self._pose, self._applied, self._requested)
        self._ticks += 1
        if self._state.has_subscribers:
            state = self._state if tick.joints is None else self._joint_state
            state.publish(robot_state_numbers(tick), stamp_ns, sequence, tick.mode, self._ticks)
        if self._ticks % self._viewer_every == 0:
            self._publish_for_viewers(tick, stamp_ns, others)

    def _publish_for_viewers(self, tick: Tick, stamp_ns: int, others: np.ndarray) -> None:
        measured = tick.measurement
        if self._pose.has_subscribers:
            self._pose.publish(measured.pose, stamp_ns)
        if self._applied.has_subscribers:
            self._applied.publish(tick.stiffness)
        if self._requested.has_subscribers:
            self._requested.publish(tick.requested)
        self._joint_message.header.stamp = stamp_of(stamp_ns)
        self._joint_message.position = measured.position.tolist()
        self._joint_message.velocity = measured.velocity.tolist()
        self._joint_message.effort = tick.torque.tolist()
        self._joints.publish(self._joint_message)
        self.tf.publish(np.concatenate([measured.position, others]), stamp_ns)
