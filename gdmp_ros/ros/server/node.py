"""Node ``trajectory_server``: streams a skill as references at 1 kHz; goals switch meanwhile."""
from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
import shutil
from typing import Any

from gdmp_msgs.msg import Context
from gdmp_msgs.msg import Scene as SceneMessage
from gdmp_msgs.srv import LearnSkill, LoadSkill, RefineSkill, SetSpeed
import numpy as np
from rosgraph_msgs.msg import Clock as ClockMessage
from std_srvs.srv import SetBool, Trigger

from gdmp_ros.choices import CONNECTIONS, STIFFNESSES
from gdmp_ros.data.bags import ns_of
from gdmp_ros.dmp.options import check_range, MAX_SPEED
from gdmp_ros.errors import GdmpError
from gdmp_ros.manifolds.poses import compose
from gdmp_ros.playback.goal_check import no_second_arm
from gdmp_ros.playback.measured_input import MeasuredInputs
from gdmp_ros.playback.objects import ObjectSettings
from gdmp_ros.playback.robot_watch import RobotSettings
from gdmp_ros.playback.settings import PlayerSettings, StreamSettings
from gdmp_ros.playback.streamed_skill import Kind
from gdmp_ros.playback.streamer import READ_EVERY, Streamer
from gdmp_ros.realtime.loop import Loop, NS, periodic, priority_beside
from gdmp_ros.realtime.native import DEADLINE, LEFT, prepared, STAMP
from gdmp_ros.ros.frames import BaseFrame, FrameError
from gdmp_ros.ros.lifecycle import CHECK_EVERY, ManagedNode
from gdmp_ros.ros.middleware import CLOCK_DEPTH, reliable, Subscription
from gdmp_ros.ros.parameters import Parameters, settings_from, Spec, specs_of
from gdmp_ros.ros.rcl import Arrivals
from gdmp_ros.ros.running import own_arguments, run
from gdmp_ros.ros.scene.messages import scene_of
from gdmp_ros.ros.scene.topics import SceneTopics
from gdmp_ros.ros.scene.topics import SPECS as SCENE_SPECS
from gdmp_ros.ros.server.actions import ExecuteAction, SequenceAction
from gdmp_ros.ros.server.compiled_loop import CHANGED, COMMANDED, ServerLoop, TICKED, warm_up
from gdmp_ros.ros.server.inputs import GoalTopics, GripperTopics, ObjectsOnTf, RobotInputs
from gdmp_ros.ros.server.reference_publisher import ReferencePublisher, SecondArm
from gdmp_ros.ros.server.report import ServerReport
from gdmp_ros.ros.server.skills import LearningProcess, Refinement, SkillLoader
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.frames import ToolTransform
from gdmp_ros.sim.path_check import PathChecker, Reach

