"""A Franka Research 3 that follows references under 1 kHz impedance control."""
from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rosgraph_msgs.msg import Clock as ClockMessage

from gdmp_ros.control.arm_driver import ArmStopped
from gdmp_ros.control.measurement import Tick
from gdmp_ros.control.plain_tick import is_event, OTHER
from gdmp_ros.franka.channel import Channel, CYCLE_S
from gdmp_ros.franka.driver import FrankaDriver
from gdmp_ros.franka.plain_cycle import link_of
from gdmp_ros.franka.robot import FrankaRobot, opened
from gdmp_ros.franka.settings import FrankaSettings
from gdmp_ros.realtime.loop import Loop, NS, thread_cpu_ns
from gdmp_ros.realtime.native import prepared
from gdmp_ros.realtime.statistics import LatenessRecorder
from gdmp_ros.ros.arm.backend import ArmBackend
from gdmp_ros.ros.arm.compiled_loop import MODE, SEQUENCE
from gdmp_ros.ros.arm.franka_loop import (
    ANSWERED,
    FrankaLoop,
    MISSED,
    robot_stamp,
    STAMPED,
    UNDECIDED,
    warm_up,
    WORKED,
)
from gdmp_ros.ros.arm.node import ArmNode
from gdmp_ros.ros.arm.parameters import FRANKA
from gdmp_ros.ros.messages import CPU_TIME, IN_TIME, LOST, stamp_of
from gdmp_ros.ros.middleware import CLOCK_DEPTH, Publisher
from gdmp_ros.ros.parameters import settings_from
from gdmp_ros.ros.running import run
from gdmp_ros.sim.arm import Arm

#: Distance between the tool of the model and that of the robot that is worth a warning [m].
MISPLACED_M = 0.002
#: Time for others before the loop waits for the next state [ns].
OTHERS_NS = 1000
#: Time between two looks at a robot that does not answer [ns].
SILENT_NS = 50_000_000


