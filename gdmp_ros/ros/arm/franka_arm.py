"""A Franka Research 3 that follows references under 1 kHz impedance control."""
from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rosgraph_msgs.msg import Clock as ClockMessage

from gdmp_ros.franka.driver import CYCLE_S, FrankaDriver
from gdmp_ros.franka.robot import FrankaRobot, opened
from gdmp_ros.franka.settings import FrankaSettings
from gdmp_ros.realtime.loop import Loop, NS, thread_cpu_ns
from gdmp_ros.realtime.statistics import LatenessRecorder
from gdmp_ros.ros.arm.backend import ArmBackend
from gdmp_ros.ros.arm.node import ArmNode
from gdmp_ros.ros.arm.parameters import FRANKA
from gdmp_ros.ros.messages import CPU_TIME, IN_TIME, LOST, stamp_of
from gdmp_ros.ros.middleware import CLOCK_DEPTH, Publisher
from gdmp_ros.ros.parameters import settings_from
from gdmp_ros.ros.running import run
from gdmp_ros.sim.arm import Arm

#: Share of a cycle after which the loop waits for the next state. Before, other threads run:
#: libfranka keeps the interpreter while it waits.
YIELD_SHARE = 0.7
#: A longer cycle is not expected again [ns].
LONGEST_CYCLE_NS = 3_000_000
#: Distance between the tool of the model and that of the robot that is worth a warning [m].
MISPLACED_M = 0.002
#: Time between two looks at a robot that does not answer [ns].
SILENT_NS = 50_000_000


class FrankaArm(ArmBackend):
    """A Franka, by its own protocol."""

    name, specs = 'franka_arm', FRANKA
    _driver: FrankaDriver | None = None
    _clock_out: Publisher | None = None

    def __init__(self, opened: Callable[[str, Any], Any] = opened) -> None:
        """:param opened: connects to a robot"""
        self._opened = opened

    def open(self) -> FrankaDriver:
        node, p = self.node, self.node.parameters
        robot = FrankaRobot(settings_from(p, FrankaSettings), node.clock, self._opened)
        self.model = Arm('fr3')
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
        self._clock_out = None
        if self.node.parameters.publish_clock:
            self._clock_out = self.node.add_publisher(ClockMessage, '/clock', CLOCK_DEPTH)

    def begin(self) -> None:
        self.node.lateness = LatenessRecorder(round(CYCLE_S * NS))
        self._work = LatenessRecorder(NS)
        self._stamp_ns = self._last_state_ns = self._arrived = 0
        self._cycle_ns = CYCLE_S * NS

    def close(self) -> None:
        if self._driver is not None:
            self._driver.robot.close()
            self._driver = None

    def cycles(self) -> Loop:
        node, driver = self.node, self._driver
        if driver is None:
            return
        control, commands, clock = node.control, node.commands, node.clock
        worked = thread_cpu_ns()
        while True:
            commands.carry_out()
            measured = control.wait()
            if measured is None:
                yield clock.now() + SILENT_NS
                continue
            arrived = driver.robot.arrived
            stamp = self._stamp(driver)
            commands.take_references(stamp)
            tick = control.answer(measured)
            node.state_out.publish(tick, stamp, commands.sequence)
            if self._clock_out is not None:
                self._clock_out.publish(ClockMessage(clock=stamp_of(stamp)))
            robot_ns = round(driver.robot.seconds * NS)
            node.lateness.add(robot_ns, robot_ns + clock.now() - arrived)
            # Other threads run until shortly before the next state.
            yield self._next_state(arrived)
            # All that this thread has computed since the last cycle: reading, too.
            worked, last = thread_cpu_ns(), worked
            self._work.add(last, worked)

    def _next_state(self, arrived: int) -> int:
        """Steady time shortly before the next state is expected [ns]."""
        cycle = min(arrived - self._arrived, LONGEST_CYCLE_NS)
        self._arrived = arrived
        self._cycle_ns += 0.05 * (cycle - self._cycle_ns)
        return arrived + round(YIELD_SHARE * self._cycle_ns)

    def _stamp(self, driver: FrankaDriver) -> int:
        """Time of the present state [ns]: of the robot if it makes the clock, else wall time."""
        if self._clock_out is None:
            return self.node.clock.wall()
        state_ns = round(driver.robot.seconds * NS)
        passed = state_ns - self._last_state_ns
        self._last_state_ns = state_ns
        # The time of a robot that was started again begins anew.
        self._stamp_ns += passed if 0 < passed < NS else round(CYCLE_S * NS)
        return self._stamp_ns

    def diagnosed(self) -> dict[str, Any]:
        driver = self._driver
        if driver is None:
            return {}
        work = self._work.punctuality(1000)
        return {IN_TIME: f'{driver.robot.success_rate:.3f}', LOST: driver.lost,
                CPU_TIME: f'{work.p50_us:.0f}, {work.p99_us:.0f}'}


def node() -> ArmNode:
    """Return the node ``franka_arm``."""
    return ArmNode(FrankaArm())


def main(arguments: list[str] | None = None) -> int:
    """Run the node ``franka_arm``."""
    return run([node], arguments)


if __name__ == '__main__':
    raise SystemExit(main())
