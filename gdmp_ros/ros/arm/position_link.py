"""The topics of an arm that takes joint positions: what it measures, and what it is told."""
from __future__ import annotations

from typing import Any, NamedTuple

from geometry_msgs.msg import WrenchStamped
import numpy as np
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, Float64, Float64MultiArray
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from gdmp_ros.control.servo import ServoState
from gdmp_ros.data.bags import vector_numbers
from gdmp_ros.errors import DataError, GdmpError
from gdmp_ros.kernels import kernel
from gdmp_ros.realtime.loop import NS
from gdmp_ros.ros.lifecycle import ManagedNode, Stream
from gdmp_ros.ros.messages import fill_wrench
from gdmp_ros.ros.serialized import Alike, AlikeReader, SerializedTemplate
from gdmp_ros.util.names import indices_of


class Heard(NamedTuple):
    """
    What was heard of an arm; kernels write it too.

    :ivar joints: position [rad] and velocity [rad/s], shape (2, n)
    :ivar wrench: that the sensor feels [N, Nm], shape (6,)
    :ivar arrived: when the joints came, wall time [ns], shape (1,)
    :ivar felt: the same of the wrench
    :ivar runs: whether the arm takes commands, 0 or 1, shape (1,)
    """

    joints: np.ndarray
    wrench: np.ndarray
    arrived: np.ndarray
    felt: np.ndarray
    runs: np.ndarray


class _Joints(NamedTuple):
    """
    Where the joints of an arm are in messages.

    :ivar problem: why they are not there; empty if they are
    :ivar chosen: index of the position of each joint
    :ivar total: number of joints in the message; velocities follow the positions
    """

    problem: str
    chosen: np.ndarray
    total: int
    has_velocity: bool


class TopicLink:
    """
    The topics of an arm; see `gdmp_ros.control.servo.PositionLink`.

    :ivar cycle: time between two commands [s]
    :ivar problem: why a message could not be used; empty as soon as it has been told
    :ivar heard: of the arm
    :ivar joints: subscription to where the joints are
    :ivar wrenches: subscription to what the sensor feels; None without one
    :ivar running: subscription to whether the arm takes commands; None if it always does
    :ivar commands: to the controller
    :ivar order: index of the joint of each number of a command
    :ivar horizon: see `command_numbers`
    """

    def __init__(self, node: ManagedNode, names: list[str]):
        """:param names: of the joints, as the model has them"""
        p = node.parameters
        self.cycle, self.problem = 1.0 / p.rate_hz, ''
        self._clock, self._names = node.clock, names
        self.joints = node.add_sensor(JointState, p.joint_states_topic)
        self._joint_reader = AlikeReader(JointState, _numbers_of, _fill, _parts, self._places)
        self._wrench_reader = AlikeReader(WrenchStamped, lambda message: vector_numbers(
            message.wrench.force, message.wrench.torque), fill_wrench, lambda _: [])
        self.wrenches = node.add_sensor(WrenchStamped, p.wrench_topic) if p.wrench_topic else None
        # A driver says it once.
        self.running = (node.add_subscription(Bool, p.running_topic, None, late=True)
                        if p.running_topic else None)
        self._scaling = (node.add_sensor(Float64, p.speed_scaling_topic)
                         if p.speed_scaling_topic else None)
        self._known, self._speed = False, 1.0
        # What the last messages of the arm are like.
        self._joints_like: Alike | None = None
        self._wrench_like: Alike | None = None
        now = np.array([node.clock.wall()])
        self.heard = Heard(np.zeros((2, len(names))), np.zeros(6), now, now.copy(), np.ones(1))
        order = [name for name in p.joint_names if name] or names
        if len(order) != len(names):
            raise DataError(f'joint_names has {len(order)} names, expected {len(names)}: '
                            f'{", ".join(names)}')
        self.order = np.array(indices_of(order, names, 'joint'))
        self.horizon = p.horizon if p.output == 'joint_trajectory_controller' else 0.0
        self.commands = (_trajectories(node, p.command_topic, order, p.horizon) if self.horizon
                         else _positions(node, p.command_topic, len(order)))
        self._numbers = np.zeros((2 if self.horizon else 1) * len(names))

    def read(self) -> ServoState | None:
        """The newest state, and how old it is; None if there was none yet."""
        for subscription, take in ((self.joints, self.take_joints),
                                   (self.wrenches, self.take_wrench),
                                   (self.running, self.take_running)):
            received = None if subscription is None else subscription.newest()
            if received is not None:
                take(received.data, received.arrived or self._clock.wall())
        if not self._known:
            return None
        now, heard = self._clock.wall(), self.heard
        position, velocity = heard.joints.copy()
        return ServoState(position, velocity,
                          None if self.wrenches is None else heard.wrench.copy(),
                          (now - int(heard.arrived[0])) / NS, (now - int(heard.felt[0])) / NS,
                          bool(heard.runs[0]))

    def take_joints(self, data: bytes, arrived: int) -> None:
        """Take a JointState; without velocities they are differences."""
        try:
            numbers, alike = self._joint_reader.read(data)
            if alike.about.problem:
                raise DataError(alike.about.problem)
        except GdmpError as error:
            # Others may use the topic, too; how old the state is is judged anyway.
            if not self._known:
                self.problem = f'{self.joints.topic}: {error}'
            return
        places, heard = alike.about, self.heard
        position, passed = numbers[places.chosen], (arrived - int(heard.arrived[0])) / NS
        if places.has_velocity:
            heard.joints[1] = numbers[places.total + places.chosen]
        elif self._known and passed > 0.0:
            heard.joints[1] = (position - heard.joints[0]) / passed
        heard.joints[0], heard.arrived[0] = position, arrived
        self._joints_like, self._known, self.problem = alike, True, ''

    def take_wrench(self, data: bytes, arrived: int) -> None:
        """Take a WrenchStamped."""
        try:
            self.heard.wrench[:], self._wrench_like = self._wrench_reader.read(data)
            self.heard.felt[0] = arrived
        except GdmpError as error:
            self.problem = str(error)

    def take_running(self, data: bytes, _: int) -> None:
        """Take a Bool."""
        said = None if self.running is None else self.running.message_of(data)
        if said is not None:
            self.heard.runs[0] = said.data

    def speed(self) -> float:
        """Share of its speed at which the arm executes commands, as it said last."""
        if self._scaling is None:
            return 1.0
        said = self._scaling.newest_message()
        if said is not None and 0.0 <= said.data <= 100.0:
            self._speed = said.data / 100.0
        elif said is not None:
            self.problem = f'{self._scaling.topic}: expected 0 to 100 percent, got {said.data}'
        return self._speed

    def joints_layout(self) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        """That of messages with `Heard.joints`, for kernels; None if these cannot read them."""
        layout = None if self._joints_like is None else self._joints_like.layout()
        if layout is None or self._joints_like is None or not self._joints_like.about.has_velocity:
            return None
        data, same, numbers = layout
        places = self._joints_like.about
        return data, same, numbers[np.concatenate([places.chosen, places.total + places.chosen])]

    def wrench_layout(self) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        """See `joints_layout`."""
        return None if self._wrench_like is None else self._wrench_like.layout()

    def _places(self, message: JointState) -> _Joints:
        count = len(message.name)
        problem, chosen = '', np.empty(0, dtype=np.int64)
        if len(message.position) != count:
            problem = f'{len(message.position)} positions for {count} names'
        try:
            chosen = np.array(indices_of(self._names, message.name, 'joint'))
        except DataError as error:
            problem = str(error)
        return _Joints(problem, chosen, count, len(message.velocity) == count)

    def send(self, position: np.ndarray, velocity: np.ndarray) -> None:
        """Send a command."""
        command_numbers(position, velocity, self.order, self.horizon, self._numbers)
        self.commands.publish(self._numbers)


