"""A Panda in MuJoCo instead of the robot: follows references under 1 kHz impedance control."""
from __future__ import annotations

import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from gdmp_msgs.msg import ArmStatus, Reference
from geometry_msgs.msg import PoseStamped
import numpy as np
from rosgraph_msgs.msg import Clock as ClockMessage
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from gdmp_ros.control.limits import LIMITS
from gdmp_ros.control.modes import ArmMode
from gdmp_ros.errors import DataError, ParameterError
from gdmp_ros.realtime.loop import MonotonicClock, RealtimeThread, run_periodic
from gdmp_ros.realtime.statistics import LatenessRecorder
from gdmp_ros.ros.arm.parameters import (
    controller_settings,
    hand_settings,
    payload,
    plant_settings,
    RETIRED,
    SPECS,
    tool_transform,
)
from gdmp_ros.ros.arm.services import Services
from gdmp_ros.ros.arm.simulation import MAX_REFERENCES, Simulation
from gdmp_ros.ros.arm.state_publisher import StatePublisher
from gdmp_ros.ros.lifecycle import CLOCK_DEPTH, ManagedNode
from gdmp_ros.ros.messages import (
    lateness_diagnostics,
    NS,
    stamp_of,
)
from gdmp_ros.ros.parameters import Parameters
from gdmp_ros.ros.running import run
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.closed_loop import ClosedLoop
from gdmp_ros.sim.payload import Payload
from gdmp_ros.sim.tool import ToolTransform
from gdmp_ros.sim.urdf import urdf
from gdmp_ros.sim.viewer import Viewer

#: Largest number of missed periods that are made up in one tick.
MAX_CATCH_UP = 10
#: The viewer is updated once in this many ticks.
VIEWER_EVERY = 16


STATUS = {ArmMode.UNKNOWN: 'starting', ArmMode.HOLD: 'holding', ArmMode.FOLLOW: 'following',
          ArmMode.GUIDED: 'waiting for a hand', ArmMode.IDENTIFY: 'identifying the friction',
          ArmMode.COMPLIANT: 'compliant', ArmMode.FAULT: 'fault'}


