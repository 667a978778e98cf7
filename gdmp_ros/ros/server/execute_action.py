"""The action ``~/execute``: a skill to its goal, with feedback; a newer goal replaces it."""
from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from gdmp_msgs.action import ExecuteSkill
from gdmp_msgs.msg import ServerState
import numpy as np
from rclpy.task import Future

from gdmp_ros.control.modes import StreamMode
from gdmp_ros.errors import GdmpError, ParameterError
from gdmp_ros.playback.distance import Distance
from gdmp_ros.playback.requests import Status
from gdmp_ros.playback.streamer import Streamer
from gdmp_ros.ros.frames import BaseFrame
from gdmp_ros.ros.lifecycle import ManagedNode
from gdmp_ros.ros.server.report import ServerReport
from gdmp_ros.ros.server.server_action import ServerAction

#: Tolerances of the reference if a goal has none [m, rad].
POSITION_TOLERANCE, ROTATION_TOLERANCE = 0.0005, 0.0025


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
            player.stop()
        if motion > execution.motion:
            self._finish(ExecuteSkill.Result.PREEMPTED, 'another motion was started')
        elif motion == execution.motion:
            self._judge(execution, state)

    def _judge(self, execution: _Execution, state: ServerState) -> None:
        holding, gripper = state.status == Status.HOLDING, self._streamer.gripper
        if gripper is not None and gripper.problem:
            self._finish(ExecuteSkill.Result.GRIPPER_FAILED, gripper.problem)
            return
        if holding and self._cancelling:
            self._finish(ExecuteSkill.Result.CANCELED, 'stopped on request')
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
        elif holding and state.finished:
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
            there, away = lag.within(settings.lag_position, settings.lag_rotation), lag
        else:
            away = player.playing.distance(place, player.goal)
            there = away.within(*execution.goal) and robot.rests()
        if there:
            self._finish(result.SUCCESSFUL, '')
        elif waited > settings.settling_time:
            text = (f'the reference is at the goal, the robot {away} from it after '
                    f'{settings.settling_time:g} s, expected {execution.goal}')
            self._finish(result.GOAL_TOLERANCE_VIOLATED, text)

    def _give_up(self, code: int, text: str) -> None:
        if self._streamer.player is not None:
            self._streamer.player.stop()
        self._finish(code, text)

    async def _execute(self, handle: Any) -> ExecuteSkill.Result:
        result = ExecuteSkill.Result()
        self._finish(ExecuteSkill.Result.PREEMPTED, 'a newer goal was accepted')
        try:
            motion = self._begin(handle.request, await self._goal_of(handle.request))
        except GdmpError as error:
            return self._refused(handle, error)
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
        self._end(handle, result)
        return result

    async def _goal_of(self, goal: ExecuteSkill.Goal) -> np.ndarray | None:
        """Goal pose of a request, as soon as its frame is known; None if it has none."""
        if not goal.use_goal_pose:
            return None
        header = goal.goal_pose.header
        if not self._base.knows(header):
            await self._node.wait_until(lambda: self._base.knows(header), 0.02,
                                        self._node.get_parameter('tf_timeout').value)
        return self._base.pose(goal.goal_pose)

    def _begin(self, goal: ExecuteSkill.Goal, pose: np.ndarray | None) -> int:
        tolerances = (f'{of}{what}_tolerance' for of in ('', 'robot_', 'path_')
                      for what in ('position', 'rotation'))
        for name in ('duration', 'cycles', *tolerances):
            value = getattr(goal, name)
            if not value >= 0.0:
                raise ParameterError(f'{name} is {value!r}, expected a number >= 0')
        if goal.skill:
            self._load(goal.skill)
        return self._streamer.begin(pose, goal.goal_stiffness, goal.duration or None,
                                    (goal.position_tolerance or POSITION_TOLERANCE,
                                     goal.rotation_tolerance or ROTATION_TOLERANCE),
                                    goal.cycles or None)
