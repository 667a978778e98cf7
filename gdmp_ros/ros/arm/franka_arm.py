"""A Franka Research 3 that follows references under 1 kHz impedance control."""
from __future__ import annotations

from collections.abc import Callable
from typing import Any

from gdmp_msgs.msg import Reference
from rosgraph_msgs.msg import Clock as ClockMessage

from gdmp_ros.franka.loop import CYCLE_S, FrankaLoop
from gdmp_ros.franka.robot import FrankaRobot, opened
from gdmp_ros.franka.settings import FrankaSettings
from gdmp_ros.realtime.loop import Loop, NS, thread_cpu_ns
from gdmp_ros.realtime.statistics import LatenessRecorder
from gdmp_ros.ros.arm.commands import ArmCommands, MAX_REFERENCES
from gdmp_ros.ros.arm.node import ArmNode
from gdmp_ros.ros.arm.parameters import FRANKA
from gdmp_ros.ros.arm.services import ArmServices
from gdmp_ros.ros.messages import CPU_TIME, IN_TIME, LOST, stamp_of
from gdmp_ros.ros.middleware import CLOCK_DEPTH
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


class FrankaArm(ArmNode):
    """The managed node ``franka_arm``."""

    _control: FrankaLoop | None = None

    def __init__(self, opened: Callable[[str, Any], Any] = opened) -> None:
        """:param opened: connects to a robot"""
        super().__init__('franka_arm', FRANKA)
        self._opened = opened

    def configure(self) -> None:
        p = self.parameters
        robot = FrankaRobot(settings_from(p, FrankaSettings), self.clock, self._opened)
        self._model = Arm('fr3')
        settings = self.settings()
        robot.carry(self._payload)
        loop = self._control = FrankaLoop(robot, p.rotor_inertia, settings, p.wall_time)
        if loop.misplaced > MISPLACED_M:
            self.get_logger().warning(
                f'the tool of the model is {loop.misplaced:.3f} m from where the robot says: is '
                'it a Franka Research 3? The pose of the model is used')
        if self.given_tool is not None:
            loop.use_tool(self.given_tool)
        self.commands = ArmCommands(
            loop, p.frame_id,
            self.add_subscription(Reference, p.reference_topic, None, MAX_REFERENCES))
        self._clock_out = None
        if p.publish_clock:
            self._clock_out = self.add_publisher(ClockMessage, '/clock', CLOCK_DEPTH)
        self.arm_services = ArmServices(self, self.commands, self.is_active, self.describe,
                                        self._model.home)
        self.prepare(CYCLE_S)
        if not p.enforce_realtime:
            self.get_logger().warning(
                'enforce_realtime is off: without a PREEMPT_RT kernel and SCHED_FIFO the robot '
                'may stop after lost cycles')

    def activate(self) -> None:
        self.lateness, self._work = LatenessRecorder(round(CYCLE_S * NS)), LatenessRecorder(NS)
        self._stamp_ns = self._last_state_ns = self._arrived = 0
        self._cycle_ns = CYCLE_S * NS
        if self._control is not None:
            self.start(self._cycles(self._control))

    def cleanup(self) -> None:
        super().cleanup()
        if self._control is not None:
            self._control.robot.close()
            self._control = None

    def _cycles(self, loop: FrankaLoop) -> Loop:
        commands, clock = self.commands, self.clock
        loop.activate()
        worked = thread_cpu_ns()
        try:
            while True:
                commands.carry_out()
                measured = loop.wait()
                if measured is None:
                    yield clock.now() + SILENT_NS
                    continue
                arrived = loop.robot.arrived
                stamp = self._stamp(loop)
                commands.take_references(stamp)
                tick = loop.answer(measured)
                self.state_out.publish(tick, stamp, commands.sequence)
                if self._clock_out is not None:
                    self._clock_out.publish(ClockMessage(clock=stamp_of(stamp)))
                robot_ns = round(loop.robot.seconds * NS)
                self.lateness.add(robot_ns, robot_ns + clock.now() - arrived)
                # Other threads run until shortly before the next state.
                yield self._next_state(arrived)
                # All that this thread has computed since the last cycle: reading, too.
                worked, last = thread_cpu_ns(), worked
                self._work.add(last, worked)
        finally:
            loop.end()

    def _next_state(self, arrived: int) -> int:
        """Steady time shortly before the next state is expected [ns]."""
        cycle = min(arrived - self._arrived, LONGEST_CYCLE_NS)
        self._arrived = arrived
        self._cycle_ns += 0.05 * (cycle - self._cycle_ns)
        return arrived + round(YIELD_SHARE * self._cycle_ns)

    def _stamp(self, loop: FrankaLoop) -> int:
        """Time of the present state [ns]: of the robot if it makes the clock, else wall time."""
        if self._clock_out is None:
            return self.clock.wall()
        state_ns = round(loop.robot.seconds * NS)
        passed = state_ns - self._last_state_ns
        self._last_state_ns = state_ns
        # The time of a robot that was started again begins anew.
        self._stamp_ns += passed if 0 < passed < NS else round(CYCLE_S * NS)
        return self._stamp_ns

    # Reports

    def diagnosed(self) -> dict[str, Any]:
        loop = self._control
        if loop is None:
            return {}
        work = self._work.punctuality(1000)
        return {IN_TIME: f'{loop.robot.success_rate:.3f}', LOST: loop.lost,
                CPU_TIME: f'{work.p50_us:.0f}, {work.p99_us:.0f}'}

    def described_arm(self) -> Arm:
        return self._model


def main(arguments: list[str] | None = None) -> int:
    """Run the node ``franka_arm``."""
    return run([FrankaArm], arguments)


if __name__ == '__main__':
    raise SystemExit(main())
