"""What a server hears: goals, changes of the motion, the robot and its gripper."""
from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, TypeVar

from gdmp_msgs.msg import GripperCommand as CommandMessage
from gdmp_msgs.msg import GripperState as StateMessage
from gdmp_msgs.msg import MovingGoal
from geometry_msgs.msg import PoseStamped
import numpy as np
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, Float64MultiArray

from gdmp_ros.control.gripper import GripperCommand, GripperState
from gdmp_ros.data.bags import joint_positions, vector_numbers
from gdmp_ros.errors import GdmpError
from gdmp_ros.playback.measured_input import MeasuredInput
from gdmp_ros.playback.objects import Located
from gdmp_ros.playback.streamer import Streamer
from gdmp_ros.realtime.loop import Clock, NS
from gdmp_ros.ros.frames import BaseFrame, FrameError
from gdmp_ros.ros.gripper import command_message, state_of
from gdmp_ros.ros.lifecycle import ManagedNode
from gdmp_ros.ros.middleware import deserialized, Subscription
from gdmp_ros.ros.serialized import PoseReader, stamp_ns_of

#: Oldest stamp of a goal that is believed, before its arrival [s].
STAMP_S = 0.5
#: Oldest state that counts [s].
STATE_S = 1.0
#: A stream that was silent for this time may have been held up, and what comes within this time
#: afterwards may be old [s].
GAP_S, AFTER_GAP_S = 0.2, 2.0


class GoalInput:
    """
    A topic of which the newest goal counts; one in a frame that is not known yet waits for it.

    :ivar topic: its name, for messages
    :ivar subscription: to it
    """

    def __init__(self, clock: Clock, subscription: Subscription, topic: str,
                 use: Callable[[bytes, float], None], refuse: Callable[[str], None]):
        """
        Prepare.

        :param subscription: without a callback
        :param use: called with a message and the time since it arrived [s]; raises a `GdmpError`
            to refuse it
        :param refuse: called with the reason
        """
        self.topic = topic
        self._clock, self.subscription = clock, subscription
        self._use, self._refuse = use, refuse
        self._waiting: tuple[bytes, float] | None = None

    @property
    def waits(self) -> bool:
        """Whether a goal waits for its frame."""
        return self._waiting is not None

    def discard(self) -> None:
        """Discard the goals that have come."""
        self._waiting = None
        self.subscription.discard()

    def poll(self, timeout: float) -> None:
        """
        Use the newest goal.

        :param timeout: for its frame [s]
        """
        received, now = self.subscription.newest(), self._clock.now() / NS
        if received is not None:
            self._waiting = received.data, now - self.subscription.age(received)
        if self._waiting is None:
            return
        data, arrived = self._waiting
        try:
            self._use(data, now - arrived)
        except GdmpError as error:
            if isinstance(error, FrameError) and now - arrived < timeout:
                return
            self._refuse(f'{self.topic}: {error}')
        self._waiting = None


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
            # A goal that moves is measured, again and again.
            GoalInput(node.clock, node.add_sensor(kind, f'~/{topic}') if kind is MovingGoal else
                      node.add_subscription(kind, f'~/{topic}', None), topic, use,
                      streamer.refusals.add)
            for kind, topic, use in ((PoseStamped, 'goal_pose', self._use_pose),
                                     *(second if second_arm else ()),
                                     (MovingGoal, 'moving_goal', self._use_moving),
                                     (Float64MultiArray, 'goal_stiffness', self._use_stiffness),
                                     (Float64, 'amplitude', self._use_amplitude),
                                     (Float64, 'frequency', self._use_frequency))]

    @property
    def subscriptions(self) -> list[Subscription]:
        """All of them."""
        return [topic.subscription for topic in self._inputs]

    @property
    def waiting(self) -> bool:
        """Whether a goal waits for its frame."""
        return any(topic.waits for topic in self._inputs)

    def discard(self) -> None:
        """Discard the messages that have come."""
        for topic in self._inputs:
            topic.discard()

    def poll(self, timeout: float) -> None:
        """
        Use the newest messages.

        :param timeout: for the frame of a pose [s]
        """
        for topic in self._inputs:
            topic.poll(timeout)

    def _use_pose(self, data: bytes, age: float, side: int = 0) -> None:
        self._commands.goal_pose(self._poses.read(data), self._streamer.now,
                                 self._age(data, age), side)

    def _use_moving(self, data: bytes, age: float) -> None:
        message = deserialized(data, MovingGoal)
        twist = np.array(vector_numbers(message.twist.linear, message.twist.angular))
        self._commands.moving_goal(*self._base.moving(message, twist), self._streamer.now,
                                   self._age(data, age))

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


class GripperTopics:
    """Sends commands, and knows the newest state."""

    def __init__(self, node: ManagedNode, prefix: str):
        """:param prefix: of the topics"""
        self._node = node
        self._commands = node.add_publisher(CommandMessage, f'{prefix}/command', 10)
        # Polled: read while a skill with commands is played.
        self._states = node.add_subscription(StateMessage, f'{prefix}/state', None)
        self._state: tuple[GripperState, int] | None = None

    def send(self, command: GripperCommand) -> None:
        """Let the gripper begin a command."""
        self._commands.publish(command_message(command, self._node.stamp()))

    def state(self) -> GripperState | None:
        """The newest state; None if nothing is known of the gripper."""
        message, now = self._states.newest_message(), self._node.clock.now()
        if message is not None:
            self._state = state_of(message), now
        if self._state is None or now - self._state[1] > STATE_S * NS:
            return None
        return self._state[0]


class ObjectsOnTf:
    """Where objects are, by /tf and /tf_static."""

    def __init__(self, node: ManagedNode, base: BaseFrame):
        """:param base: frame of the motions"""
        self._node, self._base = node, base

    def catch_up(self) -> None:
        """Read all transforms that have been received."""
        self._base.catch_up()

    def locate(self, name: str) -> Located:
        """
        Where an object is.

        :raises FrameError: if it is not known
        """
        pose, stamp_ns = self._base.newest(name)
        age = (self._node.time_ns() - stamp_ns) / NS if stamp_ns else 0.0
        return Located(pose, stamp_ns, age)


class HeldUp:
    """
    By how much a network has held messages up, by their stamps, whatever their clock is.

    After a gap the messages that were held up in it come first. A stamp that is missing, or moves
    at another rate, says nothing: only what follows a gap is compared, with what came before it.
    """

    def __init__(self) -> None:
        self._usual: int | None = None
        self._arrived = self._until = 0

    def by(self, stamp_ns: int, arrived_ns: int) -> float:
        """Note a message; how much longer than usual it was on its way [s]."""
        late = arrived_ns - stamp_ns
        if arrived_ns - self._arrived > GAP_S * NS:
            self._until = arrived_ns + round(AFTER_GAP_S * NS)
        self._arrived = arrived_ns
        if stamp_ns == 0 or self._usual is None or arrived_ns >= self._until:
            self._usual = None if stamp_ns == 0 else late
            return 0.0
        return max(late - self._usual, 0) / NS


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
        self._states = node.add_sensor(JointState, joints)
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
        poses, held_up = node.add_sensor(PoseStamped, topic), HeldUp()

        def newest() -> tuple[np.ndarray, float] | None:
            received = poses.newest()
            pose = None if received is None else self.read_pose(received.data)
            if received is None or pose is None:
                return None
            late = held_up.by(stamp_ns_of(received.data), received.arrived or node.time_ns())
            return pose, poses.age(received) + late
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