class FrankaArm(ArmBackend):
    """A Franka, by its own protocol."""

    name, specs = 'franka_arm', FRANKA
    _driver: FrankaDriver | None = None
    _clock_out: Publisher | None = None
    _compiled: FrankaLoop | None = None

    def __init__(self, opened: Callable[[str, Any], tuple[Any, Channel]] = opened) -> None:
        """:param opened: connects to a robot"""
        self._opened = opened

    def open(self) -> FrankaDriver:
        node, p = self.node, self.node.parameters
        robot = FrankaRobot(settings_from(p, FrankaSettings), self._opened)
        self.model, self.period = Arm('fr3'), CYCLE_S
        driver = self._driver = FrankaDriver(robot, p.rotor_inertia, p.wall_time)
        if driver.misplaced > MISPLACED_M:
            node.get_logger().warning(
                f'the tool of the model is {driver.misplaced:.3f} m from where the robot says: is '
                'it a Franka Research 3? The pose of the model is used')
        if not p.enforce_realtime:
            node.get_logger().warning(
                'enforce_realtime is off: without a PREEMPT_RT kernel and SCHED_FIFO the robot '
                'may stop after lost cycles')
        return driver

    def offer(self) -> None:
        node = self.node
        clock = self._clock_out = (
            node.add_publisher(ClockMessage, '/clock', CLOCK_DEPTH)
            if node.parameters.publish_clock else None)
        driver, commands = self._driver, node.commands
        loop = self._compiled = prepared(
            lambda: FrankaLoop(commands.references, commands.reader, node.state_out, clock),
            node.get_logger().warning)
        if loop is not None and driver is not None:
            warm_up(node.control, link_of(driver))
            commands.called = loop.call

    def begin(self) -> None:
        self.node.lateness = LatenessRecorder(round(CYCLE_S * NS))
        self._work = LatenessRecorder(NS)
        self._stamp_ns = self._answered = 0

    def beside(self) -> list[Loop]:
        loop, clock = self._compiled, self.node.clock
        return [] if loop is None else [loop.sending(clock), loop.heralding(clock)]

    def close(self) -> None:
        if self._driver is not None:
            self._driver.robot.close()
            self._driver = None

    def cycles(self) -> Loop:
        node, driver, loop = self.node, self._driver, self._compiled
        if driver is None:
            return
        control, commands, clock = node.control, node.commands, node.clock
        worked = thread_cpu_ns()
        if loop is not None:
            loop.begin(round(CYCLE_S * NS))
        while True:
            commands.carry_out()
            if loop is not None and loop.may_go_on(self._only_goes_on):
                worked, goes_on = self._without_interpreter(loop, driver, worked)
                if goes_on:
                    yield clock.now()
                    continue
            measured = control.wait()
            if measured is None:
                yield clock.now() + SILENT_NS
                continue
            stamp = self._stamp(driver)
            commands.take_references(stamp)
            tick = control.answer(measured)
            self._publish(tick, stamp)
            robot_ns = round(driver.robot.seconds * NS)
            node.lateness.add(robot_ns, robot_ns + clock.now() - driver.robot.channel.arrived)
            yield clock.now() + OTHERS_NS
            # All that this thread has computed since the last cycle: reading, too.
            worked, last = thread_cpu_ns(), worked
            self._work.add(last, worked)

    def _publish(self, tick: Tick, stamp: int) -> None:
        if self._compiled is not None:
            self._compiled.flush(self.node.clock)  # in order
        self.node.state_out.publish(tick, stamp, self.node.commands.sequence)
        if self._clock_out is not None:
            self._clock_out.publish(ClockMessage(clock=stamp_of(stamp)))

    def _only_goes_on(self) -> bool:
        """Whether the next cycle may be one that a kernel makes."""
        node, driver = self.node, self._driver
        return (node.active and not node.commands.asked and driver is not None
                and driver.controlled and node.control.only_goes_on)

    def _without_interpreter(self, loop: FrankaLoop, driver: FrankaDriver, worked: int
                             ) -> tuple[int, bool]:
        """
        Let compiled code answer the robot until Python is needed.

        :param worked: CPU time of this thread at the last answer [ns]
        :returns: the same, now; and whether compiled code may answer the next state, too
        """
        node, numbers = self.node, loop.numbers
        commands, control = node.commands, node.control
        numbers[SEQUENCE], numbers[MODE] = commands.sequence, control.states.state.mode
        numbers[STAMPED], numbers[WORKED], numbers[MISSED] = self._stamp_ns, worked, 0
        numbers[ANSWERED] = self._answered
        why = loop.answer(control, driver, node.lateness, self._work)
        made = bool(numbers[ANSWERED] != self._answered)
        if made:
            self._stamp_ns, self._answered = int(numbers[STAMPED]), int(numbers[ANSWERED])
            commands.sequence = int(numbers[SEQUENCE])
            driver.lost += int(numbers[MISSED])
            driver.catch_up(control.controller.memory.torque)
            if not is_event(why):
                control.catch_up()
        if is_event(why):
            tick = control.end_tick(why)
            try:
                driver.command(tick.torque)
            except ArmStopped as error:
                control.fail(str(error))
            self._publish(tick, self._stamp_ns)
        if numbers[UNDECIDED]:
            # Others wait behind it.
            commands.offer(loop.message, int(numbers[UNDECIDED]))
            commands.take_references(self._next_stamp(driver))
        return int(numbers[WORKED]), why != OTHER

    def _stamp(self, driver: FrankaDriver) -> int:
        """Take the time of the present state: of the robot if it makes the clock, else of day."""
        self._stamp_ns = self._next_stamp(driver)
        self._answered = driver.robot.channel.number
        return self._stamp_ns

    def _next_stamp(self, driver: FrankaDriver) -> int:
        if self._clock_out is None:
            return self.node.clock.wall()
        return int(robot_stamp(self._stamp_ns, self._answered, driver.robot.channel.number))

    def diagnosed(self) -> dict[str, Any]:
        driver = self._driver
        if driver is None:
            return {}
        work, (inertia, jacobian) = self._work.punctuality(1000), driver.differences
        return {IN_TIME: f'{driver.robot.success_rate:.3f}', LOST: driver.lost,
                'difference of the model': f'inertia {inertia:.1%}, Jacobian {jacobian:.4f} m',
                CPU_TIME: f'{work.p50_us:.0f}, {work.p99_us:.0f}'}


def node() -> ArmNode:
    """Return the node ``franka_arm``."""
    return ArmNode(FrankaArm())


def main(arguments: list[str] | None = None) -> int:
    """Run the node ``franka_arm``."""
    return run([node], arguments)


if __name__ == '__main__':
    raise SystemExit(main())
