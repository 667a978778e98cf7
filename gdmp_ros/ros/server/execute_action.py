"""The action ``~/execute``: a skill to its goal, with feedback; a newer goal replaces it."""
from __future__ import annotations

from typing import Any, NamedTuple

from gdmp_msgs.action import ExecuteSkill
from gdmp_msgs.msg import ServerState
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.task import Future

from gdmp_ros.errors import GdmpError, ParameterError
from gdmp_ros.playback.requests import Status
from gdmp_ros.playback.streamer import Streamer
from gdmp_ros.ros.lifecycle import ManagedNode
from gdmp_ros.ros.messages import checked_pose
from gdmp_ros.ros.server.report import ServerReport

#: Tolerances if a goal has none [m, rad].
POSITION_TOLERANCE, ROTATION_TOLERANCE = 0.0005, 0.0025


class _Execution(NamedTuple):
    """A goal that is being executed: its handle, the number of its motion, its result."""

    handle: Any
    motion: int
    done: Future


class ExecuteAction:
    """
    Executes one goal at a time.

    The execute callback is asynchronous: it awaits a future that `watch` completes, so that goals,
    cancellation and parameters are served meanwhile.
    """

    def __init__(self, node: ManagedNode, streamer: Streamer, report: ServerReport, frame: str):
        """:param frame: ``frame_id`` of goal poses"""
        self._node, self._streamer, self._report = node, streamer, report
        self._frame = frame
        self._execution: _Execution | None = None
        self._cancelling = False
        self._action = ActionServer(node, ExecuteSkill, '~/execute', self._execute,
                                    goal_callback=self._on_goal,
                                    cancel_callback=lambda _: CancelResponse.ACCEPT)

    def destroy(self) -> None:
        """Destroy the action server."""
        self._action.destroy()

    def deactivated(self) -> None:
        """End the present goal: the node does not stream any more."""
        self._finish(ExecuteSkill.Result.DEACTIVATED, 'the node was deactivated')

    def watch(self, state: ServerState, motion: int) -> None:
        """
        Give feedback on the present goal, and end it when its motion has ended.

        :param motion: number of the motion that ``state`` is about
        """
        execution, player = self._execution, self._streamer.player
        if execution is None or player is None:
            return
        if execution.handle.is_cancel_requested and not self._cancelling:
            self._cancelling = True
            player.stop()
        if motion > execution.motion:
            self._finish(ExecuteSkill.Result.PREEMPTED, 'another motion was started')
        elif motion == execution.motion:
            self._judge(execution, state)

    def _judge(self, execution: _Execution, state: ServerState) -> None:
        holding = state.status == Status.HOLDING
        if holding and self._cancelling:
            self._finish(ExecuteSkill.Result.CANCELED, 'stopped on request')
            return
        # Only a motion has factors.
        if holding and not state.factors:
            self._finish(ExecuteSkill.Result.CANCELED, 'stopped by service')
            return
        execution.handle.publish_feedback(ExecuteSkill.Feedback(
            phase=state.phase, progress=state.progress, factors=state.factors,
            distance_to_goal=state.distance_to_goal))
        if 'held' in state.flags:
            self._finish(ExecuteSkill.Result.HELD, 'a step was not finite; the last state is held')
        elif holding and state.finished and 'not_settled' in state.flags:
            self._finish(ExecuteSkill.Result.GOAL_TOLERANCE_VIOLATED,
                         'the goal was not reached within its tolerance in time')
        elif holding and state.finished:
            self._finish(ExecuteSkill.Result.SUCCESSFUL, '')

    def _on_goal(self, goal: ExecuteSkill.Goal) -> GoalResponse:
        if self._streamer.active:
            return GoalResponse.ACCEPT
        self._node.get_logger().warning('execute: rejected, the node is not active')
        return GoalResponse.REJECT

    async def _execute(self, handle: Any) -> ExecuteSkill.Result:
        result = ExecuteSkill.Result()
        self._finish(ExecuteSkill.Result.PREEMPTED, 'a newer goal was accepted')
        try:
            motion = self._begin(handle.request)
        except GdmpError as error:
            self._node.get_logger().warning(f'execute: {error}')
            handle.abort()
            result.error_code, result.error_string = result.INVALID_GOAL, str(error)
            return result
        execution = _Execution(handle, motion, self._node.future())
        self._execution, self._cancelling = execution, False
        result.error_code, result.error_string = await execution.done
        state = self._report.state()
        result.factors, result.distance_to_goal = state.factors, state.distance_to_goal
        if result.error_code == result.SUCCESSFUL:
            handle.succeed()
        elif handle.is_cancel_requested:
            handle.canceled()
        else:
            handle.abort()
        return result

    def _begin(self, goal: ExecuteSkill.Goal) -> int:
        for name in ('duration', 'position_tolerance', 'rotation_tolerance'):
            value = getattr(goal, name)
            if not value >= 0.0:
                raise ParameterError(f'{name} is {value!r}, expected a number >= 0')
        pose = None
        if goal.use_goal_pose:
            pose = checked_pose(goal.goal_pose, self._frame)
            self._streamer.check_goal(pose)
        if goal.skill:
            self._streamer.load(goal.skill)
        return self._streamer.begin(pose, goal.goal_stiffness, goal.duration or None,
                                    (goal.position_tolerance or POSITION_TOLERANCE,
                                     goal.rotation_tolerance or ROTATION_TOLERANCE))

    def _finish(self, code: int, text: str) -> None:
        execution, self._execution = self._execution, None
        if execution is not None:
            execution.done.set_result((code, text))
