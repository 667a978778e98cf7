"""Publishes the state of the arm."""
from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
import math
from typing import NamedTuple

from gdmp_msgs.msg import RobotState
import numpy as np

from gdmp_ros.control.measurement import Tick
from gdmp_ros.realtime.loop import Clock, Loop, NS
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

#: Time between two looks for subscribers [ns], and messages of a part for one of the links.
LOOK_NS, LINKS_EVERY = 100_000_000, 2
_NOTHING = np.empty(0)


class StatePart(NamedTuple):
    """
    A part of the state that is published at a lower rate.

    :ivar first: of its numbers among those of the state
    :ivar numbers: how many it has
    """

    stream: Stream
    first: int
    numbers: int

    def publish(self, state: np.ndarray, stamp_ns: int) -> None:
        """Publish the part of a state, from the numbers of the state."""
        self.stream.publish(state[self.first:self.first + self.numbers], stamp_ns)


class StatePublisher:
    """
    Publishes ``~/state`` in every tick; pose, stiffness, joints and links at a lower rate.

    The links have a loop of their own (`show`): what it takes does not hold the arm up.

    :ivar tf: publisher of the links
    :ivar states: publisher of ``~/state``
    :ivar parts: of the state: measured pose, applied and requested stiffness, joints
    :ivar every: ticks between two messages of a part, shape (1,); the parts take turns
    :ivar wanted: whether the state has subscribers, and each part
    :ivar templates: of its messages, without and with a reference of the joints
    :ivar numbers: of the last tick (`gdmp_ros.ros.messages.robot_state_numbers`), with room for a
        reference of the joints
    :ivar written: number of the tick that was begun to be written, of the one that is whole, and
        its stamp [ns], and whether the joints follow a reference: a loop without the interpreter
        writes them too
    :ivar others: gives positions of a gripper and of objects
    """

    def __init__(self, node: ManagedNode, frame: str, joints: Sequence[str], period: float,
                 rate_hz: float, prefix: str = ''):
        """
        Create the publishers.

        :param frame: ``frame_id`` of the states
        :param joints: names of the joints
        :param period: of the ticks [s]
        :param rate_hz: largest one of the parts
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
        self.parts = [StatePart(*part) for part in (
            (pose_stream(node, '~/measured_pose', frame), 0, 7),
            (stiffness_stream(node, '~/applied_stiffness'), 19, 36),
            (stiffness_stream(node, '~/requested_stiffness'), 55, 36),
            (joints_stream(node, f'{prefix}joint_states', joints), ROBOT_STATE_FIXED,
             3 * len(joints)))]
        self.every = np.array([math.ceil(1.0 / (rate_hz * period) - 1e-9)])
        self.wanted = np.zeros(1 + len(self.parts), dtype=np.bool_)
        self.tf = TfPublisher(node)
        self.numbers = np.zeros(ROBOT_STATE_FIXED + 6 * len(joints))
        self.written = np.zeros(4, dtype=np.int64)
        self.others: Callable[[], np.ndarray] = lambda: _NOTHING
        self._repeats = 0
        self._links_ns, self._count = round(LINKS_EVERY * NS / rate_hz), len(joints)

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
        self._publish_parts(numbers, stamp_ns, number)

    def repeat(self) -> None:
        """Publish parts of the last tick again: time stands still."""
        self._repeats += 1
        self._publish_parts(*self.last(), self._repeats)

    def _publish_parts(self, numbers: np.ndarray, stamp_ns: int, number: int) -> None:
        for k, part in enumerate(self.parts):
            if part.stream.has_subscribers and (number - k) % self.every[0] == 0:
                part.publish(numbers, stamp_ns)

    def last(self) -> tuple[np.ndarray, int]:
        """Numbers and stamp of the last tick [ns], whole: any thread may call it."""
        while True:
            whole, stamp_ns = self.written[1:3].tolist()
            numbers = self.numbers.copy()
            if self.written[0] == whole:
                return numbers, stamp_ns

    def show(self, clock: Clock) -> Loop:
        """Look for subscribers again and again; publish the links while /tf has some."""
        look_at = 0
        while True:
            now = clock.now()
            if now >= look_at:
                self._check()
                look_at = now + LOOK_NS
            if self.tf.has_subscribers:
                self._show_links()
            yield now + (self._links_ns if self.tf.has_subscribers else LOOK_NS)

    def _check(self) -> None:
        streams = self._state, *(part.stream for part in self.parts)
        check_subscribers(*streams)
        self.tf.check()
        self.wanted[:] = [stream.has_subscribers for stream in streams]

    def _show_links(self) -> None:
        numbers, stamp_ns = self.last()
        position = numbers[ROBOT_STATE_FIXED:][:self._count]
        self.tf.publish(np.concatenate([position, self.others()]), stamp_ns)
