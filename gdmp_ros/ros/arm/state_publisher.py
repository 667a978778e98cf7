"""Publishes the state of the arm."""
from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

from gdmp_msgs.msg import RobotState
import numpy as np

from gdmp_ros.control.tick import Tick
from gdmp_ros.ros.arm.tf_publisher import TfPublisher
from gdmp_ros.ros.lifecycle import (
    CHECK_EVERY,
    check_subscribers,
    joints_stream,
    ManagedNode,
    pose_stream,
    stiffness_stream,
    Stream,
)
from gdmp_ros.ros.messages import fill_robot_state, ROBOT_STATE_FIXED, robot_state_numbers
from gdmp_ros.ros.middleware import DEEP
from gdmp_ros.ros.serialized import SerializedTemplate

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
        self._joints = joints_stream(node, 'joint_states', joints)
        self.tf = TfPublisher(node)
        self._viewer_every = viewer_every
        self._for_viewers: tuple[Callable[[Tick, int, np.ndarray], None], ...] = (
            self._publish_pose, self._publish_links, self._publish_joints,
            self._publish_stiffness)
        self._ticks = 0

    def publish(self, tick: Tick, stamp_ns: int, sequence: int,
                others: np.ndarray = NOTHING) -> None:
        """
        Publish the state of a tick.

        :param sequence: of the reference that was followed
        :param others: positions of a gripper and of objects
        """
        if self._ticks % CHECK_EVERY == 0:
            check_subscribers(self._state, self._pose, self._applied, self._requested,
                              self._joints)
            self.tf.check()
        self._ticks += 1
        if self._state.has_subscribers:
            state = self._state if tick.joints is None else self._joint_state
            state.publish(robot_state_numbers(tick), stamp_ns, sequence, tick.mode, self._ticks)
        # One after the other: all in one tick would make a long one.
        for i, publish in enumerate(self._for_viewers):
            if (self._ticks + i) % self._viewer_every == 0:
                publish(tick, stamp_ns, others)

    def _publish_pose(self, tick: Tick, stamp_ns: int, _: np.ndarray) -> None:
        if self._pose.has_subscribers:
            self._pose.publish(tick.measurement.pose, stamp_ns)

    def _publish_stiffness(self, tick: Tick, *_: object) -> None:
        if self._applied.has_subscribers:
            self._applied.publish(tick.stiffness)
        if self._requested.has_subscribers:
            self._requested.publish(tick.requested)

    def _publish_joints(self, tick: Tick, stamp_ns: int, _: np.ndarray) -> None:
        if self._joints.has_subscribers:
            measured = tick.measurement
            self._joints.publish(
                np.concatenate([measured.position, measured.velocity, tick.torque]), stamp_ns)

    def _publish_links(self, tick: Tick, stamp_ns: int, others: np.ndarray) -> None:
        self.tf.publish(np.concatenate([tick.measurement.position, others]), stamp_ns)