class PandaSim(ManagedNode):
    """The managed node ``panda_sim``."""

    simulation: Simulation
    _thread: RealtimeThread | None = None
    _viewer: Viewer | None = None

    def __init__(self) -> None:
        super().__init__('panda_sim')
        self.parameters = Parameters(self, SPECS, RETIRED)
        self._active = False
        self._ticks = 0
        self._refused = 0
        self._lateness = LatenessRecorder(1_000_000)

    # Lifecycle

    def configure(self) -> None:
        p = self.parameters
        loop = ClosedLoop(Arm(p.model, p.tool_site, plant=plant_settings(p)),
                          controller_settings(p))
        self._payload = payload(p)
        if self._payload != Payload():
            loop.arm.announce(self._payload)
        self._tool, self._tool_change = tool_transform(p), list[str]()
        if self._tool != ToolTransform():
            loop.put_tool(self._tool)
        loop.warm_up()  # compiles the control law, or loads it from the cache
        self.simulation = Simulation(
            loop, p.frame_id,
            self.add_subscription(Reference, p.reference_topic, None, MAX_REFERENCES),
            self.add_subscription(PoseStamped, '~/hand_pose', None), hand_settings(p))
        self.add_subscription(JointState, '~/posture', self._on_posture)
        self._add_publishers()
        self.arm_services = Services(self, self.simulation, lambda: self._active, self._describe)
        self.add_report(self._report)
        p.check = self._check
        p.changed = self._use_parameters
        p.locked = True

    def activate(self) -> None:
        arm = self.simulation.loop.arm
        if not self.parameters.headless:
            self._viewer = Viewer(arm)
        self._period_ns = round(arm.period * NS)
        self._lateness = LatenessRecorder(self._period_ns)
        self._last = 0
        self._active = True
        loop = self._wall_loop if self.parameters.pace == 'wall' else self._fast_loop
        self._thread = RealtimeThread(loop, self.parameters.realtime_priority)
        self._thread.start()
        topic = self.resolve_topic_name(self.parameters.reference_topic)
        self.get_logger().info(f'the arm follows {topic}')
        if self.parameters.realtime_priority != 0:
            self.log_scheduler(self._thread.scheduler)

    def deactivate(self) -> None:
        if not self._active:
            return
        self._active = False
        if self._thread is not None:
            self._thread.join()
            self._thread = None
        if self._viewer is not None:
            self._viewer.close()
            self._viewer = None
        if self.parameters.lateness_file:
            self._lateness.save(self.parameters.lateness_file)

    def cleanup(self) -> None:
        self.release()
        self.parameters.locked = False

    def _check(self, proposed: Any) -> None:
        payload(proposed)
        if tool_transform(proposed) != self._tool:
            self.simulation.loop.check_tool()
        self.simulation.loop.controller.check(controller_settings(proposed))

    def _use_parameters(self) -> None:
        self.simulation.loop.controller.configure(controller_settings(self.parameters))
        self.simulation.hand_settings = hand_settings(self.parameters)
        carried = payload(self.parameters)
        if carried != self._payload:
            self._payload = carried
            self.simulation.loop.arm.announce(carried)
        tool = tool_transform(self.parameters)
        if tool != self._tool:
            self._tool, self._tool_change = tool, self.simulation.request_tool(tool)

    def _on_posture(self, message: JointState) -> None:
        """Use another posture of the null space, or refuse it."""
        try:
            self.simulation.loop.controller.posture.want(np.array(message.position))
        except ParameterError as error:
            self.get_logger().warning(f'posture refused: {error}', throttle_duration_sec=1.0)

    # The loop

    def _wall_loop(self) -> None:
        run_periodic(self._wall_tick, self._period_ns, MonotonicClock(), lambda: not self._active)

    def _wall_tick(self, deadline_ns: int, now_ns: int) -> None:
        self._lateness.add(deadline_ns, now_ns)
        # After an overrun, make up the missed periods: simulated time must keep up with wall time.
        periods = (deadline_ns - self._last) // self._period_ns if self._last else 1
        self._last = deadline_ns
        stamp = time.time_ns() - (time.monotonic_ns() - deadline_ns)
        for late in range(min(periods, MAX_CATCH_UP) - 1, -1, -1):
            self._advance(stamp - late * self._period_ns)
        self._sync_viewer()

    def _fast_loop(self) -> None:
        arm = self.simulation.loop.arm
        while self._active:
            if not self._advance(round(arm.time * NS)):
                time.sleep(0.001)
                continue
            self._clock_out.publish(ClockMessage(clock=stamp_of(round(arm.time * NS))))
            now = time.monotonic_ns()
            self._lateness.add(now, now)
            self._sync_viewer()

    def _sync_viewer(self) -> None:
        if self._viewer is not None and self._ticks % VIEWER_EVERY == 0:
            self._viewer.sync()

    def _advance(self, stamp_ns: int) -> bool:
        """Make a tick and publish it; False while paused."""
        tick = self.simulation.advance(stamp_ns)
        if tick is not None:
            self._ticks += 1
            self._state.publish(tick, stamp_ns, self.simulation.sequence)
        return tick is not None

    # Interfaces

    def _add_publishers(self) -> None:
        frame, names = self.parameters.frame_id, self.simulation.loop.arm.names
        self._diagnostics = self.add_publisher(DiagnosticArray, '/diagnostics', 10)
        self._status_out = self.add_publisher(ArmStatus, '~/status', 10)
        self._description = self.add_publisher(String, 'robot_description', 1, latched=True)
        self._describe()
        if self.parameters.pace == 'fast':
            self._clock_out = self.add_publisher(ClockMessage, '/clock', CLOCK_DEPTH)
        period = self.simulation.loop.arm.period
        self._state = StatePublisher(
            self, frame, names, max(1, round(1.0 / (self.parameters.viewer_rate_hz * period))))

    def _describe(self) -> None:
        """Publish the URDF for RViz and robot_state_publisher."""
        arm = self.simulation.loop.arm
        try:
            text = urdf(arm, self.parameters.frame_id, self.parameters.joint_speed)
        except DataError as error:
            self.get_logger().warning(f'no robot_description: {error}')
            return
        self._description.publish(String(data=text))

    def _report(self) -> None:
        self._publish_status()
        if self._tool_change:
            self._describe()
            problem = self._tool_change.pop()
            if problem:
                self.get_logger().error(f'tool_position, tool_rotation: no effect: {problem}')
        level, text = self._status()
        controller = self.simulation.loop.controller
        guard, counters = controller.guard, controller.counters
        # After a reset the guard counts from 0 again.
        refused, self._refused = self._refused, guard.refused
        if guard.refused > refused:
            level = DiagnosticStatus.WARN if level == DiagnosticStatus.OK else level
            publishers = ', '.join(self.publishers(self.parameters.reference_topic))
            self.get_logger().warning(f'reference refused: {guard.last_refusal} (published by '
                                      f'{publishers})', throttle_duration_sec=1.0)
        extra = {'references refused': guard.refused, 'last refusal': guard.last_refusal,
                 'energy tank [J]': f'{controller.tank.energy:.3f}',
                 **{f'{limit.name} limit, ticks': count
                    for limit, count in zip(LIMITS, counters.ticks)},
                 **{f'{limit.name} limit, largest violation [{limit.unit}]': f'{largest:.3g}'
                    for limit, largest in zip(LIMITS, counters.largest)}}
        self._diagnostics.publish(lateness_diagnostics(
            'panda_sim', level, text, self._lateness.punctuality(1000), extra,
            self.get_clock().now().to_msg()))

    def _publish_status(self) -> None:
        controller = self.simulation.loop.controller
        guard = controller.guard
        message = ArmStatus(mode=guard.mode, reason=guard.reason, refused=guard.refused,
                            last_refusal=guard.last_refusal, tank_low=controller.tank.is_low,
                            tank_energy=controller.tank.energy)
        message.header.stamp = self.get_clock().now().to_msg()
        message.header.frame_id = self.parameters.frame_id
        self._status_out.publish(message)

    def _status(self) -> tuple[bytes, str]:
        """Level and text for the diagnostics; new problems are logged."""
        simulation, logger = self.simulation, self.get_logger()
        loop = simulation.loop
        guard = loop.controller.guard
        level, text = DiagnosticStatus.OK, STATUS[guard.mode]
        if guard.reason:
            level = (DiagnosticStatus.ERROR if guard.mode is ArmMode.FAULT
                     else DiagnosticStatus.WARN)
            text = f'{text}: {guard.reason}'
            logger.warning(text, throttle_duration_sec=5.0)
        if loop.hand_guided and loop.hand is not None:
            text = 'guided by hand'
        if simulation.identifies and loop.identification is not None:
            text = f'identifying the friction of joint {loop.identification.joint + 1}'
        if simulation.paused:
            text = 'paused'
        if simulation.hand_problem:
            logger.warning(simulation.hand_problem, throttle_duration_sec=1.0)
            simulation.hand_problem = ''
        if loop.controller.tank.is_low:
            level, text = DiagnosticStatus.WARN, (
                f'{text}, energy tank low ({loop.controller.tank.energy:.2g} J): motions slow '
                'down and springs soften')
            logger.warning(text, throttle_duration_sec=5.0)
        limited = loop.controller.counters.recent()
        if limited:
            level, text = DiagnosticStatus.WARN, f'{text}, limited: {limited}'
            logger.warning(f'limited: {limited}', throttle_duration_sec=5.0)
        if self._thread is not None and self._thread.failure is not None:
            level, text = DiagnosticStatus.ERROR, f'simulation failed: {self._thread.failure!r}'
            logger.error(text, throttle_duration_sec=5.0)
        return level, text


def main(arguments: list[str] | None = None) -> int:
    """Run the node ``panda_sim``."""
    return run([PandaSim], arguments)


if __name__ == '__main__':
    raise SystemExit(main())
