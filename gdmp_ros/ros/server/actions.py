"""The actions of a server: ``~/execute`` and ``~/execute_sequence``; a newer goal replaces one."""
from __future__ import annotations

from collections.abc import Callable
import math
from typing import Any, ClassVar, NamedTuple, Protocol

from gdmp_msgs.action import ExecuteSequence, ExecuteSkill
from gdmp_msgs.msg import ArmStatus, ServerState
import numpy as np
from rclpy.task import Future
from std_msgs.msg import Header, String

from gdmp_ros.control.modes import ArmMode, StreamMode
from gdmp_ros.data.sequences import read_sequence
from gdmp_ros.errors import GdmpError, ParameterError
from gdmp_ros.playback.distance import Distance
from gdmp_ros.playback.sequence_runner import OTHER_MOTION
from gdmp_ros.playback.states import Status
from gdmp_ros.playback.streamer import ROBOT_LOST, Streamer
from gdmp_ros.ros.frames import BaseFrame
from gdmp_ros.ros.lifecycle import ManagedNode
from gdmp_ros.ros.middleware import end_goal
from gdmp_ros.ros.server.report import ServerReport

#: Tolerances of the reference if a goal has none [m, rad].
POSITION_TOLERANCE, ROTATION_TOLERANCE = 0.0005, 0.0025


class Execution(Protocol):
    """A goal that is being executed; ``done`` gets the error code and its text."""

    @property
    def handle(self) -> Any:
        """Handle of the goal."""

    @property
    def done(self) -> Future:
        """Completed by `ServerAction._finish`."""


class ServerAction:
    """
    Executes one goal at a time.

    The execute callback is asynchronous: it awaits a future that `_finish` completes, so that
    goals, cancellation and parameters are served meanwhile.
    """

    #: Type of the action, and its name after ``~/``.
    kind: ClassVar[Any]
    name: ClassVar[str]

    def __init__(self, node: ManagedNode, streamer: Streamer, report: ServerReport):
        """Serve the action."""
        self._node, self._streamer, self._report = node, streamer, report
        self._execution: Any = None
        self._cancelling = False
        node.add_action(self.kind, f'~/{self.name}', self._execute, self._accepts, cancel=True)

    def deactivated(self) -> None:
        """End the present goal: the node does not stream any more."""
        self._finish(self.kind.Result.DEACTIVATED, 'the node was deactivated')

    async def _execute(self, handle: Any) -> Any:
        """Execute a goal, and return its result."""
        raise NotImplementedError

    def _is_newly_cancelled(self, execution: Execution) -> bool:
        """Whether the client has asked to cancel the goal since the last call."""
        if self._cancelling or not execution.handle.is_cancel_requested:
            return False
        self._cancelling = True
        return True

    def _problem_on_path(self, largest: Distance) -> tuple[int, str] | None:
        """
        Error code and text if the robot does not follow the reference; None if it does.

        :param largest: allowed distance from the reference [m, rad]; 0: any
        """
        robot, result = self._streamer.robot, self.kind.Result
        if 'blocked' in robot.flags:
            return result.BLOCKED, (
                f'the robot is {robot.lag} from the reference and has not moved for '
                f'{robot.settings.blocked_time:g} s: {_why_not_followed(self._report.arm)}')
        if not robot.largest_lag.within(*(limit or math.inf for limit in largest)):
            return result.PATH_TOLERANCE_VIOLATED, (
                f'the robot was {robot.largest_lag} from the reference, expected at most '
                f'{largest}')
        return None

    def _accepts(self, goal: Any) -> bool:
        if not self._streamer.active:
            self._node.get_logger().warning(f'{self.name}: rejected, the node is not active')
        return self._streamer.active

    def _refused(self, handle: Any, error: GdmpError) -> Any:
        """Result of a goal that cannot be executed; a rejection could not carry the reason."""
        self._streamer.refusals.add(f'{self.name}: {error}')
        handle.abort()
        return self.kind.Result(error_code=self.kind.Result.INVALID_GOAL, error_string=str(error))

    def _finish(self, code: int, text: str) -> None:
        execution, self._execution = self._execution, None
        if execution is not None:
            execution.done.set_result((code, text))


