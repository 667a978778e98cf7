"""Publishes the state of the arm."""
from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

from gdmp_msgs.msg import RobotState
import numpy as np

from gdmp_ros.control.measurement import Tick
from gdmp_ros.realtime.loop import Clock, Loop, NS, periodic
from gdmp_ros.ros.arm.tf_publisher import TfPublisher
from gdmp_ros.ros.lifecycle import (
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

#: Messages for viewers between two looks for subscribers, and between two of the links.
LOOK_EVERY, LINKS_EVERY = 10, 2
_NOTHING = np.empty(0)


class StatePublisher:
    """
    Publishes ``~/state`` in every tick; pose, stiffness, joints and links for viewers.

    A loop of its own serves the viewers (`show`): what it takes does not hold the arm up.

    :ivar tf: publisher of the links
    :ivar states: publisher of ``~/state``
    :ivar templates: of its messages, without and with a reference of the joints
    :ivar numbers: of the last tick (`gdmp_ros.ros.messages.robot_state_numbers`), with room for a
        reference of the joints
    :ivar written: number of the tick that was begun to be written, of the one that is whole, and
        its stamp [ns], whether states have subscribers, and whether the joints follow a
        reference: a loop without the interpreter writes and reads them too
    :ivar others: gives positions of a gripper and of objects
    """

    def __init__(self, node: ManagedNode, frame: str, joints: Sequence[str], rate_hz: float,
                 prefix: str = ''):
        """
        Create the publishers.

        :param frame: ``frame_id`` of the states
        :param joints: names of the joints
        :param rate_hz: of messages for viewers
        :param prefix: of ``joint_states``, which a driver of the arm may publish itself
        """
        self.states = node.add_publisher(RobotState, '~/state', DEEP)

        def template(rows: int) -> SerializedTemplate:
            state = RobotState()
            state.header.frame_id = frame
            return SerializedTemplate(state, ROBOT_STATE_FIXED + rows * len(joints),
                                      partial(fill_robot_state, rows=rows))
        # The messages have different sizes.
        self.templates = template(3), template(6)
        self._state, self._joint_state = (Stream(self.states, one) for one in self.templates)
        self._pose = pose_stream(node, '~/measured_pose', frame)
        self._applied = stiffness_stream(node, '~/applied_stiffness')
        self._requested = stiffness_stream(node, '~/requested_stiffness')
        self._joints = joints_stream(node, f'{prefix}joint_states', joints)
        self.tf = TfPublisher(node)
        self.numbers = np.zeros(ROBOT_STATE_FIXED + 6 * len(joints))
        self.written = np.zeros(5, dtype=np.int64)
        self.others: Callable[[], np.ndarray] = lambda: _NOTHING
        self._rate_hz, self._count = rate_hz, len(joints)

    def publish(self, tick: Tick, stamp_ns: int, sequence: int) -> None:
        """
        Publish the state of a tick.

        :param sequence: of the reference that was followed
        """
        number, numbers = int(self.written[0]) + 1, robot_state_numbers(tick)
        self.written[0] = number
        self.numbers[:len(numbers)] = numbers
        self.written[1:3] = number, stamp_ns
        if self._state.has_subscribers:
            state = self._state if tick.joints is None else self._joint_state
            state.publish(numbers, stamp_ns, sequence, tick.mode, number)

    def last(self) -> tuple[np.ndarray, int]:
        """Numbers and stamp of the last tick [ns], whole: any thread may call it."""
        while True:
            whole, stamp_ns = self.written[1:3].tolist()
            numbers = self.numbers.copy()
            if self.written[0] == whole:
                return numbers, stamp_ns

    def show(self, clock: Clock) -> Loop:
        """Serve the viewers, and look for subscribers."""
        self._check()
        turn = 0

        def step(deadline_ns: int, now_ns: int) -> None:
            nonlocal turn
            turn += 1
            if turn % LOOK_EVERY == 0:
                self._check()
            self._show(turn % LINKS_EVERY == 0)
        return periodic(step, round(NS / self._rate_hz), clock)

    def _check(self) -> None:
        check_subscribers(self._state, self._pose, self._applied, self._requested, self._joints)
        self.tf.check()
        self.written[3] = self._state.has_subscribers

    def _show(self, links: bool) -> None:
        """Publish the last tick to those who look; the links, too, if wanted."""
        links &= self.tf.has_subscribers
        shown = self._pose, self._applied, self._requested, self._joints
        if not (links or any(one.has_subscribers for one in shown)):
            return
        numbers, stamp_ns = self.last()
        joints = numbers[ROBOT_STATE_FIXED:][:3 * self._count]
        if self._pose.has_subscribers:
            self._pose.publish(numbers[:7], stamp_ns)
        if self._applied.has_subscribers:
            self._applied.publish(numbers[19:55])
        if self._requested.has_subscribers:
            self._requested.publish(numbers[55:91])
        if self._joints.has_subscribers:
            self._joints.publish(joints, stamp_ns)
        if links:
            self.tf.publish(np.concatenate([joints[:self._count], self.others()]), stamp_ns)