#: Frame in which goals are checked with the built-in Panda by default.
PANDA_FRAME = 'panda_link0'
_TOOL = {'position': 'tool_position', 'rotation': 'tool_rotation'}
SPECS = (
    Spec('autostart', True, 'configure and activate at start-up'),
    Spec('skill', '', 'skill file to load; empty: learn from `demonstrations`, or load later'),
    Spec('demonstrations', [''], 'rosbag2 folders to learn from if there is no skill file'),
    Spec('n_basis', 0, 'number of basis functions when learning; 0: as many as the data need',
         low=0, high=2000),
    Spec('connection', 'parallel', 'connection when learning', choices=CONNECTIONS),
    Spec('learned_stiffness', 'auto', 'origin of the stiffness when learning: as recorded, from '
         'the variance of several demonstrations, or none; auto: the first of these that is '
         'possible', choices=STIFFNESSES),
    Spec('frame_id', 'panda_link0', 'frame of references; goals and measured poses in another '
         'one are transformed by /tf'),
    Spec('tf_timeout', 1.0, 'a goal in a frame of which nothing is known yet waits this long', 's',
         0.0, 60.0, changes='live'),
    *specs_of(ObjectSettings, 'motion'),
    *SCENE_SPECS,
    Spec('rate_hz', 1000, 'ticks per second', 'Hz', 10, 2000),
    Spec('execute_on_activate', False, 'start the skill when the node is activated'),
    Spec('reach_model', '', 'arm with which goals, and skills when they are loaded, are checked: '
         'MJCF file, menagerie:NAME or robot_descriptions:NAME; empty: the built-in Panda if '
         'frame_id is panda_link0; none: no check'),
    Spec('tool_site', 'tcp', 'site of that model that is the tool'),
    *specs_of(ToolTransform, 'configure', names=_TOOL),
    Spec('measured_pose_topic', '~/measured_pose', "PoseStamped of the robot's tool"),
    Spec('second_frame_id', '', 'for skills of two arms: base frame of the second arm and of its '
         'references; /tf_static tells where it is in frame_id. Empty: there is one arm'),
    Spec('second_measured_pose_topic', '~/second/measured_pose', "PoseStamped of the second arm's "
         'tool'),
    Spec('measured_joints_topic', 'joint_states', 'JointState of the robot, for skills of the '
         'joints'),
    Spec('gripper', 'gripper', 'name before the topics of the gripper: gripper/command, '
         'gripper/state'),
    Spec('arm_status_topic', 'panda_sim/status', 'gdmp_msgs/ArmStatus of the arm, if it has one; '
         'what the arm keeps away from is taken from the topic surroundings beside it'),
    *specs_of(StreamSettings),
    *specs_of(RobotSettings),
    *specs_of(PlayerSettings, 'motion'),
    Spec('realtime_priority', -1, 'SCHED_FIFO priority of the streaming thread; -1: 40 if the '
         'system grants it; 0: never', low=-1, high=99),
    Spec('lateness_file', '', 'NumPy file for deadline and lateness of all ticks'),
)
#: Largest step of the time; after a longer one the motion does not advance. Of /clock, and of the
#: steady clock, which jumps when the process was stopped [s].
CLOCK_JUMP_S, STALL_S = 0.01, 0.05
#: Least number of ticks between two uses of goals, and number between two looks at objects.
POLL_EVERY = 20
#: Time after which a thread that waits for messages looks whether it is to end [ns].
LONGEST_WAIT_NS = 100_000_000


def kinematics(parameters: Any) -> tuple[Reach, PathChecker] | tuple[None, None]:
    """
    Inverse kinematics of the arm, and what checks paths with it; None without a model.

    :raises DataError: if the model cannot be loaded
    """
    model, tool = parameters.reach_model, parameters.tool_site
    if model == 'none' or (not model and parameters.frame_id != PANDA_FRAME):
        return None, None
    arm = Arm(model, tool)
    arm.put_tool(settings_from(parameters, ToolTransform, _TOOL))
    return Reach(arm, tool), PathChecker(arm, tool)


