"""Streams a skill as pose and stiffness references at 1 kHz; goals switch while it moves."""
from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import partial
from pathlib import Path
import shutil
import time
from typing import Any

from gdmp_msgs.msg import ServerState
from gdmp_msgs.srv import LearnSkill, LoadSkill, SetSpeed
from geometry_msgs.msg import PoseStamped
import numpy as np
from rclpy.callback_groups import ReentrantCallbackGroup
from rosgraph_msgs.msg import Clock as ClockMessage
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool, Trigger

from gdmp_ros.data import recordings
from gdmp_ros.dmp import Skill
from gdmp_ros.errors import DataError, GdmpError, ParameterError
from gdmp_ros.playback.player import Player
from gdmp_ros.realtime import shared_loop as shared
from gdmp_ros.realtime.statistics import LatenessRecorder
from gdmp_ros.ros import messages as wire
from gdmp_ros.ros.lifecycle import (
    CLOCK_DEPTH,
    ManagedNode,
    own_words,
    run,
    take_latest,
)
from gdmp_ros.ros.parameters import Parameters
from gdmp_ros.ros.server.execute_action import ExecuteAction
from gdmp_ros.ros.server.learning import LearningProcess
from gdmp_ros.ros.server.parameters import player_settings, SPECS
from gdmp_ros.ros.server.reference_publisher import ReferencePublisher
from gdmp_ros.ros.server.report import ServerReport

NS = 1_000_000_000
#: A longer step of the time, of /clock or of the machine's own after the process stood still,
#: moves the grid instead of the motion [s].
CLOCK_JUMP_S, STALL_S = 0.01, 0.05
#: Ticks between two looks at the measured pose, and between two at the goals. Polled, a flood of
#: messages costs no more than a few: an executor would wake for each.
POLL_EVERY = 20


