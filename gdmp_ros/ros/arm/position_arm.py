"""
An arm that takes joint positions, behind ros2_control or a robot's own driver.

It follows the same references as an arm with torques: an admittance answers to the wrench that a
sensor at its wrist measures (`gdmp_ros.control.admittance`).
"""
from __future__ import annotations

from typing import Any

from geometry_msgs.msg import WrenchStamped
import numpy as np
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, Float64MultiArray
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from gdmp_ros.control.admittance import AdmittanceSettings, ServoState
from gdmp_ros.data.bags import vector_numbers
from gdmp_ros.errors import DataError, GdmpError
from gdmp_ros.realtime.loop import Loop, NS, periodic
from gdmp_ros.realtime.statistics import LatenessRecorder
from gdmp_ros.ros.arm.backend import ArmBackend
from gdmp_ros.ros.arm.node import ArmNode
from gdmp_ros.ros.arm.parameters import POSITION
from gdmp_ros.ros.lifecycle import Stream
from gdmp_ros.ros.messages import fill_wrench
from gdmp_ros.ros.parameters import settings_from
from gdmp_ros.ros.running import run
from gdmp_ros.ros.serialized import AlikeReader, SerializedTemplate
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.position_driver import PositionDriver
from gdmp_ros.util.names import indices_of

#: Time in which the arm has to say where it is, and time between two looks [ns].
FIRST_NS, LOOK_NS = 15 * NS, 10_000_000
#: Ticks that are late pass as one, up to this many.
MOST_LATE = 10
#: Lengths of messages with joints that are known at once.
MOST_LAYOUTS = 8


class TopicLink:
    """
    The topics of an arm; see `gdmp_ros.control.admittance.PositionLink`.

    :ivar cycle: time between two commands [s]
    :ivar problem: why the last message could not be used; empty if it could
    """

    def __init__(self, node: ArmNode, names: list[str]):
        """:param names: of the joints, as the model has them"""
        p = node.parameters
        self.cycle, self.problem = 1.0 / p.rate_hz, ''
        self._clock, self._names = node.clock, names
        self._joints = node.add_sensor(JointState, p.joint_states_topic)
        # A gripper may say where its joints are on the same topic.
        self._layouts: dict[int, _Layout] = {}
        self._felt_reader = AlikeReader(WrenchStamped, lambda message: vector_numbers(
            message.wrench.force, message.wrench.torque), fill_wrench, lambda _: [])
        self._wrenches = node.add_sensor(WrenchStamped, p.wrench_topic) if p.wrench_topic else None
        # A driver says it once.
        self._running = (node.add_subscription(Bool, p.running_topic, None, late=True)
                         if p.running_topic else None)
        self._runs = True
        self._state: ServoState | None = None
        self._when = self._felt = node.clock.wall()
        order = [name for name in p.joint_names if name] or names
        if len(order) != len(names):
            raise DataError(f'joint_names has {len(order)} names, expected {len(names)}: '
                            f'{", ".join(names)}')
        self._order = indices_of(order, names, 'joint')
        self._horizon = (p.horizon if p.output == 'joint_trajectory_controller' else 0.0)
        self._commands = (_trajectories(node, p.command_topic, order, p.horizon) if self._horizon
                          else _positions(node, p.command_topic, len(order)))

    def read(self) -> ServoState | None:
        """The newest state, and how old it is; None if there was none yet."""
        received = self._joints.newest()
        felt = None if self._wrenches is None else self._wrenches.newest()
        try:
            if received is not None:
                self._take(received.data, received.arrived or self._clock.wall())
                self.problem = ''
            if felt is not None and self._state is not None:
                self._state = self._state._replace(wrench=self._felt_reader.read(felt.data)[0])
                self._felt = felt.arrived or self._clock.wall()
        except GdmpError as error:
            # Others may use the topic, too; how old the state is is judged anyway.
            if self._state is None:
                self.problem = f'{self._joints.topic}: {error}'
        said = None if self._running is None else self._running.newest_message()
        if said is not None:
            self._runs = said.data
        if self._state is None:
            return None
        now = self._clock.wall()
        return self._state._replace(age=(now - self._when) / NS, runs=self._runs,
                                    wrench_age=(now - self._felt) / NS)

    def _take(self, data: bytes, arrived: int) -> None:
        """Read a JointState; without velocities they are differences."""
        if len(data) not in self._layouts:
            if len(self._layouts) >= MOST_LAYOUTS:
                self._layouts.clear()
            self._layouts[len(data)] = _Layout(self._names)
        position, found = self._layouts[len(data)].read(data)
        last, wrench = self._state, None
        velocity = np.zeros_like(position)
        if found is not None:
            velocity = found
        elif last is not None and arrived > self._when:
            velocity = (position - last.position) / ((arrived - self._when) / NS)
        if last is not None:
            wrench = last.wrench
        elif self._wrenches is not None:
            wrench = np.zeros(6)
        self._state, self._when = ServoState(position, velocity, wrench), arrived

    def send(self, position: np.ndarray, velocity: np.ndarray) -> None:
        """Send a command."""
        numbers = position[self._order]
        if self._horizon:
            # A point that is to be reached at once is reached with a jerk.
            rates = velocity[self._order]
            numbers = np.concatenate([numbers + self._horizon * rates, rates])
        self._commands.publish(numbers)