class TrajectoryServer(ManagedNode):
    """The managed node ``trajectory_server``."""

    streamer: Streamer
    goals: GoalTopics
    _skills: SkillLoader
    _refinement: Refinement
    _report: ServerReport
    _action: ExecuteAction
    _sequences: SequenceAction
    _references: ReferencePublisher
    _second: SecondArm | None
    _compiled: ServerLoop | None
    #: Subscription to /clock, and what sets the time of the node; with simulated time only.
    _clock_input: tuple[Subscription, Callable[[ClockMessage], None]]

    def __init__(self, namespace: str = '') -> None:
        super().__init__('trajectory_server', namespace)
        self.parameters = Parameters(self, SPECS)
        self._learning = LearningProcess(self, self.parameters)
        self._came = True  # goals, since they were used last
        self._configured = False

    # Lifecycle

    def configure(self) -> None:
        parameters = self.parameters
        self._base = BaseFrame(self, parameters.frame_id)
        self.inputs = RobotInputs(self, parameters, self._base)
        reach, checker = kinematics(parameters)
        second = self._second = (SecondArm(self, parameters, self._base, self.inputs)
                                 if parameters.second_frame_id else None)
        self.streamer = Streamer(
            self._period_ns(), MeasuredInputs(self.inputs.pose, self.inputs.joints,
                                              second.pose if second else None),
            settings_from(parameters, StreamSettings), settings_from(parameters, PlayerSettings),
            settings_from(parameters, RobotSettings),
            reach, GripperTopics(self, parameters.gripper),
            second.base if second else no_second_arm, ObjectsOnTf(self, self._base),
            settings_from(parameters, ObjectSettings))
        if self.streamer.objects.names:
            self._base.listen()
        self.inputs.connect(self.streamer)
        if checker is not None:
            self.streamer.surroundings.tool = checker.tool
        self._scene = SceneTopics(
            self, self._base.place_of, parameters, self.streamer.surround,
            self.streamer.refusals.add,
            dict if checker is None else lambda: checker.tool_frames(parameters.frame_id))
        arm = parameters.arm_status_topic.rpartition('/')[0]
        self._surroundings: SceneMessage | None = None
        self.add_subscription(SceneMessage, f'{arm}/surroundings', self._on_surroundings, 1,
                              late=True)
        self.add_report(self._look_again)
        self._skills = SkillLoader(self.streamer, checker, self.get_logger())
        self._skills.use_that_of(parameters)
        self._refinement = Refinement(self.streamer, self._skills, self.get_logger())
        self._configured = True
        self._references = ReferencePublisher(self, parameters.frame_id)
        self._compiled = prepared(lambda: ServerLoop(self._references, STALL_S),
                                  self.get_logger().info)
        if self._compiled is not None:
            warm_up()
        self._report = ServerReport(self, self.streamer, parameters.frame_id,
                                    parameters.arm_status_topic)
        self.goals = GoalTopics(self, self.streamer, self._base, parameters.frame_id,
                                second is not None)
        self._action = ExecuteAction(self, self.streamer, self._report, self._base,
                                     self._skills.load)
        self._sequences = SequenceAction(self, self.streamer, self._report)
        self.add_report(self._publish_report)
        self.add_subscription(Context, '~/context', self._skills.use_context)
        self._add_services()
        parameters.check = partial(settings_from, settings_class=StreamSettings)
        parameters.changed = self._use_parameters
        parameters.locked = True

    def activate(self) -> None:
        self.goals.discard()
        self.streamer.activate(self._period_ns())
        if self.get_parameter('use_sim_time').value:
            self.get_logger().info('simulated time: one reference for each message on /clock')
            self.streamer.member = self.participant.follow(
                self._clock_input[0], self._clock_tick, self.parameters.realtime_priority)
        else:
            priority = self.parameters.realtime_priority
            running = self.streamer.member = self.clock.start(self._ticks(), priority)
            if self._compiled is not None:
                self._compiled.look()
                self.streamer.looking = self.clock.start(self._look_around(self._compiled),
                                                         priority_beside(priority))
            self.loop_began(running.scheduler)
        if self.parameters.execute_on_activate:
            self.streamer.begin()

    def deactivate(self) -> None:
        if not self._configured or not self.streamer.active:
            return
        self.streamer.stop()
        self.streamer.active = False
        self.streamer.called()
        for running in (self.streamer.member, self.streamer.looking):
            if running is not None:
                running.end()
        self.streamer.member = self.streamer.looking = None
        self._references.end()
        if self._second is not None:
            self._second.end()
        self._action.deactivated()
        self._sequences.deactivated()
        if self.parameters.lateness_file:
            self.streamer.lateness.save(self.parameters.lateness_file)

    def cleanup(self) -> None:
        super().cleanup()
        if self._configured:
            self._learning.cancel()
        self._configured = False

    # Streaming

    def _period_ns(self) -> int:
        return NS // int(self.parameters.rate_hz)

    def _ticks(self) -> Loop:
        """Tick on the grid of the steady clock."""
        if self._compiled is None:
            return periodic(self._wall_tick, self._period_ns(), self.clock)
        return self._without_interpreter(self._compiled)

    def _without_interpreter(self, compiled: ServerLoop) -> Loop:
        """Let compiled code make the ticks; one that it does not make is made here."""
        streamer, numbers = self.streamer, compiled.numbers
        compiled.begin(self._period_ns())
        streamer.called, streamer.whole = compiled.call, compiled.whole
        streamer.ticked = compiled.ticked
        while True:
            why = compiled.run(streamer)
            if why == COMMANDED:
                streamer.command_gripper(compiled.passed)
                yield 0
                continue
            if why == CHANGED:
                target: np.ndarray | None = streamer.end_tick(compiled.passed)
            else:
                target = streamer.tick_only(int(numbers[DEADLINE]), STALL_S)
                numbers[TICKED], numbers[LEFT] = numbers[DEADLINE], 0
            self._publish(target, int(numbers[STAMP]))
            yield 0

    def _look_around(self, compiled: ServerLoop) -> Loop:
        """Use goals that come, and find out where the robot is, beside a loop that does not."""
        between, until_look = (every * self._period_ns() for every in (POLL_EVERY, READ_EVERY))
        woken, polled, look_at, looks = 0, 0, self.clock.now(), 0
        with Arrivals(self.goals.subscriptions) as arrivals:
            while True:
                # A wake-up costs more than the work that is done in it.
                due = min(look_at, polled + between) if self.streamer.objects.names else look_at
                came = arrivals.wait_until(min(due, self.clock.now() + LONGEST_WAIT_NS))
                # In a flood of messages, one is used in each `POLL_EVERY` ticks.
                yield woken + between if came else 0
                now = self.clock.now()
                if came:
                    woken = now
                elif now < due:
                    continue
                polled = now
                self._poll(came)
                if now < look_at:
                    continue
                self.streamer.look()
                if looks % (CHECK_EVERY // READ_EVERY) == 0:
                    compiled.look()
                look_at, looks = max(look_at + until_look, now), looks + 1

    def _wall_tick(self, deadline_ns: int, now_ns: int) -> None:
        self.streamer.lateness.add(deadline_ns, now_ns)
        self._tick(deadline_ns, STALL_S, self.clock.wall() - (self.clock.now() - deadline_ns))

    def subscribe_clock(self, topic: str, callback: Callable[[Any], None], quality: Any
                        ) -> Subscription:
        """Subscribe to simulated time; an executor would take half a millisecond a message."""
        result = self.participant.subscription(ClockMessage, topic, reliable(CLOCK_DEPTH))
        self._clock_input = result, callback
        return result

    def _clock_tick(self, message: ClockMessage) -> None:
        try:
            self._clock_input[1](message)  # the time of the node
        except (ValueError, OverflowError, RuntimeError) as error:  # rclpy: a negative time
            self.streamer.refusals.add(f'/clock: {error}')
            return
        now = ns_of(message.clock)
        # Every message is a tick on time.
        deadline = self.streamer.lateness.ticks * self._period_ns()
        self.streamer.lateness.add(deadline, deadline)
        self._tick(now, CLOCK_JUMP_S, now)

    def _tick(self, now_ns: int, longest_s: float, stamp_ns: int) -> None:
        if self.streamer.ticks % POLL_EVERY == 0:
            self._poll()
        self._publish(self.streamer.tick(now_ns, longest_s), stamp_ns)

    def _poll(self, came: bool = True) -> None:
        """
        Use the newest goals, and where the objects are.

        :param came: whether goals may have come
        """
        self._came |= came
        if self.streamer.joints == 0:
            if self._came or self.goals.waiting:
                self._came = False
                self.goals.poll(self.parameters.tf_timeout)
            self.streamer.follow_objects()

    def _publish(self, target: np.ndarray | None, stamp_ns: int) -> None:
        if target is None:
            return
        self._references.publish(target, stamp_ns, self.streamer.mode, self.streamer.joints)
        if self._second is not None:
            if self.streamer.kind is Kind.TWO_TOOLS:
                self._second.publish(target, stamp_ns, self.streamer.mode)
            else:
                self._second.end()

    # Interfaces

    def _add_services(self) -> None:
        def service(kind: Any, name: str, action: Callable[[Any], object]) -> None:
            self.add_service(kind, name, lambda request, reply: self._answer(
                reply, lambda: action(request)))

        streamer = self.streamer
        service(Trigger, 'start', lambda _: streamer.begin())
        service(Trigger, 'stop', lambda _: streamer.stop_motion())
        service(SetBool, 'pause', lambda request: streamer.pause(request.data))
        service(SetSpeed, 'set_speed', lambda request: self._set_speed(request.scale))
        self.add_service(LoadSkill, 'load_skill', self._skills.answer)
        self.add_service(RefineSkill, 'refine_skill', self._refinement.answer)
        self.add_service(LearnSkill, 'learn_skill', self._on_learn, concurrent=True)

    def _answer(self, reply: Any, action: Callable[[], object]) -> Any:
        try:
            action()
            reply.success, reply.message = True, ''
        except GdmpError as error:
            reply.success, reply.message = False, str(error)
            self.get_logger().warning(str(error))
        return reply

    def _set_speed(self, scale: float) -> None:
        check_range('speed', scale, 0.0, MAX_SPEED)
        self.streamer.loaded().set_speed(scale)

    async def _on_learn(self, request: LearnSkill.Request, reply: LearnSkill.Response) -> Any:
        try:
            path, error = await self._learning.learn(request)
            try:
                # A temporary file is gone soon: the name says where the skill comes from.
                reply.message = self._skills.load(
                    path, '' if request.output else ', '.join(request.bags))
            finally:
                if not request.output:
                    shutil.rmtree(Path(path).parent, ignore_errors=True)
            reply.success, reply.mean_relative_error = True, error
        except (GdmpError, OSError, ValueError) as problem:
            reply.success, reply.message = False, str(problem)
            self.get_logger().warning(str(problem))
        return reply

    def _on_surroundings(self, message: SceneMessage) -> None:
        """Lead motions around what the arm keeps away from, too."""
        self._surroundings = None
        try:
            scene, place = scene_of(message), self._base.place_of(message.header)
            self._scene.beside('arm', [replace(
                volume if place is None or volume.carried
                else volume.at(compose(place, volume.pose)),
                margin=scene.margin if volume.margin is None else volume.margin)
                for volume in scene])
        except FrameError as error:
            # It comes once: /tf_static may be later.
            self._surroundings = message
            self.streamer.refusals.add(f'surroundings of the arm: {error}')
        except GdmpError as error:
            self.streamer.refusals.add(f'surroundings of the arm: {error}')

    def _look_again(self) -> None:
        """Read surroundings in a frame that was not known before."""
        if self._surroundings is not None:
            self._on_surroundings(self._surroundings)

    def _publish_report(self) -> None:
        player = self.streamer.player
        if not self.streamer.active and self.get_parameter('use_sim_time').value:
            message = self._clock_input[0].newest_message()
            if message is not None:
                self._clock_input[1](message)
        if self.streamer.joints:
            # Not in the tick: inverse kinematics takes some milliseconds.
            self.goals.poll(self.parameters.tf_timeout)
        # Read before the state: a new motion must not be compared with the previous state.
        motion = player.motion if player is not None else 0
        state = self._report.publish()
        self._action.watch(state, motion)
        self._sequences.watch(state, motion)

    def _use_parameters(self) -> None:
        p = self.parameters
        self.streamer.configure(
            settings_from(p, StreamSettings), settings_from(p, PlayerSettings),
            settings_from(p, RobotSettings), settings_from(p, ObjectSettings))
        if self.streamer.objects.names:
            self._base.listen()


def main(arguments: list[str] | None = None) -> int:
    """Run the node ``trajectory_server``, or one for each of several robots."""
    parser = argparse.ArgumentParser(
        prog='trajectory_server', description=__doc__,
        epilog='Parameters follow --ros-args; see config/trajectory_server.yaml.')
    parser.add_argument('--robots', nargs='+', default=[''], metavar='NAMESPACE',
                        help='stream for several robots from this process: one node '
                             'NAMESPACE/trajectory_server each, with a real-time thread each')
    robots = parser.parse_args(own_arguments(arguments)).robots
    if len(set(robots)) < len(robots):
        parser.error(f'--robots: every namespace must occur once, got {" ".join(robots)}')
    return run([partial(TrajectoryServer, name) for name in robots], arguments)


if __name__ == '__main__':
    raise SystemExit(main())