class TrajectoryServer(ManagedNode):
    """The managed node ``trajectory_server``."""

    def __init__(self, namespace: str = '') -> None:
        super().__init__('trajectory_server', namespace)
        self.parameters = Parameters(self, SPECS)
        self.player: Player | None = None
        self.skill_name = ''
        self.thread: shared.Member | None = None
        self.lateness = LatenessRecorder(1_000_000)
        self._measured: tuple[np.ndarray, float] | None = None
        self._action: ExecuteAction | None = None
        self._learning = LearningProcess(self)
        self._last_tick = 0
        self._polled = 0
        self._active = False

    # Lifecycle

    def configure(self) -> None:
        self._check_parameters(self.parameters)
        self.expect_compilation()
        skill, name = self._skill_from_parameters()
        if skill is not None:
            self._use(skill, name)
        self._make_outputs()
        self._make_inputs()
        self._make_services()
        self._action = ExecuteAction(self)
        self.parameters.check = self._check_parameters
        self.parameters.changed = self._use_parameters
        self.parameters.locked = True

    def activate(self) -> None:
        self.lateness = LatenessRecorder(self._period_ns())
        self._last_tick = 0
        # Goals that came while nobody looked are none.
        take_latest(self._goal_poses)
        take_latest(self._goal_matrices)
        self._active = True
        if self.get_parameter('use_sim_time').value:
            self.get_logger().info('simulated time: one reference for each message on /clock')
        else:
            self.thread = shared.join(self._period_ns(), self.parameters.realtime_priority,
                                      self._wall_tick)
            self.log_scheduler(self.thread.scheduler)
        if self.parameters.execute_on_activate:
            self.begin()

    def deactivate(self) -> None:
        if not self._active:
            return
        if self.player is not None and self.player.status in ('moving', 'paused', 'stopping'):
            self.player.stop()
            ends = time.monotonic() + 2.0 / self.player.speed_rate + 1.0
            while self.player.status == 'stopping' and time.monotonic() < ends:
                time.sleep(0.005)
        self._active = False
        if self.thread is not None:
            self.thread.leave()
            self.thread = None
        if self._action is not None:
            self._action.deactivated()
        if self.parameters.lateness_file:
            self.lateness.save(self.parameters.lateness_file)

    def cleanup(self) -> None:
        self.release()
        if self._action is not None:
            self._action.destroy()
            self._learning.cancel()
            self._action = None
        self.player = None
        self._measured = None
        self.parameters.locked = False

    # What it does

    @property
    def active(self) -> bool:
        """Whether references are being streamed."""
        return self._active

    def robot_is_met(self) -> bool:
        """Whether it is known where a motion would start, so far as it has to be."""
        try:
            self._start_pose()
        except ParameterError:
            return not self._active
        return True

    def state(self) -> ServerState:
        """Describe the present state."""
        return self._reporter.state()

    def begin(self, goal_pose: np.ndarray | None = None, goal_stiffness: Any = None,
              duration: float | None = None,
              tolerances: tuple[float, float] | None = None) -> None:
        """
        Start the loaded skill.

        :raises GdmpError: if it cannot start; what is streamed stays as it is
        """
        player = self._loaded()
        if not self._active:
            raise ParameterError('the node is not active')
        factor = None
        if goal_stiffness is not None and len(goal_stiffness):
            factor = player.tool.stiffness_factor(goal_stiffness)
        player.start(self._start_pose(), goal_pose, factor, duration, tolerances)

    def load_skill(self, path: str) -> None:
        """
        Load a skill file for the next start.

        :raises DataError: if it cannot be loaded; the present skill stays
        """
        self._use(Skill.load(path), path)
        self.get_logger().info(f'loaded {path}')

    def checked_goal_pose(self, message: PoseStamped) -> np.ndarray:
        """
        Numbers of a goal pose.

        :raises ManifoldError: in a wrong frame, not finite, not unit, outside the workspace
        """
        numbers = wire.checked_pose(message, self.parameters.frame_id)
        wire.check_workspace(numbers, self.parameters.workspace_min,
                             self.parameters.workspace_max)
        return numbers

    def _loaded(self) -> Player:
        if self.player is None:
            raise ParameterError('no skill is loaded: set the parameter skill or demonstrations, '
                                 'or call ~/load_skill or ~/learn_skill')
        return self.player

    def _skill_from_parameters(self) -> tuple[Skill | None, str]:
        parameters = self.parameters
        if parameters.skill:
            return Skill.load(parameters.skill), parameters.skill
        bags = [bag for bag in parameters.demonstrations if bag]
        if not bags:
            self.get_logger().info('no skill yet: waiting for ~/load_skill or ~/learn_skill')
            return None, ''
        shown = [recordings.read(bag) for bag in bags]
        for recording in shown:
            if recording.frame != parameters.frame_id:
                raise DataError(f'{recording.bag}: poses are in frame {recording.frame!r}, '
                                f'expected {parameters.frame_id!r}')
        demonstrations, origin = recordings.stiffened(shown, parameters.learned_stiffness)
        self.get_logger().info(f'learning from {len(shown)} demonstrations, stiffness: {origin}')
        skill = Skill.learn(demonstrations, n_basis=parameters.n_basis,
                            connection=parameters.connection)
        return skill, ', '.join(bags)

    def _use(self, skill: Skill, name: str) -> None:
        skill.reproduce(skill.duration)  # compiles the kernels, or loads them from the cache
        if self.player is None:
            self.player = Player(skill, player_settings(self.parameters))
        else:
            self.player.load(skill)
        self.skill_name = name

    def _check_parameters(self, proposed: Any) -> None:
        for axis, low, high in zip('xyz', proposed.workspace_min, proposed.workspace_max):
            if low >= high:
                raise ParameterError(f'workspace_min {axis} is {low:g} m, expected less than '
                                     f'workspace_max {axis}, {high:g} m')

    def _use_parameters(self) -> None:
        if self.player is not None:
            self.player.configure(player_settings(self.parameters))

    def _start_pose(self) -> np.ndarray | None:
        if self.parameters.start_from == 'skill':
            return None
        topic = self.resolve_topic_name(self.parameters.measured_pose_topic)
        if self._measured is None:
            raise ParameterError(f'no measured pose has arrived on {topic}: where is the robot? '
                                 "(start_from: skill starts at the skill's own start)")
        pose, arrived = self._measured
        age = time.monotonic() - arrived
        if age > self.parameters.measured_pose_age:
            raise ParameterError(f'the last measured pose on {topic} is {age:.2f} s old, expected '
                                 f'at most {self.parameters.measured_pose_age:g} s')
        return pose

    # Streaming

    def _period_ns(self) -> int:
        return NS // int(self.parameters.rate_hz)

    def _wall_tick(self, deadline_ns: int, now_ns: int) -> None:
        self.lateness.add(deadline_ns, now_ns)
        dt = (deadline_ns - self._last_tick) / NS if self._last_tick else self._period_ns() / NS
        self._last_tick = deadline_ns
        if dt > STALL_S:
            self._reporter.stalled(dt)
            dt = 0.0
        self._publish(dt, time.time_ns() - (time.monotonic_ns() - deadline_ns))

    def _clock_tick(self, message: ClockMessage) -> None:
        if not self._active or not self.get_parameter('use_sim_time').value:
            return
        now = message.clock.sec * NS + message.clock.nanosec
        dt = (now - self._last_tick) / NS if self._last_tick else 0.0
        self._last_tick = now
        self.lateness.add(self.lateness.ticks * self._period_ns(),
                          self.lateness.ticks * self._period_ns())
        if not 0.0 <= dt <= CLOCK_JUMP_S:
            self._reporter.stalled(dt)
            dt = 0.0
        self._publish(dt, now)

    def _publish(self, dt: float, stamp_ns: int) -> None:
        self._polled += 1
        if self._polled % POLL_EVERY == 0:
            self._poll_measured()
        elif self._polled % POLL_EVERY == POLL_EVERY // 2:
            self._poll_goals()
        player = self.player
        if player is None:
            return
        if player.target is None and self._measured is not None and player.status == 'idle':
            player.hold(self._measured[0])
        target = player.tick(dt)
        if target is None:
            return
        self._references.publish(target, stamp_ns)

    # Interfaces

    def _make_outputs(self) -> None:
        self._references = ReferencePublisher(self, self.parameters.frame_id)
        self._reporter = ServerReport(self)
        self.add_report(self._report)

    def _report(self) -> None:
        state = self._reporter.publish()
        if self._action is not None:
            self._action.watch(state)

    def _make_inputs(self) -> None:
        self._measurements = self.add_subscription(PoseStamped,
                                                   self.parameters.measured_pose_topic, None)
        self._goal_poses = self.add_subscription(PoseStamped, '~/goal_pose', None)
        self._goal_matrices = self.add_subscription(Float64MultiArray, '~/goal_stiffness', None)
        if self.get_parameter('use_sim_time').value:
            self.add_subscription(ClockMessage, '/clock', self._clock_tick, CLOCK_DEPTH)

    def _make_services(self) -> None:
        def service(kind: Any, name: str, action: Callable[[Any], None]) -> None:
            self.add_service(kind, name, lambda request, reply: self._answer(
                reply, lambda: action(request)))

        service(Trigger, 'start', lambda _: self.begin())
        service(Trigger, 'stop', lambda _: self._loaded().stop())
        service(SetBool, 'pause', lambda request: self._loaded().pause(request.data))
        service(SetSpeed, 'set_speed', lambda request: self._set_speed(request.scale))
        service(LoadSkill, 'load_skill', lambda request: self.load_skill(request.path))
        # It awaits: in the group of the others it would keep them all waiting.
        self.add_service(LearnSkill, 'learn_skill', self._on_learn, ReentrantCallbackGroup())

    def _answer(self, reply: Any, action: Any) -> Any:
        try:
            action()
            reply.success, reply.message = True, ''
        except GdmpError as error:
            reply.success, reply.message = False, str(error)
            self.get_logger().warning(str(error))
        return reply

    def _set_speed(self, scale: float) -> None:
        if not 0.0 <= scale <= 2.0:
            raise ParameterError(f'speed is {scale!r}, expected a number from 0 to 2')
        self._loaded().set_speed(scale)

    async def _on_learn(self, request: LearnSkill.Request, reply: LearnSkill.Response) -> Any:
        try:
            path, error = await self._learning.learn(request)
            self.load_skill(path)
            if not request.output:
                shutil.rmtree(Path(path).parent, ignore_errors=True)
            reply.success, reply.mean_relative_error = True, error
        except (GdmpError, OSError, ValueError) as problem:
            reply.success, reply.message = False, str(problem)
            self.get_logger().warning(str(problem))
        return reply

    def _guarded(self, topic: str, action: Any) -> None:
        """Use a message; why it is refused is told by the next report."""
        try:
            action()
        except GdmpError as error:
            self._reporter.refused(f'{topic} refused: {error}')
            if self.player is not None:
                self.player.refuse(f'{topic}: {error}')

    def _poll_measured(self) -> None:
        message = take_latest(self._measurements)
        if message is not None:
            self.take_measured(message)

    def _poll_goals(self) -> None:
        pose, matrix = take_latest(self._goal_poses), take_latest(self._goal_matrices)
        if pose is not None:
            self.take_goal_pose(pose)
        if matrix is not None:
            self.take_goal_stiffness(matrix)

    def take_measured(self, message: PoseStamped) -> None:
        """Use a measured pose, or refuse it."""
        def use() -> None:
            self._measured = (wire.checked_pose(message, self.parameters.frame_id),
                              time.monotonic())
            if self.player is not None:
                self.player.observe(self._measured[0])
        self._guarded('measured_pose', use)

    def take_goal_pose(self, message: PoseStamped) -> None:
        """Switch the pose goal, or refuse it."""
        self._guarded('goal_pose', lambda: self._moving().goal_pose(
            self.checked_goal_pose(message)))

    def take_goal_stiffness(self, message: Float64MultiArray) -> None:
        """Switch the stiffness goal, or refuse it."""
        def use() -> None:
            player = self._moving()
            player.goal_stiffness(player.tool.stiffness_factor(message.data))
        self._guarded('goal_stiffness', use)

    def _moving(self) -> Player:
        player = self._loaded()
        if player.status == 'idle' or (player.rollout is None and player.status == 'holding'):
            raise ParameterError('no skill is being executed; start one first')
        return player


def main(arguments: list[str] | None = None) -> int:
    """Run the node ``trajectory_server``, or one for each of several robots."""
    parser = argparse.ArgumentParser(
        prog='trajectory_server', description=__doc__,
        epilog='Parameters follow --ros-args; see config/trajectory_server.yaml.')
    parser.add_argument('--robots', nargs='+', default=[''], metavar='NAMESPACE',
                        help='stream for several robots from this process, one node '
                             'NAMESPACE/trajectory_server each, all in one real-time thread')
    robots = parser.parse_args(own_words(arguments)).robots
    if len(set(robots)) < len(robots):
        parser.error(f'--robots: every namespace once, got {" ".join(robots)}')
    return run([partial(TrajectoryServer, name) for name in robots], arguments)


if __name__ == '__main__':
    raise SystemExit(main())
