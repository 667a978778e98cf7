"""Topics that change the motion that is executed: goals, amplitude and frequency of a cycle."""
from __future__ import annotations

from functools import partial

from gdmp_msgs.msg import MovingGoal
from geometry_msgs.msg import PoseStamped
import numpy as np
from std_msgs.msg import Float64, Float64MultiArray

from gdmp_ros.data.message_numbers import vector_numbers
from gdmp_ros.playback.streamer import Streamer
from gdmp_ros.realtime.loop import NS
from gdmp_ros.ros.frames import BaseFrame
from gdmp_ros.ros.lifecycle import ManagedNode
from gdmp_ros.ros.middleware import deserialized
from gdmp_ros.ros.serialized import PoseReader, stamp_ns_of
from gdmp_ros.ros.server.goal_input import GoalInput

#: Oldest stamp of a goal that is believed, before its arrival [s].
STAMP_S = 0.5


class GoalTopics:
    """Polled topics; of each the newest message counts."""

    def __init__(self, node: ManagedNode, streamer: Streamer, base: BaseFrame, frame_id: str,
                 second_arm: bool = False):
        """
        Subscribe.

        :param base: frame of the motions; goal poses may be in others
        :param frame_id: its name
        :param second_arm: whether there are goals for one
        """
        self._node, self._base = node, base
        self._streamer, self._commands = streamer, streamer.commands
        self._poses = PoseReader(frame_id, base.pose)
        second = [(PoseStamped, 'second/goal_pose', partial(self._use_pose, side=1))]
        self._inputs = [
            GoalInput(node.clock, node.add_subscription(kind, f'~/{topic}', None), topic, use,
                      streamer.refusals.add)
            for kind, topic, use in ((PoseStamped, 'goal_pose', self._use_pose),
                                     *(second if second_arm else ()),
                                     (MovingGoal, 'moving_goal', self._use_moving),
                                     (Float64MultiArray, 'goal_stiffness', self._use_stiffness),
                                     (Float64, 'amplitude', self._use_amplitude),
                                     (Float64, 'frequency', self._use_frequency))]

    def discard(self) -> None:
        """Discard the messages that have come."""
        for one in self._inputs:
            one.discard()

    def poll(self, timeout: float) -> None:
        """
        Use the newest messages.

        :param timeout: for the frame of a pose [s]
        """
        for one in self._inputs:
            one.poll(timeout)

    def _use_pose(self, data: bytes, age: float, side: int = 0) -> None:
        self._commands.goal_pose(self._poses.read(data), self._streamer.now,
                                 self._age(data, age), side)

    def _use_moving(self, data: bytes, age: float) -> None:
        message = deserialized(data, MovingGoal)
        twist = np.array(vector_numbers(message.twist.linear, message.twist.angular))
        self._commands.moving_goal(*self._base.moving(message, twist), self._age(data, age))

    def _use_stiffness(self, data: bytes, age: float) -> None:
        self._commands.goal_stiffness(deserialized(data, Float64MultiArray).data)

    def _use_amplitude(self, data: bytes, age: float) -> None:
        self._commands.amplitude(deserialized(data, Float64).data)

    def _use_frequency(self, data: bytes, age: float) -> None:
        self._commands.frequency(deserialized(data, Float64).data)

    def _age(self, data: bytes, arrived: float) -> float:
        """
        Time since the stamp of a message; since its arrival if the stamp is not of this clock [s].

        A stamp is believed if it lies up to `STAMP_S` before the arrival.
        """
        stamped = (self._node.time_ns() - stamp_ns_of(data)) / NS
        return stamped if arrived - 1e-3 <= stamped <= arrived + STAMP_S else arrived