def _what_blocks(arm: ArmStatus | None) -> str:
    """The limit that keeps the arm from its target, if it says one."""
    return f' by {arm.blocked}' if arm is not None and arm.blocked else ''


def _why_not_followed(arm: ArmStatus | None) -> str:
    """
    Why the robot does not move.

    :param arm: what the arm said last; None if that is not known
    """
    if arm is None or arm.mode == ArmMode.UNKNOWN:
        return 'it is blocked, or does not follow'
    if arm.mode == ArmMode.FOLLOW:
        return f'it is blocked{_what_blocks(arm)}'
    said = arm.reason or arm.last_refusal
    return f'the arm does not follow{", " if said else ""}{said}'


class _Execution(NamedTuple):
    """
    A goal that is being executed.

    :ivar motion: number of its motion
    :ivar goal: largest distances of the robot from the goal [m, rad]
    :ivar path: largest distances of the robot from the reference [m, rad]; 0: any
    """

    handle: Any
    motion: int
    done: Future
    goal: Distance
    path: Distance


class ExecuteAction(ServerAction):
    """Executes a skill, and watches whether the robot follows it to its goal."""

    kind, name = ExecuteSkill, 'execute'

    def __init__(self, node: ManagedNode, streamer: Streamer, report: ServerReport,
                 base: BaseFrame, load: Callable[[str], object]):
        """
        Serve the action.

        :param base: frame of the motions; goal poses may be in others
        :param load: uses a skill file
        """
        self._load, self._base = load, base
        self._rested_since = 0.0
        self._unverified = False
        super().__init__(node, streamer, report)

    def watch(self, state: ServerState, motion: int) -> None:
        """
        Give feedback on the present goal, and end it when its motion has ended.

        :param motion: number of the motion that ``state`` is about
        """
        execution, player = self._execution, self._streamer.player
        if execution is None or player is None:
            return
        if self._is_newly_cancelled(execution):
            player.end()
        if motion > execution.motion:
            self._finish(ExecuteSkill.Result.PREEMPTED, 'another motion was started')
        elif motion == execution.motion:
            self._judge(execution, state)

    def _judge(self, execution: _Execution, state: ServerState) -> None:
        holding, gripper = state.status == Status.HOLDING, self._streamer.gripper
        player = self._streamer.player
        awaited = gripper is not None and player is not None and gripper.waits_for_more(player)
        failed = '' if gripper is None else gripper.problem(execution.motion)
        if failed:
            self._finish(ExecuteSkill.Result.GRIPPER_FAILED, failed)
            return
        if holding and self._cancelling:
            self._finish(ExecuteSkill.Result.CANCELED, 'stopped on request')
            return
        if self._streamer.lost_motion == execution.motion:
            self._finish(ExecuteSkill.Result.BLOCKED, ROBOT_LOST)
            return
        # Only a motion has factors.
        if holding and not state.factors:
            self._finish(ExecuteSkill.Result.CANCELED, 'stopped by service')
            return
        execution.handle.publish_feedback(ExecuteSkill.Feedback(
            phase=state.phase, progress=state.progress, factors=state.factors,
            distance_to_goal=state.distance_to_goal, flags=state.flags,
            robot_distance=state.robot_distance))
        if 'held' in state.flags:
            self._finish(ExecuteSkill.Result.HELD, 'a step was not finite; the last state is held')
        elif holding and state.finished and 'not_settled' in state.flags:
            self._finish(ExecuteSkill.Result.GOAL_TOLERANCE_VIOLATED,
                         'the goal was not reached within its tolerance in time')
        elif (state.finished and state.status in (Status.HOLDING, Status.MOVING)
              and not awaited and self._streamer.commands.later is None):
            self._judge_robot_at_goal(execution)
        else:
            self._rested_since = self._streamer.time
            problem = self._problem_on_path(execution.path)
            if problem is not None:
                self._give_up(*problem)

    def _judge_robot_at_goal(self, execution: _Execution) -> None:
        """The reference is at the goal and at rest: wait until the robot is too."""
        robot, player, result = self._streamer.robot, self._streamer.player, ExecuteSkill.Result
        settings, waited = robot.settings, self._streamer.time - self._rested_since
        place, lag = robot.place, robot.lag
        if player is None or place is None or lag is None:
            if robot.seen:
                # It was lost on the way: nothing is known of where it is.
                if waited > settings.settling_time:
                    self._finish(result.GOAL_TOLERANCE_VIOLATED, 'the reference is at the goal, '
                                 'and the measured pose of the robot has ended')
                return
            self._unverified = True
            self._finish(result.SUCCESSFUL, '')
            return
        if player.mode is StreamMode.STREAMING:
            # The goal moves on: the robot cannot rest there.
            there, offset = lag.within(settings.lag_position, settings.lag_rotation), lag
        else:
            offset = player.playing.distance(place, player.goal)
            there = offset.within(*execution.goal) and robot.rests()
        if there:
            self._finish(result.SUCCESSFUL, '')
        elif waited > settings.settling_time:
            what = _what_blocks(self._report.arm)
            text = (f'the reference is at the goal, the robot {offset} from it after '
                    f'{settings.settling_time:g} s, expected {execution.goal}')
            if what:
                text += f' (blocked{what})'
            self._finish(result.GOAL_TOLERANCE_VIOLATED, text)

    def _give_up(self, code: int, text: str) -> None:
        if self._streamer.player is not None:
            self._streamer.player.end()
        self._finish(code, text)

    async def _execute(self, handle: Any) -> ExecuteSkill.Result:
        result = ExecuteSkill.Result()
        try:
            objects = await self._objects_of(handle.request)
            motion = self._begin(handle.request, await self._goal_of(handle.request), objects)
        except GdmpError as error:
            return self._refused(handle, error)
        self._finish(result.PREEMPTED, 'a newer goal was accepted')
        request, settings = handle.request, self._streamer.robot.settings
        execution = _Execution(
            handle, motion, self._node.future(),
            Distance(request.robot_position_tolerance or settings.robot_position_tolerance,
                     request.robot_rotation_tolerance or settings.robot_rotation_tolerance),
            Distance(request.path_position_tolerance or settings.path_position_tolerance,
                     request.path_rotation_tolerance or settings.path_rotation_tolerance))
        self._execution, self._cancelling = execution, False
        self._rested_since, self._unverified = self._streamer.time, False
        result.error_code, result.error_string = await execution.done
        state = self._report.state()
        result.factors, result.distance_to_goal = state.factors, state.distance_to_goal
        result.flags = [*state.flags, *(['unverified'] if self._unverified else [])]
        result.robot_distance = state.robot_distance
        end_goal(handle, result.error_code == result.SUCCESSFUL)
        return result

    async def _objects_of(self, goal: ExecuteSkill.Goal) -> dict[str, np.ndarray]:
        """
        Poses of the objects of a request, as soon as it is known where those of /tf are.

        :raises GdmpError: if one of them is no pose, or in a frame that is not known
        """
        given = {one.child_frame_id: one for one in goal.objects}
        for one in given.values():
            one.header.frame_id = one.header.frame_id or self._base.name
        headers = [*(one.header for one in given.values()),
                   *(Header(frame_id=name) for name in self._streamer.objects.names - set(given))]

        def known() -> bool:
            return all(self._base.knows(header) for header in headers)
        if headers and not known():
            await self._node.wait_until(known, 0.02,
                                        self._node.get_parameter('tf_timeout').value)
        return {name: self._base.transformed(one) for name, one in given.items()}

    async def _goal_of(self, goal: ExecuteSkill.Goal) -> np.ndarray | None:
        """
        Goal pose of a request, as soon as its frame is known; None if it has none.

        Four zeros for its rotation: that of the skill.
        """
        if not goal.use_goal_pose:
            return None
        header = goal.goal_pose.header
        if not header.frame_id:
            header.frame_id = self._base.name
            self._node.get_logger().info(
                f'{self.name}: a goal without a frame is in {header.frame_id}')
        if not self._base.knows(header):
            await self._node.wait_until(lambda: self._base.knows(header), 0.02,
                                        self._node.get_parameter('tf_timeout').value)
        turned = goal.goal_pose.pose.orientation
        if not any((turned.w, turned.x, turned.y, turned.z)):
            turned.w = 1.0
            return np.concatenate([self._base.pose(goal.goal_pose)[:3], np.zeros(4)])
        return self._base.pose(goal.goal_pose)

    def _begin(self, goal: ExecuteSkill.Goal, pose: np.ndarray | None,
               objects: dict[str, np.ndarray]) -> int:
        tolerances = (f'{of}{what}_tolerance' for of in ('', 'robot_', 'path_')
                      for what in ('position', 'rotation'))
        for name in ('duration', 'cycles', 'goal_after', *tolerances):
            value = getattr(goal, name)
            if not value >= 0.0:
                raise ParameterError(f'{name} is {value!r}, expected a number >= 0')
        if goal.skill:
            self._load(goal.skill)
        return self._streamer.begin(pose, goal.goal_stiffness, goal.duration or None,
                                    (goal.position_tolerance or POSITION_TOLERANCE,
                                     goal.rotation_tolerance or ROTATION_TOLERANCE),
                                    goal.cycles or None, goal.goal_after, objects)


