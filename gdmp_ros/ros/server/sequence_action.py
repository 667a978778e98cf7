"""The action ``~/execute_sequence``: a sequence file, with feedback; a newer goal replaces it."""
from __future__ import annotations

from typing import Any, NamedTuple

from gdmp_msgs.action import ExecuteSequence
from gdmp_msgs.msg import ServerState
from rclpy.task import Future
from std_msgs.msg import String

from gdmp_ros.data.sequences import read_sequence
from gdmp_ros.errors import GdmpError
from gdmp_ros.playback.distance import Distance
from gdmp_ros.playback.sequence_runner import OTHER_MOTION
from gdmp_ros.playback.streamer import Streamer
from gdmp_ros.ros.lifecycle import ManagedNode
from gdmp_ros.ros.server.report import ServerReport
from gdmp_ros.ros.server.server_action import ServerAction


class _Execution(NamedTuple):
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
        self._streamer.sequence.signal(message.data)

    async def _execute(self, handle: Any) -> ExecuteSequence.Result:
        result, request = ExecuteSequence.Result(), handle.request
        try:
            first = max(int(request.first_step), 1) - 1
            self._streamer.begin_sequence(read_sequence(request.sequence), first)
        except GdmpError as error:
            return self._refused(handle, error)
        self._finish(result.PREEMPTED, 'a newer goal was accepted')
        execution = self._execution = _Execution(handle, self._node.future())
        self._cancelling = False
        result.error_code, result.error_string = await execution.done
        status = self._streamer.sequence.status
        result.step = 0 if status is None else status.step
        self._end(handle, result)
        return result
