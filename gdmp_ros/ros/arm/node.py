"""A Panda in MuJoCo in place of the robot: follows references under 1 kHz impedance control."""
from __future__ import annotations

import threading
import time

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from gdmp_msgs.msg import Reference, RobotState
from gdmp_msgs.srv import StepSimulation
from geometry_msgs.msg import PoseStamped
import numpy as np
from rosgraph_msgs.msg import Clock as ClockMessage
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger

from gdmp_ros.control.controller import Tick
from gdmp_ros.control.guard import Origin
from gdmp_ros.control.limits import LIMITS
from gdmp_ros.errors import DataError, GdmpError, ParameterError
from gdmp_ros.realtime.loop import MonotonicClock, RealtimeThread, run_periodic
from gdmp_ros.realtime.statistics import LatenessRecorder
from gdmp_ros.ros import messages as wire
from gdmp_ros.ros.arm.parameters import controller_settings, grip_settings, SPECS
from gdmp_ros.ros.lifecycle import (
    CLOCK_DEPTH,
    DEEP,
    lateness_diagnostics,
    ManagedNode,
    run,
    take,
    take_latest,
)
from gdmp_ros.ros.parameters import Parameters
from gdmp_ros.ros.streams import pose_stream, stiffness_stream, Stream
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.closed_loop import ClosedLoop
from gdmp_ros.sim.hand import Hand
from gdmp_ros.sim.urdf import urdf
from gdmp_ros.sim.viewer import Viewer

NS = 1_000_000_000
#: Longest wait for a paused loop to take its steps, beyond their own duration [s].
STEP_WAIT_S = 5.0
#: Catching up more periods than this at once would only delay the next tick further.
MOST_STEPS = 10
#: References looked at in a tick, and waiting at most.
MOST_REFERENCES = 20
#: A hand that has not said where it is for so long has let go [s].
HAND_S = 0.3
#: While the arm is led the hand is looked for every so many ticks.
HAND_EVERY = 5


