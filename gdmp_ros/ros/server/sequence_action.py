"""The action ``~/execute_sequence``: a sequence file, with feedback; a newer goal replaces it."""
from __future__ import annotations

from typing import Any, NamedTuple

from gdmp_msgs.action import ExecuteSequence
from gdmp_msgs.msg import ServerState
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.task import Future
from std_msgs.msg import String

from gdmp_ros.data.sequences import read_sequence
from gdmp_ros.errors import GdmpError
from gdmp_ros.playback.sequence_runner import OTHER_MOTION
from gdmp_ros.playback.streamer import Streamer
from gdmp_ros.ros.lifecycle import ManagedNode
from gdmp_ros.ros.server.execute_action import why_not_followed
from gdmp_ros.ros.server.report import ServerReport


class _Execution(NamedTuple):
    handle: Any
    done: Future


class SequenceAction:
    """Executes one sequence at a time; the topic ``~/signal`` ends steps that wait for it."""

    def __init__(self, node: ManagedNode, streamer: Streamer, report: ServerReport):
        self._node, self._streamer, self._report = node, streamer, report
        self._execution: _Execution | None = None
        self._cancelling = False
        node.add_subscription(String, '~/signal', self._on_signal, 10)
        self._action = ActionServer(node, ExecuteSequence, '~/execute_sequence', self._execute,
                                    goal_callback=self._on_goal,
                                    cancel_callback=lambda _: CancelResponse.ACCEPT)

    def destroy(self) -> None:
        """Destroy the action server."""
        self._action.destroy()

    def deactivated(self) -> None:
        """End the present goal: the node does not stream any more."""
        self._finish(ExecuteSequence.Result.DEACTIVATED, 'the node was deactivated')

    def watch(self, state: ServerState, motion: int) -> None:
        """
        Give feedback on the present goal, and end it when its sequence has ended.

        :param motion: number of the motion that ``state`` is about
        """
        execution, status = self._execution, self._streamer.sequence.status
        if execution is None or status is None:
            return
        result = ExecuteSequence.Result
        if execution.handle.is_cancel_requested and not self._cancelling:
            self._cancelling = True
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
        robot, result = self._streamer.robot, ExecuteSequence.Result
        problem, code = '', result.SUCCESSFUL
        if 'held' in state.flags:
            problem, code = 'a step was not finite; the last state is held', result.HELD
        elif 'not_settled' in state.flags:
            problem = 'the goal was not reached within its tolerance in time'
            code = result.GOAL_TOLERANCE_VIOLATED
        elif 'blocked' in robot.flags:
            problem = (f'the robot is {robot.lag} from the reference and does not move: '
                       f'{why_not_followed(self._report.arm)}')
            code = result.BLOCKED
        elif not robot.largest_lag.within(robot.settings.path_position_tolerance or float('inf'),
                                          robot.settings.path_rotation_tolerance
                                          or float('inf')):
            problem = f'the robot was {robot.largest_lag} from the reference'
            code = result.PATH_TOLERANCE_VIOLATED
        if problem:
            self._streamer.stop_motion()
            self._finish(code, problem)

    def _on_signal(self, message: String) -> None:
        self._streamer.sequence.signal(message.data)

    def _on_goal(self, goal: ExecuteSequence.Goal) -> GoalResponse:
        if self._streamer.active:
            return GoalResponse.ACCEPT
        self._node.get_logger().warning('execute_sequence: rejected, the node is not active')
        return GoalResponse.REJECT

    async def _execute(self, handle: Any) -> ExecuteSequence.Result:
        result, request = ExecuteSequence.Result(), handle.request
        try:
            first = max(int(request.first_step), 1) - 1
            self._streamer.begin_sequence(read_sequence(request.sequence), first)
        except GdmpError as error:
            self._node.get_logger().warning(f'execute_sequence: {error}')
            handle.abort()
            result.error_code, result.error_string = result.INVALID_GOAL, str(error)
            return result
        self._finish(result.PREEMPTED, 'a newer goal was accepted')
        execution = self._execution = _Execution(handle, self._node.future())
        self._cancelling = False
        result.error_code, result.error_string = await execution.done
        status = self._streamer.sequence.status
        result.step = 0 if status is None else status.step
        if result.error_code == result.SUCCESSFUL:
            handle.succeed()
        elif handle.is_cancel_requested:
            handle.canceled()
        else:
            handle.abort()
        return result

    def _finish(self, code: int, text: str) -> None:
        execution, self._execution = self._execution, None
        if execution is not None:
            execution.done.set_result((code, text))
