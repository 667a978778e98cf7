"""The node of an arm, simulated or a robot: lifecycle, parameters, reports."""
from __future__ import annotations

from typing import Any

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from gdmp_msgs.msg import ArmStatus, Reference
from gdmp_msgs.msg import Scene as SceneMessage
import numpy as np
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from gdmp_ros.control.arm_control import ArmControl
from gdmp_ros.control.arm_states import Request, State
from gdmp_ros.control.limits import LIMITS
from gdmp_ros.control.surroundings import LAST_SEEN_S
from gdmp_ros.errors import DataError, GdmpError, ParameterError
from gdmp_ros.manifolds.poses import compose, inverse
from gdmp_ros.realtime.loop import Loop, NS, priority_beside, RunningLoop
from gdmp_ros.realtime.statistics import LatenessRecorder
from gdmp_ros.ros.arm.backend import ArmBackend
from gdmp_ros.ros.arm.commands import Answer, ArmCommands, MAX_REFERENCES
from gdmp_ros.ros.arm.parameters import controller_settings, payload, tool_transform
from gdmp_ros.ros.arm.services import ArmServices
from gdmp_ros.ros.arm.state_publisher import StatePublisher
from gdmp_ros.ros.frames import BaseFrame
from gdmp_ros.ros.lifecycle import DIAGNOSTICS_EVERY, ManagedNode
from gdmp_ros.ros.messages import lateness_diagnostics
from gdmp_ros.ros.parameters import Parameters
from gdmp_ros.ros.scene.bodies import body_volumes, BodyTopics
from gdmp_ros.ros.scene.cloud import CloudTopic
from gdmp_ros.ros.scene.messages import scene_message
from gdmp_ros.ros.scene.moveit import PlanningObjects
from gdmp_ros.ros.scene.topics import SceneTopics
from gdmp_ros.scene.scene import Scene
from gdmp_ros.scene.volume import Volume
from gdmp_ros.sim.frames import ToolTransform
from gdmp_ros.sim.tool_shape import tool_frames
from gdmp_ros.sim.urdf import joint_names, link_names, LinkFrames, urdf
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

    :ivar control: of the arm
    :ivar commands: what other nodes want of it
    :ivar joint_names: with the prefix of its frame
    :ivar active: whether the arm is controlled
    :ivar lateness: of its ticks
    """

    control: ArmControl
    commands: ArmCommands
    _loop: RunningLoop | None = None
    _beside: list[RunningLoop]
    _bodies: BodyTopics

    def __init__(self, backend: ArmBackend) -> None:
        """:param backend: a new one"""
        super().__init__(backend.name)
        self.parameters = Parameters(self, backend.specs)
        self.backend, backend.node = backend, self
        self.active = False
        self._refused, self._report_count = 0, 0
        # The last refusal, and when it was seen.
        self._refusal = '', Time()
        self._twins = self._reason = ''
        self._beside = []
        self._told: tuple[Any, ...] | None = None
        self._diagnosis = DiagnosticStatus.OK, ''
        self.lateness = LatenessRecorder(1_000_000)

    # Lifecycle

    def configure(self) -> None:
        p, backend = self.parameters, self.backend
        self._payload, self._tool = payload(p), tool_transform(p)
        self._changes: list[tuple[str, Answer]] = []
        driver = backend.open()
        # Zero, too: a robot keeps the load of the last run.
        driver.carry(self._payload)
        if self._tool != ToolTransform():
            driver.use_tool(self._tool)
        measured = driver.measure()
        if measured is None:
            raise DataError('the arm does not answer')
        self.control = ArmControl(driver, controller_settings(p))
        # Compile the control law, or load it from the cache.
        self.control.warm_up(measured, driver.dt)
        self.control.states.watchers.append(self._changed)
        self.control.states.end()
        self.commands = ArmCommands(self.control, p.frame_id, self.add_subscription(
            Reference, p.reference_topic, None, MAX_REFERENCES))
        self._offer()
        backend.offer()
        p.check, p.changed, p.locked = self._check, self.use_parameters, True

    def _offer(self) -> None:
        """Add services, publishers and reports."""
        p, arm = self.parameters, self.backend.model
        try:
            self.joint_names = joint_names(arm, p.frame_id)
        except DataError:  # `describe` says it
            self.joint_names = arm.names
        self.arm_services = ArmServices(self)
        self.add_subscription(JointState, '~/posture', self._on_posture)
        self._offer_scene()
        self._diagnostics = self.add_publisher(DiagnosticArray, '/diagnostics', 10)
        self._status_out = self.add_publisher(ArmStatus, '~/status', 10)
        self._description = self.add_publisher(String, 'robot_description', 1, late=True)
        self.state_out = StatePublisher(self, p.frame_id, self.joint_names,
                                        self.backend.period, p.visualization_rate_hz,
                                        '~/' if self.backend.described else '')
        self.describe()
        self.add_report(self._report)

    def _offer_scene(self) -> None:
        """Take what others tell of the surroundings, and publish all of it."""
        p, arm, frames = self.parameters, self.backend.model, BaseFrame(
            self, self.parameters.frame_id, late=True)

        def in_tool() -> dict[str, np.ndarray]:
            # The tool that is controlled may be another one than that of the model.
            there = compose(inverse(self.control.driver.end_pose), arm.end_pose)
            return {name: compose(there, pose)
                    for name, pose in tool_frames(arm, p.frame_id).items()}
        self._scene_out = self.add_publisher(SceneMessage, '~/surroundings', 1, late=True)
        self._told, self._others = None, set[str]()
        topics = SceneTopics(self, frames.place_of, p, self._surround, self._refuse, in_tool)
        PlanningObjects(topics, frames.place_of, in_tool,
                        lambda: self.control.controller.memory.pose.copy(),
                        self._known_links, self._refuse,
                        lambda: self.clock.now() / NS).listen(self)
        # A server may still have those of the last run.
        self._tell(topics.scene)
        CloudTopic(self, topics, frames.place_of, p, self._own_capsules, self._hold_back,
                   self._refuse)
        self._check_allowed()
        self._bodies = BodyTopics(self, topics, frames.place_of, p, self._body, self._others,
                                  self._refuse)

    def _check_allowed(self) -> None:
        """:raises ParameterError: if a link that may touch other arms is not one of this arm"""
        known = self.control.driver.body.bits
        for name in filter(None, self.parameters.other_arms_allowed):
            if name not in known:
                raise ParameterError(f'other_arms_allowed has {name!r}, the links are '
                                     f'{", ".join(known)}')

    def _body(self) -> list[Volume] | None:
        """This arm, as others see it; None while it does not control its own: it stands there."""
        state = self.control.states.state
        if not self.active or state is State.INACTIVE:
            return None
        return body_volumes(self.control.controller, state is not State.FAULT)

    def _known_links(self) -> dict[str, str]:
        """Links of the description that the controller has a shape of, and their names there."""
        known = self.control.driver.body.bits
        return {name: own for name, own in link_names(
            self.backend.model, self.parameters.frame_id).items() if own in known}

    def _own_capsules(self, stamp: int) -> np.ndarray | None:
        if not self.active or self.control.states.state in (State.FAULT, State.INACTIVE):
            return None
        age = min(max((self.time_ns() - stamp) / NS, 0.0), LAST_SEEN_S)
        return self.control.controller.capsules(age)

    def _hold_back(self, reason: str) -> None:
        self.control.controller.hold_back(reason)
        self.commands.called()
        if reason:
            self.get_logger().warning(f'held: {reason}', throttle_duration_sec=1.0)

    def activate(self) -> None:
        self.backend.begin()
        self.commands.know_stream(self.time_ns())
        self.active = True
        priority = self.backend.priority()
        self._beside = [self.clock.start(loop, priority_beside(priority)) for loop in (
            self.state_out.show(self.clock), self._bodies.publish(self.clock),
            *self.backend.beside())]
        running = self._loop = self.clock.start(self._cycles(), priority)
        topic = self.resolve_topic_name(self.parameters.reference_topic)
        self.get_logger().info(f'the arm follows {topic}')
        if priority:
            self.loop_began(running.scheduler)

    def _cycles(self) -> Loop:
        """Control the arm; it holds itself before and after."""
        self.control.activate()
        try:
            yield from self.backend.cycles()
        finally:
            self.control.end()

    def deactivate(self) -> None:
        if not self.active:
            return
        reason = self._rest()
        self.active = False
        self.commands.called()
        for loop in self._running():
            loop.end()
        self._loop, self._beside = None, []
        self.control.states.end(reason)
        self.commands.drop(reason or 'the node was deactivated')
        self.backend.end()
        if self.parameters.lateness_file:
            self.lateness.save(self.parameters.lateness_file)

    def _running(self) -> list[RunningLoop]:
        return self._beside if self._loop is None else [self._loop, *self._beside]

    def _rest(self) -> str:
        """Let the arm come to rest; why its loop has ended, empty if it has not."""
        loop, clock, states = self._loop, self.clock, self.control.states
        if loop is None:
            return ''
        latest = clock.now() + round(REST_S * NS)
        if loop.failure is None and self.backend.ticks():
            self.commands.ask(Request.DEACTIVATE)
            while (loop.failure is None and states.state is not State.INACTIVE
                   and clock.now() < latest):
                clock.sleep_until(clock.now() + LOOK_NS)
        return '' if loop.failure is None else _failed(loop)

    def cleanup(self) -> None:
        super().cleanup()
        self.backend.close()

    def _check(self, proposed: Any) -> None:
        carried = payload(proposed)
        if self.active and tool_transform(proposed) != self._tool:
            self.control.states.check(Request.TOOL)
        if self.active and carried != self._payload:
            self.control.states.check(Request.PAYLOAD)
            self.control.driver.check_payload(self.control.states.state)
        self.control.controller.check(controller_settings(proposed))

    def use_parameters(self) -> None:
        """Take over parameters that have changed."""
        self.control.controller.configure(controller_settings(self.parameters))
        self.commands.called()
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

    def _on_posture(self, message: JointState) -> None:
        """Use another posture of the null space, or refuse it."""
        try:
            if not self.active:
                raise ParameterError('the node is not active')
            position = np.array(message.position)
            if len(message.name) not in (0, len(position)):
                raise ParameterError(f'{len(message.name)} names and {len(position)} positions')
            if message.name:
                position = position[indices_of(self.joint_names, message.name, 'the joint')]
            self.commands.ask(Request.POSTURE, position)
        except GdmpError as error:
            self._refuse(f'~/posture: {error}')

    def _surround(self, scene: Scene) -> None:
        self.control.controller.surround(scene)
        self.backend.surround(scene)
        self.commands.called()
        self._tell(scene)

    def _tell(self, scene: Scene) -> None:
        """Tell what is around the arm, except other arms: a motion is not led around these."""
        told = Scene([volume for volume in scene if volume.name not in self._others],
                     scene.margin)
        key = told.margin, *((
            volume.name, volume.kind, volume.size, volume.pose.tobytes(), volume.twist.tobytes(),
            volume.margin, volume.allowed, volume.carried) for volume in told)
        # Bodies of other arms come many times a second.
        if key != self._told:
            self._told = key
            self._scene_out.publish(scene_message(told, self.parameters.frame_id, self.stamp()))

    def _refuse(self, reason: str) -> None:
        self.control.states.last_refusal = reason
        self.get_logger().warning(f'refused: {reason}', throttle_duration_sec=1.0)

    # Reports

    def _report(self) -> None:
        failed = [loop for loop in self._running() if loop.failure is not None]
        if self.active and failed:
            self.get_logger().error(_failed(failed[0]))
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
        controller.guard.look()
        # After a reset the guard counts from 0 again.
        refused, self._refused = self._refused, states.refused
        if states.refused > refused:
            level = DiagnosticStatus.WARN if level == DiagnosticStatus.OK else level
            publishers = ', '.join(self.participant.publishers(self.parameters.reference_topic))
            self.get_logger().warning(f'reference refused: {states.last_refusal} (published by '
                                      f'{publishers})', throttle_duration_sec=1.0)
        known, self._diagnosis = self._diagnosis, (level, text)
        if self._report_count % DIAGNOSTICS_EVERY and known == (level, text):
            return
        extra = {'references refused': states.refused, 'last refusal': states.last_refusal,
                 'energy tank [J]': f'{controller.tank.energy:.3f}',
                 **{f'{limit.name} limit, ticks': count
                    for limit, count in zip(LIMITS, counters.ticks)},
                 **{f'{limit.name} limit, largest violation [{limit.unit}]': f'{largest:.3g}'
                    for limit, largest in zip(LIMITS, counters.largest)}}
        self._diagnostics.publish(lateness_diagnostics(
            self.get_fully_qualified_name().lstrip('/'), level, text,
            self.lateness.punctuality(1000), {**extra, **self.backend.diagnosed()}, self.stamp()))

    def _changed(self, before: State) -> None:
        # A reason that comes again between two reports is a new one.
        if not self.control.states.reason:
            self._reason = ''

    def _publish_status(self) -> None:
        controller, states = self.control.controller, self.control.states
        if states.last_refusal != self._refusal[0]:
            self._refusal = states.last_refusal, self.stamp()
        clearance, nearest = controller.clearance
        message = ArmStatus(
            mode=states.state.mode, state=states.state.name.lower(), waits_for=states.waits_for,
            reason=states.reason, blocked=controller.blocked, refused=states.refused,
            last_refusal=self._refusal[0], last_refusal_stamp=self._refusal[1],
            tank_low=controller.tank.is_low, tank_energy=controller.tank.energy,
            clearance=clearance, nearest=nearest,
            scale=min(controller.scale, self.backend.speed()))
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
        text = self._activity() or text
        if self._twins:
            level, text = max(level, DiagnosticStatus.WARN), f'{text}, {self._twins}'
            logger.warning(self._twins, throttle_duration_sec=5.0)
        if tank.is_low:
            level, text = max(level, DiagnosticStatus.WARN), (
                f'{text}, energy tank low ({tank.energy:.2g} J): motions slow down and springs '
                'soften')
            logger.warning(text, throttle_duration_sec=5.0)
        blocked = control.controller.blocked
        if blocked:
            level, text = max(level, DiagnosticStatus.WARN), f'{text}, blocked by {blocked}'
            logger.warning(f'the reference is blocked by {blocked}', throttle_duration_sec=5.0)
        limited = control.controller.counters.recent()
        if limited:
            level, text = max(level, DiagnosticStatus.WARN), f'{text}, limited: {limited}'
            logger.warning(f'limited: {limited}', throttle_duration_sec=5.0)
        return level, text

    def _activity(self) -> str:
        """What the arm does, if its state does not say it; problems are logged."""
        motion = self.control.joint_motion
        return self.backend.activity() or (
            motion.what if motion is not None and not motion.done else '')

    def describe(self) -> None:
        """Publish the URDF for RViz, and the frames of its links, unless others do."""
        if self.backend.described:
            return
        arm, p = self.backend.model, self.parameters
        try:
            text = urdf(arm, p.frame_id, p.joint_speed)
        except DataError as error:
            self.get_logger().warning(f'no robot_description: {error}')
            return
        self._description.publish(String(data=text))
        self.state_out.tf.describe(LinkFrames(arm, p.frame_id))


def _failed(loop: RunningLoop) -> str:
    return f'the loop failed: {loop.failure!r}'