def _positions(node: ArmNode, topic: str, count: int) -> Stream:
    """Commands of a ``forward_position_controller``."""
    def fill(message: Float64MultiArray, numbers: np.ndarray) -> None:
        message.data = numbers.tolist()
    return Stream(node.add_publisher(Float64MultiArray,
                                     topic or 'forward_position_controller/commands', 1),
                  SerializedTemplate(Float64MultiArray(), count, fill))


def _trajectories(node: ArmNode, topic: str, names: list[str], horizon: float) -> Stream:
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


class _Layout:
    """Where the joints of an arm are in messages of one length."""

    def __init__(self, names: list[str]):
        self._names, self._problem = names, ''
        self._reader = AlikeReader(JointState, _numbers_of, _fill, _parts)
        self._chosen, self._count, self._has_velocity = np.empty(0, dtype=int), 0, False

    def read(self, data: bytes) -> tuple[np.ndarray, np.ndarray | None]:
        """
        Positions of the joints, and their velocities if they are told.

        :raises DataError: if the joints are not in the message
        """
        numbers, message = self._reader.read(data)
        if message is not None:
            self._learn(message)
        if self._problem:
            raise DataError(self._problem)
        return (numbers[self._chosen],
                numbers[self._count + self._chosen] if self._has_velocity else None)

    def _learn(self, message: JointState) -> None:
        self._count = len(message.name)
        self._has_velocity = len(message.velocity) == self._count
        self._problem = ('' if len(message.position) == self._count else
                         f'{len(message.position)} positions for {self._count} names')
        try:
            self._chosen = np.array(indices_of(self._names, message.name, 'joint'))
        except DataError as error:
            self._problem = str(error)


class PositionArm(ArmBackend):
    """An arm that takes joint positions."""

    name, specs, described = 'position_arm', POSITION, True
    guiding = 'only what the sensor measures moves the arm: guide it by hand'
    driver: PositionDriver
    link: TopicLink

    def open(self) -> PositionDriver:
        node, p = self.node, self.node.parameters
        self.model = Arm(p.model, p.tool_site)
        sensor = Arm(p.model, p.sensor_site).end_pose
        self.link = TopicLink(node, list(self.model.names))
        if not p.wrench_topic:
            node.get_logger().warning(
                'there is no sensor (wrench_topic): the arm follows stiffly, whatever the '
                'stiffness of its references')
        self._await()
        self.driver = PositionDriver(self.model, self.link,
                                     settings_from(p, AdmittanceSettings), sensor)
        return self.driver

    def _await(self) -> None:
        """:raises DataError: if nothing tells where the arm is"""
        clock, link = self.node.clock, self.link
        latest = clock.now() + FIRST_NS
        while link.read() is None:
            if clock.now() > latest:
                raise DataError(link.problem or 'no joint states have arrived on '
                                f'{self.node.parameters.joint_states_topic}: is the arm on?')
            clock.sleep_until(clock.now() + LOOK_NS)

    def offer(self) -> None:
        self.driver.use_memory(self.node.control.controller.memory)

    def begin(self) -> None:
        self._period_ns = round(self.link.cycle * NS)
        self.node.lateness = LatenessRecorder(self._period_ns)
        self._last = 0

    def cycles(self) -> Loop:
        return periodic(self._tick, self._period_ns, self.node.clock)

    def _tick(self, deadline_ns: int, now_ns: int) -> None:
        node, period = self.node, self._period_ns
        node.lateness.add(deadline_ns, now_ns)
        passed = (deadline_ns - self._last) // period if self._last else 1
        self._last, self.driver.dt = deadline_ns, min(passed, MOST_LATE) * period / NS
        stamp = node.clock.wall()
        node.commands.carry_out()
        measured = node.control.wait()
        if measured is None:
            return
        node.commands.take_references(stamp)
        tick = self.driver.reported(node.control.answer(measured))
        node.state_out.publish(tick, stamp, node.commands.sequence)

    def activity(self) -> str:
        if self.link.problem:
            self.node.get_logger().warning(self.link.problem, throttle_duration_sec=1.0)
        return ''

    def diagnosed(self) -> dict[str, Any]:
        force = float(np.linalg.norm(self.driver.wrench[:3]))
        return {'delay of the arm [ms]': f'{1e3 * self.driver.delay.value:.1f}',
                'external force [N]': f'{force:.1f}'}


def node() -> ArmNode:
    """Return the node ``position_arm``."""
    return ArmNode(PositionArm())


def main(arguments: list[str] | None = None) -> int:
    """Run the node ``position_arm``."""
    return run([node], arguments)


if __name__ == '__main__':
    raise SystemExit(main())