class _SequenceExecution(NamedTuple):
    handle: Any
    done: Future


class SequenceAction(ServerAction):
    """Executes one sequence at a time; the topic ``~/signal`` ends steps that wait for it."""

    kind, name = ExecuteSequence, 'execute_sequence'

    def __init__(self, node: ManagedNode, streamer: Streamer, report: ServerReport):
        super().__init__(node, streamer, report)
        node.add_subscription(String, '~/signal', self._on_signal, 10)

    def watch(self, state: ServerState, motion: int) -> None:
        """
        Give feedback on the present goal, and end it when its sequence has ended.

        :param motion: number of the motion that ``state`` is about
        """
        execution, status = self._execution, self._streamer.sequence.status
        if execution is None or status is None:
            return
        result = ExecuteSequence.Result
        if self._is_newly_cancelled(execution):
            self._streamer.stop_motion()
        execution.handle.publish_feedback(ExecuteSequence.Feedback(
            step=status.step, steps=status.steps, step_name=status.step_name,
            progress=state.progress))
        if status.running:
            if status.motion == motion:
                self._judge(state)
        elif self._cancelling:
            self._finish(result.CANCELED, 'stopped on request')
        elif status.problem:
            code = (result.GRIPPER_FAILED if status.gripper_failed else
                    result.PREEMPTED if status.problem == OTHER_MOTION else result.CANCELED)
            self._finish(code, f'step {status.step}, {status.step_name}: {status.problem}')
        else:
            self._finish(result.SUCCESSFUL, '')

    def _judge(self, state: ServerState) -> None:
        settings, result = self._streamer.robot.settings, ExecuteSequence.Result
        problem: tuple[int, str] | None
        if 'held' in state.flags:
            problem = result.HELD, 'a step was not finite; the last state is held'
        elif 'not_settled' in state.flags:
            problem = (result.GOAL_TOLERANCE_VIOLATED,
                       'the goal was not reached within its tolerance in time')
        else:
            problem = self._problem_on_path(Distance(settings.path_position_tolerance,
                                                     settings.path_rotation_tolerance))
        if problem is not None:
            self._streamer.stop_motion()
            self._finish(*problem)

    def _on_signal(self, message: String) -> None:
        try:
            self._streamer.sequence.signal(message.data)
        except ParameterError as error:
            self._streamer.refusals.add(str(error))

    async def _execute(self, handle: Any) -> ExecuteSequence.Result:
        result, request = ExecuteSequence.Result(), handle.request
        try:
            first = max(int(request.first_step), 1) - 1
            if len(request.files) != len(request.contents):
                raise ParameterError(f'{len(request.files)} files and {len(request.contents)} '
                                     'contents, expected one for each')
            sequence = read_sequence(request.sequence, dict(zip(request.files, request.contents)))
            self._streamer.begin_sequence(sequence, first)
        except GdmpError as error:
            return self._refused(handle, error)
        self._finish(result.PREEMPTED, 'a newer goal was accepted')
        execution = self._execution = _SequenceExecution(handle, self._node.future())
        self._cancelling = False
        result.error_code, result.error_string = await execution.done
        status = self._streamer.sequence.status
        result.step = 0 if status is None else status.step
        end_goal(handle, result.error_code == result.SUCCESSFUL)
        return result
