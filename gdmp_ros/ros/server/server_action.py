"""What the actions of a server have in common: one goal at a time, its end, a robot that lags."""
from __future__ import annotations

import math
from typing import Any, ClassVar, Protocol

from gdmp_msgs.msg import ArmStatus
from rclpy.task import Future

from gdmp_ros.control.modes import ArmMode
from gdmp_ros.errors import GdmpError
from gdmp_ros.playback.distance import Distance
from gdmp_ros.playback.streamer import Streamer
from gdmp_ros.ros.lifecycle import ManagedNode
from gdmp_ros.ros.server.report import ServerReport


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
        """Result of a goal that cannot be executed."""
        self._node.get_logger().warning(f'{self.name}: {error}')
        handle.abort()
        return self.kind.Result(error_code=self.kind.Result.INVALID_GOAL, error_string=str(error))

    @staticmethod
    def _end(handle: Any, result: Any) -> None:
        """Tell the client how a goal ended."""
        if result.error_code == result.SUCCESSFUL:
            handle.succeed()
        elif handle.is_cancel_requested:
            handle.canceled()
        else:
            handle.abort()

    def _finish(self, code: int, text: str) -> None:
        execution, self._execution = self._execution, None
        if execution is not None:
            execution.done.set_result((code, text))


def _why_not_followed(arm: ArmStatus | None) -> str:
    """
    Why the robot does not move.

    :param arm: what the arm said last; None if that is not known
    """
    if arm is None or arm.mode == ArmMode.UNKNOWN:
        return 'it is blocked, or does not follow'
    if arm.mode == ArmMode.FOLLOW:
        return 'it is blocked'
    said = arm.reason or arm.last_refusal
    return f'the arm does not follow{", " if said else ""}{said}'