class PandaSim(ManagedNode):
    """The managed node ``panda_sim``."""

    def __init__(self) -> None:
        super().__init__('panda_sim')
        self.parameters = Parameters(self, SPECS)
        self._thread: RealtimeThread | None = None
        self._viewer: Viewer | None = None
        self._active = False
        self._paused = False
        self._reset = False
        self._steps_wanted = 0
        self._lead: bool | None = None  # asked for, until the next tick
        self._hand_ticks = 0
        self._hand_problem = ''
        self._stepped = threading.Event()
        self._sequence = 0
        self._ticks = 0
        self._said = 0
        self._lateness = LatenessRecorder(1_000_000)

    # Lifecycle

    def configure(self) -> None:
        p = self.parameters
        self._loop = ClosedLoop(Arm(p.model, p.tool_site), controller_settings(p))
        self._grip = grip_settings(p)
        self.expect_compilation()
        self._loop.warm_up()  # compiles the control law, or loads it from the cache
        self._every = max(1, round(1.0 / (p.viewer_rate_hz * self._loop.arm.period)))
        self._make_publishers()
        self._make_inputs()
        self.parameters.check = controller_settings
        self.parameters.changed = self._use_parameters
        self.parameters.locked = True

    def activate(self) -> None:
        if not self.parameters.headless:
            self._viewer = Viewer(self._loop.arm)
        self._period_ns = round(self._loop.arm.period * NS)
        self._lateness = LatenessRecorder(self._period_ns)
        self._last = 0
        self._active = True
        body = self._in_step if self.parameters.pace == 'wall' else self._fast
        self._thread = RealtimeThread(body, self.parameters.realtime_priority)
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

    def _use_parameters(self) -> None:
        self._loop.controller.configure(controller_settings(self.parameters))
        self._grip = grip_settings(self.parameters)

    def cleanup(self) -> None:
        self.release()
        self.parameters.locked = False

    # The loop

    def _in_step(self) -> None:
        run_periodic(self._wall_tick, self._period_ns, MonotonicClock(), lambda: not self._active)

    def _wall_tick(self, deadline_ns: int, now_ns: int) -> None:
        self._lateness.add(deadline_ns, now_ns)
        # After an overrun simulated time catches up, or it would fall behind wall time.
        periods = (deadline_ns - self._last) // self._period_ns if self._last else 1
        self._last = deadline_ns
        stamp = time.time_ns() - (time.monotonic_ns() - deadline_ns)
        for late in range(min(periods, MOST_STEPS) - 1, -1, -1):
            self._advance(stamp - late * self._period_ns)
        if self._viewer is not None and self._ticks % 16 == 0:
            self._viewer.sync()

    def _fast(self) -> None:
        while self._active:
            stamp = round(self._loop.arm.time * NS)
            if not self._advance(stamp):
                time.sleep(0.001)
                continue
            passed = round(self._loop.arm.time * NS)
            self._clock_out.publish(ClockMessage(clock=wire.stamp_of(passed)))
            now = time.monotonic_ns()
            self._lateness.add(now, now)

    def _advance(self, stamp_ns: int) -> bool:
        """One tick, unless paused; True if simulated time has passed."""
        if self._reset:
            self._reset = False
            self._loop.reset()
        if self._lead is not None:
            self._begin_or_end_leading()
        if self._paused:
            if self._steps_wanted == 0:
                return False
            self._steps_wanted -= 1
        # All, in order: who publishes beside must not hide the one that is followed.
        for _ in range(MOST_REFERENCES):
            message = take(self._reference)
            if message is None:
                break
            self.take_reference(message, stamp_ns)
        if self._loop.led:
            self._follow_hand()
        tick = self._loop.tick()
        self._publish(tick, stamp_ns)
        if self._paused and self._steps_wanted == 0:
            self._stepped.set()
        return True

    def take_reference(self, message: Reference, now_ns: int) -> None:
        """Follow a reference from now on, or refuse it."""
        stamp = message.header.stamp.sec * NS + message.header.stamp.nanosec
        if self._loop.led:
            self._loop.controller.guard.refuse('the arm is being led by hand (~/teach)')
            return
        origin = Origin(message.header.frame_id, (now_ns - stamp) / NS, message.sequence)
        if self._loop.controller.guard.offer(wire.reference_target(message), origin):
            self._sequence = message.sequence

    def _begin_or_end_leading(self) -> None:
        self._loop.led, self._lead = bool(self._lead), None
        take_latest(self._hand)  # of an earlier time
        self._hand_ticks = self._sequence = 0
        self._let_go()

    def _follow_hand(self) -> None:
        """Let the hand pull where it is now, or let go."""
        self._hand_ticks += 1
        if self._hand_ticks % HAND_EVERY:
            return
        message = take_latest(self._hand)
        if message is not None:
            self.take_hand(message)
        elif self._loop.hand is not None and self._hand_ticks * self._loop.arm.period > HAND_S:
            # Only then: the mouse in the window pushes without a hand.
            self._let_go()

    def take_hand(self, message: PoseStamped) -> None:
        """Take hold of the tool with a hand at a pose, or say why not."""
        try:
            pose = wire.checked_pose(message, self.parameters.frame_id)
        except GdmpError as error:
            self._hand_problem = f'hand_pose refused: {error}'
            return
        self._loop.hand = Hand(pose, self._grip)
        self._hand_ticks = 0

    def _let_go(self) -> None:
        self._loop.hand = None
        self._loop.arm.push(np.zeros(6))

    def _publish(self, tick: Tick, stamp_ns: int) -> None:
        measured = tick.measurement
        self._state.publish(wire.robot_state_numbers(tick), stamp_ns, self._sequence)
        self._ticks += 1
        if self._ticks % self._every == 0:
            self._pose.publish(measured.pose, stamp_ns)
            self._stiffness.publish(tick.stiffness)
            self._requested.publish(tick.requested)
            self._joint_message.header.stamp = wire.stamp_of(stamp_ns)
            self._joint_message.position = measured.position.tolist()
            self._joint_message.velocity = measured.velocity.tolist()
            self._joint_message.effort = tick.torque.tolist()
            self._joints.publish(self._joint_message)

    # Interfaces

    def _make_publishers(self) -> None:
        frame, names = self.parameters.frame_id, self._loop.arm.names
        self._joints = self.add_publisher(JointState, 'joint_states', 10)
        self._diagnostics = self.add_publisher(DiagnosticArray, '/diagnostics', 10)
        self._describe()
        if self.parameters.pace == 'fast':
            self._clock_out = self.add_publisher(ClockMessage, '/clock', CLOCK_DEPTH)
        state = RobotState()
        state.header.frame_id = frame
        self._state = Stream(self.add_publisher(RobotState, '~/state', DEEP),
                             wire.Patched(state, wire.ROBOT_STATE_FIXED + 3 * len(names),
                                          wire.fill_robot_state))
        self._pose = pose_stream(self, '~/measured_pose', frame)
        self._stiffness = stiffness_stream(self, '~/applied_stiffness')
        self._requested = stiffness_stream(self, '~/requested_stiffness')
        self._joint_message = JointState(name=names)

    def _describe(self) -> None:
        """Publish what the arm looks like, for RViz and robot_state_publisher."""
        try:
            text = urdf(self._loop.arm, self.parameters.frame_id, self.parameters.joint_speed)
        except DataError as error:
            self.get_logger().warning(f'no robot_description: {error}')
            return
        self.add_publisher(String, 'robot_description', 1, latched=True).publish(String(data=text))

    def _make_inputs(self) -> None:
        self._reference = self.add_subscription(Reference, self.parameters.reference_topic, None,
                                                MOST_REFERENCES)
        self._hand = self.add_subscription(PoseStamped, '~/hand_pose', None)
        self.add_service(SetBool, 'set_pause', self._on_pause)
        self.add_service(SetBool, 'teach', self._on_teach)
        self.add_service(Trigger, 'reset_world', self._on_reset)
        self.add_service(StepSimulation, 'step_simulation', self._on_step)
        self.add_report(self._report)

    def _on_pause(self, request: SetBool.Request, reply: SetBool.Response) -> SetBool.Response:
        self._paused = request.data
        reply.success = True
        reply.message = 'paused' if request.data else 'running'
        return reply

    def _on_teach(self, request: SetBool.Request, reply: SetBool.Response) -> SetBool.Response:
        self._lead = request.data
        reply.success = True
        reply.message = ('the arm is weightless: lead it by ~/hand_pose, or with the mouse'
                         if request.data else 'the arm holds where it is')
        return reply

    def _on_reset(self, request: Trigger.Request, reply: Trigger.Response) -> Trigger.Response:
        self._reset = True
        reply.success, reply.message = True, 'the arm is put back to its first keyframe'
        return reply

    def _on_step(self, request: StepSimulation.Request,
                 reply: StepSimulation.Response) -> StepSimulation.Response:
        try:
            self._step(request.steps)
            reply.success = True
        except ParameterError as error:
            reply.message = str(error)
        reply.time = self._loop.arm.time
        return reply

    def _step(self, steps: int) -> None:
        if not self._active or not self._paused:
            raise ParameterError('the simulation is not paused: call ~/set_pause first')
        if not 1 <= steps <= 100_000:
            raise ParameterError(f'steps is {steps}, expected 1 to 100000')
        self._stepped.clear()
        self._steps_wanted = steps
        if not self._stepped.wait(steps * self._loop.arm.period + STEP_WAIT_S):
            raise ParameterError(f'{self._steps_wanted} of {steps} steps were not taken in time')

    def _report(self) -> None:
        controller = self._loop.controller
        guard, biting = controller.guard, controller.bites.recent()
        level, text = DiagnosticStatus.OK, 'following' if guard.following else 'holding'
        if self._loop.led:
            text = 'led by hand' if self._loop.hand is not None else 'weightless'
        if self._paused:
            text = 'paused'
        if self._hand_problem:
            self.get_logger().warning(self._hand_problem, throttle_duration_sec=1.0)
            self._hand_problem = ''
        if biting:
            level, text = DiagnosticStatus.WARN, f'{text}, limited: {biting}'
            self.get_logger().warning(f'limited: {biting}', throttle_duration_sec=5.0)
        if self._thread is not None and self._thread.failure is not None:
            level, text = DiagnosticStatus.ERROR, f'simulation failed: {self._thread.failure!r}'
            self.get_logger().error(text, throttle_duration_sec=5.0)
        extra = {'references refused': guard.refused, 'last refusal': guard.last_refusal,
                 'energy tank [J]': f'{controller.tank.energy:.3f}',
                 **{f'{limit.name} limit, ticks': count
                    for limit, count in zip(LIMITS, controller.bites.ticks)},
                 **{f'{limit.name} limit, most [{limit.unit}]': f'{most:.3g}'
                    for limit, most in zip(LIMITS, controller.bites.most)}}
        if guard.refused != self._said:
            self._said = guard.refused
            level = DiagnosticStatus.WARN if level == DiagnosticStatus.OK else level
            streaming = ', '.join(self.publishers(self.parameters.reference_topic))
            self.get_logger().warning(f'reference refused: {guard.last_refusal} (published by '
                                      f'{streaming})', throttle_duration_sec=1.0)
        self._diagnostics.publish(lateness_diagnostics(
            'panda_sim', level, text, self._lateness.punctuality(1000), extra,
            self.get_clock().now().to_msg()))


def main(arguments: list[str] | None = None) -> int:
    """Run the node ``panda_sim``."""
    return run([PandaSim], arguments)


if __name__ == '__main__':
    raise SystemExit(main())
