"""The action ``~/execute``: a skill to its goal, with feedback, pre-empted by a newer one."""
from __future__ import annotations

from typing import Any, TYPE_CHECKING

from gdmp_msgs.action import ExecuteSkill
from gdmp_msgs.msg import ServerState
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.task import Future

from gdmp_ros.errors import GdmpError, ParameterError

if TYPE_CHECKING:
    from gdmp_ros.ros.server.node import TrajectoryServer

#: Tolerances that apply where a goal names none [m, rad].
POSITION_TOLERANCE, ROTATION_TOLERANCE = 0.0005, 0.0025


class ExecuteAction:
    """
    Executes one goal at a time.

    The execute callback is asynchronous: it awaits a future that `watch` completes, so goals,
    cancellation and parameters are served meanwhile.
    """

    def __init__(self, server: TrajectoryServer):
        self._server = server
        self._done: Future | None = None
        self._handle: Any = None
        self._cancelling = False
        self._action = ActionServer(server, ExecuteSkill, '~/execute', self._execute,
                                    goal_callback=self._on_goal,
                                    cancel_callback=lambda _: CancelResponse.ACCEPT)

    def destroy(self) -> None:
        """Take the action down."""
        self._action.destroy()

    def deactivated(self) -> None:
        """End the goal under way: the node no longer streams."""
        self._finish(ExecuteSkill.Result.DEACTIVATED, 'the node was deactivated')

    def _on_goal(self, goal: ExecuteSkill.Goal) -> GoalResponse:
        if self._server.active:
            return GoalResponse.ACCEPT
        self._server.get_logger().warning('execute: rejected, the node is not active')
        return GoalResponse.REJECT

    async def _execute(self, handle: Any) -> ExecuteSkill.Result:
        result = ExecuteSkill.Result()
        self._finish(ExecuteSkill.Result.PREEMPTED, 'a newer goal took over')
        try:
            self._begin(handle.request)
        except GdmpError as error:
            self._server.get_logger().warning(f'execute: {error}')
            handle.abort()
            result.error_code, result.error_string = result.INVALID_GOAL, str(error)
            return result
        done: Future = Future(executor=self._server.executor)
        self._done, self._handle, self._cancelling = done, handle, False
        result.error_code, result.error_string = await done
        state = self._server.state()
        result.factors, result.distance_to_goal = state.factors, state.distance_to_goal
        if result.error_code == result.SUCCESSFUL:
            handle.succeed()
        elif result.error_code == result.CANCELED:
            handle.canceled()
        else:
            handle.abort()
        return result

    def _begin(self, goal: ExecuteSkill.Goal) -> None:
        server = self._server
        for name in ('duration', 'position_tolerance', 'rotation_tolerance'):
            value = getattr(goal, name)
            if not value >= 0.0:
                raise ParameterError(f'{name} is {value!r}, expected a number >= 0')
        pose = server.checked_goal_pose(goal.goal_pose) if goal.use_goal_pose else None
        if goal.skill:
            server.load_skill(goal.skill)
        server.begin(pose, goal.goal_stiffness, goal.duration or None,
                     (goal.position_tolerance or POSITION_TOLERANCE,
                      goal.rotation_tolerance or ROTATION_TOLERANCE))

    def _finish(self, code: int, text: str) -> None:
        done, self._done = self._done, None
        if done is not None:
            done.set_result((code, text))

    def watch(self, state: ServerState) -> None:
        """Give feedback on the goal under way, and end it when it is over."""
        if self._done is None:
            return
        player = self._server.player
        rollout = None if player is None else player.rollout
        if self._handle.is_cancel_requested and not self._cancelling and player is not None:
            self._cancelling = True
            player.stop()
        if self._cancelling and player is not None and player.status == 'holding':
            self._finish(ExecuteSkill.Result.CANCELED, 'stopped on request')
            return
        if player is not None and rollout is None and player.status == 'holding':
            self._finish(ExecuteSkill.Result.CANCELED, 'stopped by service')
            return
        self._handle.publish_feedback(ExecuteSkill.Feedback(
            phase=state.phase, progress=state.progress, factors=state.factors,
            distance_to_goal=state.distance_to_goal))
        if 'held' in state.flags:
            self._finish(ExecuteSkill.Result.HELD, 'a step was not finite; the last state is held')
        elif player is not None and player.status == 'holding' and state.finished:
            settled = 'not_settled' not in state.flags
            self._finish(*((ExecuteSkill.Result.SUCCESSFUL, '') if settled else
                           (ExecuteSkill.Result.GOAL_TOLERANCE_VIOLATED,
                            'the goal was not reached within its tolerance in time')))
