"""A simulated arm instead of the robot, in MuJoCo: follows references at 1 kHz."""
from __future__ import annotations

from gdmp_msgs.msg import Reference
from geometry_msgs.msg import PoseStamped
from rosgraph_msgs.msg import Clock as ClockMessage

from gdmp_ros.control.arm_states import State
from gdmp_ros.realtime.loop import Loop, NS, periodic
from gdmp_ros.realtime.statistics import LatenessRecorder
from gdmp_ros.ros.arm.commands import MAX_REFERENCES
from gdmp_ros.ros.arm.node import ArmNode
from gdmp_ros.ros.arm.parameters import hand_settings, simulated_arm, SIMULATION
from gdmp_ros.ros.arm.simulation import Simulation
from gdmp_ros.ros.arm.simulation_services import SimulationServices
from gdmp_ros.ros.gripper import GripperInterface
from gdmp_ros.ros.messages import stamp_of
from gdmp_ros.ros.middleware import CLOCK_DEPTH
from gdmp_ros.ros.running import run
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.closed_loop import ClosedLoop
from gdmp_ros.sim.viewer import Viewer

#: Largest number of missed periods that are made up in one tick.
MAX_CATCH_UP = 10
#: Time between two looks whether a simulation is still paused [ns].
PAUSED_NS = 1_000_000
#: The viewer is updated once in this many ticks.
VIEWER_EVERY = 16


class SimulatedArmNode(ArmNode):
    """The managed node ``panda_sim``."""

    simulation: Simulation
    _viewer: Viewer | None = None

    def __init__(self) -> None:
        super().__init__('panda_sim', SIMULATION)
        self._ticks = 0

    def configure(self) -> None:
        p = self.parameters
        arm, gripper = simulated_arm(p)
        loop = ClosedLoop(arm, self.settings(), gripper)
        if self.given_payload is not None:
            loop.arm.announce(self.given_payload)
        if self.given_tool is not None:
            loop.use_tool(self.given_tool)
        # Compile the control law, or load it from the cache.
        loop.warm_up(loop.arm.measure(), loop.arm.period)
        self.commands = self.simulation = Simulation(
            loop, p.frame_id,
            self.add_subscription(Reference, p.reference_topic, None, MAX_REFERENCES),
            self.add_subscription(PoseStamped, '~/hand_pose', None), hand_settings(p))
        if p.pace == 'fast':
            self._clock_out = self.add_publisher(ClockMessage, '/clock', CLOCK_DEPTH)
        self.arm_services = SimulationServices(self, self.simulation, self.is_active,
                                               self.describe)
        self.prepare(loop.arm.period)
        if gripper is not None:
            GripperInterface(self, gripper)

    def activate(self) -> None:
        arm = self.simulation.loop.arm
        if not self.parameters.headless:
            self._viewer = Viewer(arm)
        self._period_ns = round(arm.period * NS)
        self.lateness = LatenessRecorder(self._period_ns)
        self._last = 0
        # The brakes have held it.
        self.simulation.loop.rest()
        self.start(self._fast_loop() if self.parameters.pace == 'fast' else
                   periodic(self._wall_tick, self._period_ns, self.clock))

    def ticks(self) -> bool:
        return not self.simulation.paused

    def deactivate(self) -> None:
        super().deactivate()
        if self._viewer is not None:
            self._viewer.close()
            self._viewer = None

    def use_parameters(self) -> None:
        super().use_parameters()
        self.simulation.hand_settings = hand_settings(self.parameters)

    # The loop

    def _wall_tick(self, deadline_ns: int, now_ns: int) -> None:
        self.lateness.add(deadline_ns, now_ns)
        # After an overrun, make up the missed periods: simulated time must keep up with wall time.
        periods = (deadline_ns - self._last) // self._period_ns if self._last else 1
        self._last = deadline_ns
        stamp = self.clock.wall() - (self.clock.now() - deadline_ns)
        for late in range(min(periods, MAX_CATCH_UP) - 1, -1, -1):
            # Not the time of the tick: a simulation that lags would call new references early.
            self._advance(stamp - late * self._period_ns, self.clock.wall())
        self._sync_viewer()

    def _fast_loop(self) -> Loop:
        arm, clock = self.simulation.loop.arm, self.clock
        while True:
            simulated = round(arm.time * NS)
            if not self._advance(simulated, simulated):
                yield clock.now() + PAUSED_NS
                continue
            self._clock_out.publish(ClockMessage(clock=stamp_of(round(arm.time * NS))))
            now = clock.now()
            self.lateness.add(now, now)
            self._sync_viewer()
            yield now

    def _sync_viewer(self) -> None:
        if self._viewer is not None and self._ticks % VIEWER_EVERY == 0:
            self._viewer.sync()

    def _advance(self, stamp_ns: int, now_ns: int) -> bool:
        """
        Make a tick and publish it; False while paused.

        :param stamp_ns: time of the tick
        :param now_ns: present time
        """
        tick = self.simulation.advance(now_ns)
        if tick is not None:
            self._ticks += 1
            self.state_out.publish(tick, stamp_ns, self.simulation.sequence,
                                   self.simulation.loop.others)
        return tick is not None

    # Reports

    def activity(self) -> str:
        simulation = self.simulation
        if simulation.hand_problem:
            self.get_logger().warning(simulation.hand_problem, throttle_duration_sec=1.0)
            simulation.hand_problem = ''
        if simulation.paused:
            return 'paused'
        if simulation.loop.states.state is State.GUIDED:
            return 'guided by hand' if simulation.loop.hand is not None else 'waiting for a hand'
        return super().activity()

    def described_arm(self) -> Arm:
        return self.simulation.loop.arm


def main(arguments: list[str] | None = None) -> int:
    """Run the node ``panda_sim``."""
    return run([SimulatedArmNode], arguments)


if __name__ == '__main__':
    raise SystemExit(main())
