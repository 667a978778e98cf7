"""What the nodes of all arms have in common: controller, services, state, diagnostics."""
from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from gdmp_msgs.msg import ArmStatus
import numpy as np
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from gdmp_ros.control.arm_control import ArmControl
from gdmp_ros.control.arm_states import Request, State
from gdmp_ros.control.limits import LIMITS
from gdmp_ros.control.settings import ControllerSettings
from gdmp_ros.errors import DataError, GdmpError, ParameterError
from gdmp_ros.realtime.loop import Loop, NS, RunningLoop
from gdmp_ros.realtime.statistics import LatenessRecorder
from gdmp_ros.ros.arm.commands import Answer, ArmCommands
from gdmp_ros.ros.arm.parameters import controller_settings, payload, tool_transform
from gdmp_ros.ros.arm.state_publisher import StatePublisher
from gdmp_ros.ros.lifecycle import ManagedNode
from gdmp_ros.ros.messages import lateness_diagnostics
from gdmp_ros.ros.parameters import Parameters, Spec
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.frames import ToolTransform
from gdmp_ros.sim.payload import Payload
from gdmp_ros.sim.urdf import joint_names, LinkFrames, urdf
from gdmp_ros.util.names import indices_of

#: Longest time in which the arm comes to rest before its node is inactive [s].
REST_S = 2.0
#: Time between two looks whether it rests [ns].
LOOK_NS = 2_000_000
#: Reports between two looks for other nodes of this name.
TWINS_EVERY = 10