@kernel
def command_numbers(position, velocity, order, horizon, numbers):
    """
    Write the numbers of a command.

    :param order: index of the joint of each number
    :param horizon: time after which a trajectory is to be where it leads [s]: a point that is to
        be reached at once is reached with a jerk; 0: positions only
    """
    for k in range(order.size):
        numbers[k] = position[order[k]] + horizon * velocity[order[k]]
        if horizon > 0.0:
            numbers[order.size + k] = velocity[order[k]]


def _positions(node: ManagedNode, topic: str, count: int) -> Stream:
    """Commands of a ``forward_position_controller``."""
    def fill(message: Float64MultiArray, numbers: np.ndarray) -> None:
        message.data = numbers.tolist()
    return Stream(node.add_publisher(Float64MultiArray,
                                     topic or 'forward_position_controller/commands', 1),
                  SerializedTemplate(Float64MultiArray(), count, fill))


def _trajectories(node: ManagedNode, topic: str, names: list[str], horizon: float) -> Stream:
    """
    Commands of a ``joint_trajectory_controller``: one point, with positions and velocities.

    Their stamp is 0: a trajectory begins at once.
    """
    point, ns = JointTrajectoryPoint(), round(horizon * NS)
    point.time_from_start.sec, point.time_from_start.nanosec = ns // NS, ns % NS

    def fill(message: JointTrajectory, numbers: np.ndarray) -> None:
        half = len(names)
        message.points[0].positions = numbers[:half].tolist()
        message.points[0].velocities = numbers[half:].tolist()
    return Stream(node.add_publisher(
        JointTrajectory, topic or 'joint_trajectory_controller/joint_trajectory', 1),
        SerializedTemplate(JointTrajectory(joint_names=names, points=[point]), 2 * len(names),
                           fill, headers=[]))


def _numbers_of(message: JointState) -> list[float]:
    return [*message.position, *message.velocity, *message.effort]


def _parts(message: JointState) -> list[Any]:
    return [len(message.name), *message.name, message.position, message.velocity, message.effort]


def _fill(message: JointState, numbers: np.ndarray) -> None:
    values = iter(numbers.tolist())
    for field in ('position', 'velocity', 'effort'):
        setattr(message, field, [next(values) for _ in getattr(message, field)])
