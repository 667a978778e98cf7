"""What the nodes of all arms have in common: controller, services, state, diagnostics."""
from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from gdmp_msgs.msg import ArmStatus
import numpy as np
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from gdmp_ros.control.limits import LIMITS
from gdmp_ros.control.modes import ArmMode
from gdmp_ros.control.settings import ControllerSettings
from gdmp_ros.errors import DataError, ParameterError
from gdmp_ros.realtime.loop import Loop, RunningLoop
from gdmp_ros.realtime.statistics import LatenessRecorder
from gdmp_ros.ros.arm.commands import ArmCommands
from gdmp_ros.ros.arm.parameters import controller_settings, payload, tool_transform
from gdmp_ros.ros.arm.state_publisher import StatePublisher
from gdmp_ros.ros.lifecycle import ManagedNode
from gdmp_ros.ros.messages import lateness_diagnostics
from gdmp_ros.ros.parameters import Parameters, Spec
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.frames import ToolTransform
from gdmp_ros.sim.payload import Payload
from gdmp_ros.sim.urdf import LinkFrames, urdf

STATUS = {ArmMode.UNKNOWN: 'starting', ArmMode.HOLD: 'holding', ArmMode.FOLLOW: 'following',
          ArmMode.GUIDED: 'waiting for a hand', ArmMode.IDENTIFY: 'identifying the friction',
          ArmMode.COMPLIANT: 'compliant', ArmMode.FAULT: 'fault',
          ArmMode.MOVE: 'moving to a posture'}


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
        self._refused = 0
        self.lateness = LatenessRecorder(1_000_000)

    # Lifecycle

    def settings(self) -> ControllerSettings:
        """Settings of the controller, payload and tool, from the parameters."""
        p = self.parameters
        self._payload, self._tool, self._tool_change = payload(p), tool_transform(p), list[str]()
        return controller_settings(p)

    def prepare(self, joints: Sequence[str], period: float) -> None:
        """
        Add subscriptions, publishers and reports.

        :param joints: names of the joints
        :param period: of the loop [s]
        """
        p = self.parameters
        self.add_subscription(JointState, '~/posture', self._on_posture)
        self._diagnostics = self.add_publisher(DiagnosticArray, '/diagnostics', 10)
        self._status_out = self.add_publisher(ArmStatus, '~/status', 10)
        self._description = self.add_publisher(String, 'robot_description', 1, late=True)
        self.state_out = StatePublisher(self, p.frame_id, joints,
                                        max(1, round(1.0 / (p.visualization_rate_hz * period))))
        self.describe()
        self.add_report(self._report)
        p.check = self._check
        p.changed = self.use_parameters
        p.locked = True

    def start(self, loop: Loop) -> None:
        """Begin to control."""
        self.active = True
        running = self._loop = self.clock.start(loop, self.parameters.realtime_priority)
        topic = self.resolve_topic_name(self.parameters.reference_topic)
        self.get_logger().info(f'the arm follows {topic}')
        if self.parameters.realtime_priority != 0:
            self.log_scheduler(running.scheduler)

    def deactivate(self) -> None:
        if not self.active:
            return
        self.active = False
        if self._loop is not None:
            self._loop.end()
            self._loop = None
        if self.parameters.lateness_file:
            self.lateness.save(self.parameters.lateness_file)

    def cleanup(self) -> None:
        self.release()
        self.parameters.locked = False

    def is_active(self) -> bool:
        """Whether the arm is controlled."""
        return self.active

    def _check(self, proposed: Any) -> None:
        payload(proposed)
        if tool_transform(proposed) != self._tool:
            self.commands.control.check_tool()
        self.commands.control.controller.check(controller_settings(proposed))

    def use_parameters(self) -> None:
        """Take over parameters that have changed."""
        self.commands.control.controller.configure(controller_settings(self.parameters))
        carried = payload(self.parameters)
        if carried != self._payload:
            self._payload = carried
            self.commands.announce(carried)
        tool = tool_transform(self.parameters)
        if tool != self._tool:
            self._tool, self._tool_change = tool, self.commands.request_tool(tool)

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
            self.commands.control.controller.posture.approach(np.array(message.position))
        except ParameterError as error:
            self.get_logger().warning(f'posture refused: {error}', throttle_duration_sec=1.0)

    # Reports

    def _report(self) -> None:
        self._publish_status()
        if self._tool_change:
            self.describe()
            problem = self._tool_change.pop()
            if problem:
                self.get_logger().error(f'tool_position, tool_rotation: no effect: {problem}')
        level, text = self._status()
        controller = self.commands.control.controller
        guard, counters = controller.guard, controller.counters
        # After a reset the guard counts from 0 again.
        refused, self._refused = self._refused, guard.refused
        if guard.refused > refused:
            level = DiagnosticStatus.WARN if level == DiagnosticStatus.OK else level
            publishers = ', '.join(self.participant.publishers(self.parameters.reference_topic))
            self.get_logger().warning(f'reference refused: {guard.last_refusal} (published by '
                                      f'{publishers})', throttle_duration_sec=1.0)
        extra = {'references refused': guard.refused, 'last refusal': guard.last_refusal,
                 'energy tank [J]': f'{controller.tank.energy:.3f}',
                 **{f'{limit.name} limit, ticks': count
                    for limit, count in zip(LIMITS, counters.ticks)},
                 **{f'{limit.name} limit, largest violation [{limit.unit}]': f'{largest:.3g}'
                    for limit, largest in zip(LIMITS, counters.largest)}}
        self._diagnostics.publish(lateness_diagnostics(
            self.get_name(), level, text, self.lateness.punctuality(1000),
            {**extra, **self.diagnosed()},
            self.stamp()))

    def _publish_status(self) -> None:
        controller = self.commands.control.controller
        guard = controller.guard
        message = ArmStatus(mode=guard.mode, reason=guard.reason, refused=guard.refused,
                            last_refusal=guard.last_refusal, tank_low=controller.tank.is_low,
                            tank_energy=controller.tank.energy)
        message.header.stamp = self.stamp()
        message.header.frame_id = self.parameters.frame_id
        self._status_out.publish(message)

    def _status(self) -> tuple[bytes, str]:
        """Level and text for the diagnostics; new problems are logged."""
        logger, control = self.get_logger(), self.commands.control
        guard, tank = control.controller.guard, control.controller.tank
        level, text = DiagnosticStatus.OK, STATUS[guard.mode]
        if guard.reason:
            level = (DiagnosticStatus.ERROR if guard.mode is ArmMode.FAULT
                     else DiagnosticStatus.WARN)
            text = f'{text}: {guard.reason}'
            logger.warning(text, throttle_duration_sec=5.0)
        text = self.activity() or text
        if tank.is_low:
            level, text = DiagnosticStatus.WARN, (
                f'{text}, energy tank low ({tank.energy:.2g} J): motions slow down and springs '
                'soften')
            logger.warning(text, throttle_duration_sec=5.0)
        limited = control.controller.counters.recent()
        if limited:
            level, text = DiagnosticStatus.WARN, f'{text}, limited: {limited}'
            logger.warning(f'limited: {limited}', throttle_duration_sec=5.0)
        if self._loop is not None and self._loop.failure is not None:
            level, text = DiagnosticStatus.ERROR, f'the loop failed: {self._loop.failure!r}'
            logger.error(text, throttle_duration_sec=5.0)
        return level, text

    def diagnosed(self) -> dict[str, Any]:
        """More entries of the diagnostics."""
        return {}

    def activity(self) -> str:
        """What the arm does, if its mode does not say it; problems are logged."""
        control = self.commands.control
        motion = control.joint_motion
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