class ArmNode(ManagedNode):
    """
    A managed node that controls an arm in a loop of its own.

    A subclass sets ``commands`` before it calls `prepare`, hands its loop to `start`, and
    publishes each tick with ``state_out``.
    """

    commands: ArmCommands
    _loop: RunningLoop | None = None

    def __init__(self, name: str, specs: Sequence[Spec]) -> None:
        super().__init__(name)
        self.parameters = Parameters(self, specs)
        self.active = False
        self._refused, self._report_count = 0, 0
        # The last refusal, and when it was seen.
        self._refusal = '', Time()
        self._twins = self._reason = ''
        self.lateness = LatenessRecorder(1_000_000)

    # Lifecycle

    def settings(self) -> ControllerSettings:
        """Settings of the controller, payload and tool, from the parameters."""
        p = self.parameters
        self._payload, self._tool = payload(p), tool_transform(p)
        self._changes: list[tuple[str, Answer]] = []
        return controller_settings(p)

    def prepare(self, period: float) -> None:
        """
        Add subscriptions, publishers and reports.

        :param period: of the loop [s]
        """
        p, arm = self.parameters, self.described_arm()
        try:
            self._joint_names = joint_names(arm, p.frame_id)
        except DataError:  # `describe` says it
            self._joint_names = arm.names
        self.add_subscription(JointState, '~/posture', self._on_posture)
        self._diagnostics = self.add_publisher(DiagnosticArray, '/diagnostics', 10)
        self._status_out = self.add_publisher(ArmStatus, '~/status', 10)
        self._description = self.add_publisher(String, 'robot_description', 1, late=True)
        self.state_out = StatePublisher(self, p.frame_id, self._joint_names,
                                        max(1, round(1.0 / (p.visualization_rate_hz * period))))
        self.describe()
        self.add_report(self._report)
        self.control.states.watchers.append(self._changed)
        self.control.states.end()
        p.check = self._check
        p.changed = self.use_parameters
        p.locked = True

    @property
    def control(self) -> ArmControl:
        """The arm."""
        return self.commands.control

    def start(self, loop: Loop) -> None:
        """Begin to control."""
        self.commands.know_stream(self.time_ns())
        self.active = True
        running = self._loop = self.clock.start(loop, self.parameters.realtime_priority)
        topic = self.resolve_topic_name(self.parameters.reference_topic)
        self.get_logger().info(f'the arm follows {topic}')
        if self.parameters.realtime_priority != 0:
            self.log_scheduler(running.scheduler)

    def deactivate(self) -> None:
        if not self.active:
            return
        reason = self._rest()
        self.active = False
        if self._loop is not None:
            self._loop.end()
            self._loop = None
        self.control.states.end(reason)
        self.commands.drop(reason or 'the node was deactivated')
        if self.parameters.lateness_file:
            self.lateness.save(self.parameters.lateness_file)

    def _rest(self) -> str:
        """Let the arm come to rest; why its loop has ended, empty if it has not."""
        loop, clock, states = self._loop, self.clock, self.control.states
        if loop is None:
            return ''
        latest = clock.now() + round(REST_S * NS)
        if loop.failure is None and self.ticks():
            self.commands.ask(Request.DEACTIVATE)
            while (loop.failure is None and states.state is not State.INACTIVE
                   and clock.now() < latest):
                clock.sleep_until(clock.now() + LOOK_NS)
        return '' if loop.failure is None else _failed(loop)

    def ticks(self) -> bool:
        """Whether time passes for the arm."""
        return True

    def cleanup(self) -> None:
        self.release()
        self.parameters.locked = False

    def is_active(self) -> bool:
        """Whether the arm is controlled."""
        return self.active

    def _check(self, proposed: Any) -> None:
        carried = payload(proposed)
        if self.active and tool_transform(proposed) != self._tool:
            self.control.states.check(Request.TOOL)
        if self.active and carried != self._payload:
            self.control.states.check(Request.PAYLOAD)
            self.control.check_payload()
        self.control.controller.check(controller_settings(proposed))

    def use_parameters(self) -> None:
        """Take over parameters that have changed."""
        self.control.controller.configure(controller_settings(self.parameters))
        carried, tool = payload(self.parameters), tool_transform(self.parameters)
        if carried != self._payload:
            self._payload = carried
            self._change('payload', Request.PAYLOAD, carried)
        if tool != self._tool:
            self._tool = tool
            self._change('tool_position, tool_rotation', Request.TOOL, tool)

    def _change(self, names: str, request: Request, argument: Any) -> None:
        """Let the arm take over parameters; an inactive one does at once."""
        if self.active:
            self._changes.append((names, self.commands.ask(request, argument)))
            return
        use = self.control.carry if request is Request.PAYLOAD else self.control.use_tool
        answer = Answer()
        try:
            use(argument)
            answer.give()
        except GdmpError as error:
            answer.give(str(error))
        self._changes.append((names, answer))

    @property
    def given_payload(self) -> Payload | None:
        """What the parameters say that the arm carries; None if nothing."""
        return None if self._payload == Payload() else self._payload

    @property
    def given_tool(self) -> ToolTransform | None:
        """Where the parameters say that the tool is; None if at its site."""
        return None if self._tool == ToolTransform() else self._tool

    def _on_posture(self, message: JointState) -> None:
        """Use another posture of the null space, or refuse it."""
        try:
            if not self.active:
                raise ParameterError('the node is not active')
            position = np.array(message.position)
            if len(message.name) not in (0, len(position)):
                raise ParameterError(f'{len(message.name)} names and {len(position)} positions')
            if message.name:
                position = position[indices_of(self._joint_names, message.name, 'the joint')]
            self.commands.ask(Request.POSTURE, position)
        except GdmpError as error:
            self._refuse(f'~/posture: {error}')

    def _refuse(self, reason: str) -> None:
        self.control.states.last_refusal = reason
        self.get_logger().warning(f'refused: {reason}', throttle_duration_sec=1.0)

    # Reports

    def _report(self) -> None:
        if self.active and self._loop is not None and self._loop.failure is not None:
            self.get_logger().error(_failed(self._loop))
            self.trigger_deactivate()
        if self._report_count % TWINS_EVERY == 0:
            count = self.participant.publishers('~/state').count(self.get_fully_qualified_name())
            self._twins = '' if count < 2 else f'{count} nodes have this name'
        self._report_count += 1
        self._publish_status()
        for names, answer in [change for change in self._changes if change[1].done]:
            self._changes.remove((names, answer))
            self.describe()
            if answer.refusal:
                self.get_logger().error(f'{names}: no effect: {answer.refusal}')
        level, text = self._status()
        controller, states = self.control.controller, self.control.states
        counters = controller.counters
        # After a reset the guard counts from 0 again.
        refused, self._refused = self._refused, states.refused
        if states.refused > refused:
            level = DiagnosticStatus.WARN if level == DiagnosticStatus.OK else level
            publishers = ', '.join(self.participant.publishers(self.parameters.reference_topic))
            self.get_logger().warning(f'reference refused: {states.last_refusal} (published by '
                                      f'{publishers})', throttle_duration_sec=1.0)
        extra = {'references refused': states.refused, 'last refusal': states.last_refusal,
                 'energy tank [J]': f'{controller.tank.energy:.3f}',
                 **{f'{limit.name} limit, ticks': count
                    for limit, count in zip(LIMITS, counters.ticks)},
                 **{f'{limit.name} limit, largest violation [{limit.unit}]': f'{largest:.3g}'
                    for limit, largest in zip(LIMITS, counters.largest)}}
        self._diagnostics.publish(lateness_diagnostics(
            self.get_fully_qualified_name().lstrip('/'), level, text,
            self.lateness.punctuality(1000), {**extra, **self.diagnosed()}, self.stamp()))

    def _changed(self, before: State) -> None:
        # A reason that comes again between two reports is a new one.
        if not self.control.states.reason:
            self._reason = ''

    def _publish_status(self) -> None:
        controller, states = self.control.controller, self.control.states
        if states.last_refusal != self._refusal[0]:
            self._refusal = states.last_refusal, self.stamp()
        message = ArmStatus(
            mode=states.state.mode, state=states.state.name.lower(), waits_for=states.waits_for,
            reason=states.reason, refused=states.refused, last_refusal=self._refusal[0],
            last_refusal_stamp=self._refusal[1], tank_low=controller.tank.is_low,
            tank_energy=controller.tank.energy)
        message.header.stamp = self.stamp()
        message.header.frame_id = self.parameters.frame_id
        self._status_out.publish(message)

    def _status(self) -> tuple[bytes, str]:
        """Level and text for the diagnostics; new problems are logged."""
        logger, control = self.get_logger(), self.control
        states, tank = control.states, control.controller.tank
        level, text = DiagnosticStatus.OK, states.state.name.lower()
        if states.reason:
            level = (DiagnosticStatus.ERROR if states.state in (State.FAULT, State.INACTIVE)
                     else DiagnosticStatus.WARN)
            text = f'{text}: {states.reason}'
            if states.reason != self._reason:
                logger.warning(text)
        self._reason = states.reason
        text = self.activity() or text
        if self._twins:
            level, text = max(level, DiagnosticStatus.WARN), f'{text}, {self._twins}'
            logger.warning(self._twins, throttle_duration_sec=5.0)
        if tank.is_low:
            level, text = max(level, DiagnosticStatus.WARN), (
                f'{text}, energy tank low ({tank.energy:.2g} J): motions slow down and springs '
                'soften')
            logger.warning(text, throttle_duration_sec=5.0)
        limited = control.controller.counters.recent()
        if limited:
            level, text = max(level, DiagnosticStatus.WARN), f'{text}, limited: {limited}'
            logger.warning(f'limited: {limited}', throttle_duration_sec=5.0)
        return level, text

    def diagnosed(self) -> dict[str, Any]:
        """More entries of the diagnostics."""
        return {}

    def activity(self) -> str:
        """What the arm does, if its mode does not say it; problems are logged."""
        motion = self.control.joint_motion
        return motion.what if motion is not None and not motion.done else ''

    def describe(self) -> None:
        """Publish the URDF for RViz, and the frames of its links."""
        arm, p = self.described_arm(), self.parameters
        try:
            text = urdf(arm, p.frame_id, p.joint_speed)
        except DataError as error:
            self.get_logger().warning(f'no robot_description: {error}')
            return
        self._description.publish(String(data=text))
        self.state_out.tf.describe(LinkFrames(arm, p.frame_id))

    def described_arm(self) -> Arm:
        """Model of the arm, with its tool."""
        raise NotImplementedError


def _failed(loop: RunningLoop) -> str:
    return f'the loop failed: {loop.failure!r}'
