"""
Topics and actions of a gripper, whatever it is: ``gripper/command``, ``/state``, ``/move``.

Where control_msgs is installed, also the action of parallel grippers: ``gripper/gripper_cmd``.
"""
from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
import importlib
from typing import Any

from gdmp_msgs.action import MoveGripper
from gdmp_msgs.msg import GripperCommand as CommandMessage
from gdmp_msgs.msg import GripperState as StateMessage
from sensor_msgs.msg import JointState

from gdmp_ros.control.gripper import DEFAULT_SPEED, Gripper, GripperCommand, GripperState
from gdmp_ros.errors import GdmpError, ParameterError
from gdmp_ros.realtime.loop import NS
from gdmp_ros.ros.lifecycle import ManagedNode
from gdmp_ros.ros.middleware import end_goal

_control_msgs: Any = None
with suppress(ImportError):
    _control_msgs = importlib.import_module('control_msgs.action')

COMMAND, STATE, MOVE = 'gripper/command', 'gripper/state', 'gripper/move'
PARALLEL = 'gripper/gripper_cmd'
#: A width that is nearer than this is reached [m].
REACHED_M = 0.002
#: Longest time for a command [s].
LONGEST_S = 20.0
#: Time between two looks at the gripper while a command is carried out [s].
LOOK_S = 0.05


def command_of(message: Any) -> GripperCommand:
    """Command of a message or of the goal of an action."""
    return GripperCommand(message.width, message.force, message.speed or DEFAULT_SPEED)


def command_message(command: GripperCommand, stamp: Any) -> CommandMessage:
    """Message of a command."""
    message = CommandMessage(width=command.width, force=command.force, speed=command.speed)
    message.header.stamp = stamp
    return message


def state_of(message: StateMessage) -> GripperState:
    """State of a message."""
    return GripperState(message.width, message.widest, message.moving, message.holding,
                        message.commands, message.problem)


class GripperInterface:
    """Lets other nodes use a gripper."""

    def __init__(self, node: ManagedNode, gripper: Gripper):
        self._node, self._gripper = node, gripper
        self._state_out = node.add_publisher(StateMessage, STATE, 10)
        node.add_subscription(CommandMessage, COMMAND, self._on_command, 10)
        node.add_report(self._report)
        node.add_action(MoveGripper, MOVE, self._execute, accept=lambda _: True, cancel=False)
        if _control_msgs is not None:
            node.add_action(_control_msgs.ParallelGripperCommand, PARALLEL,
                            self._execute_parallel, accept=lambda _: True, cancel=False)

    def _on_command(self, message: CommandMessage) -> None:
        try:
            self._gripper.command(command_of(message))
        except GdmpError as error:
            self._node.get_logger().warning(f'{COMMAND} refused: {error}',
                                            throttle_duration_sec=1.0)

    def _report(self) -> None:
        state = self._gripper.state
        message = StateMessage(width=state.width, widest=state.widest, moving=state.moving,
                               holding=state.holding, commands=state.commands,
                               problem=state.problem)
        message.header.stamp = self._node.stamp()
        self._state_out.publish(message)

    async def _execute(self, handle: Any) -> MoveGripper.Result:
        result = MoveGripper.Result()
        try:
            state = await self._carried_out(
                command_of(handle.request), lambda state: handle.publish_feedback(
                    MoveGripper.Feedback(width=state.width)))
            result.message = state.problem
            result.width, result.holding = state.width, state.holding
        except GdmpError as error:
            result.message = str(error)
        result.success = not result.message
        end_goal(handle, result.success)
        return result

    async def _execute_parallel(self, handle: Any) -> Any:
        """Execute a command for the joints of the fingers, which move alike."""
        kind, given = _control_msgs.ParallelGripperCommand, handle.request.command
        result, problem = kind.Result(), ''

        def described(state: GripperState) -> JointState:
            message = JointState(name=given.name, position=[0.5 * state.width] * len(given.name))
            message.header.stamp = self._node.stamp()
            return message
        try:
            command = parallel_command(given, self._gripper.state.width)
            state = await self._carried_out(command, lambda state: handle.publish_feedback(
                kind.Feedback(state=described(state))))
            result.stalled = state.holding
            result.reached_goal = abs(state.width - command.width) < REACHED_M
            if not (result.stalled or result.reached_goal):
                problem = state.problem
        except GdmpError as error:
            state, problem = self._gripper.state, str(error)
        if problem:
            self._node.get_logger().warning(f'{PARALLEL}: {problem}')
        result.state = described(state)
        end_goal(handle, not problem)
        return result

    async def _carried_out(self, command: GripperCommand,
                           feedback: Callable[[GripperState], None]) -> GripperState:
        """
        Carry out a command.

        :returns: the state after it; its ``problem`` says why it has not succeeded
        :raises ParameterError: if it is refused
        """
        number, clock = self._gripper.command(command), self._node.clock
        ends = clock.now() / NS + LONGEST_S

        def done() -> bool:
            state = self._gripper.state
            feedback(state)
            return state.commands > number or (state.commands == number and not state.moving)
        await self._node.wait_until(done, LOOK_S, LONGEST_S)
        state = self._gripper.state
        if state.commands > number:
            return state._replace(problem='a newer command replaced it')
        if state.moving or clock.now() / NS > ends:
            return state._replace(problem=f'not done within {LONGEST_S:g} s')
        if command.force and not state.holding:
            return state._replace(problem=state.problem or 'there is nothing between the fingers')
        return state


def parallel_command(joints: JointState, width: float) -> GripperCommand:
    """
    Command of a parallel gripper.

    :param joints: positions of one finger or both [m]; largest speed [m/s] and force [N] of a
        finger, if given: fingers that close with a force hold what is between them
    :param width: present one [m]
    :raises ParameterError: unless there are numbers for one or two fingers
    """
    fingers = len(joints.name)
    if fingers not in (1, 2) or len(joints.position) != fingers:
        raise ParameterError(f'{fingers} joint names and {len(joints.position)} positions, '
                             'expected those of one finger or two')
    for name, numbers in (('velocities', joints.velocity), ('efforts', joints.effort)):
        if len(numbers) not in (0, fingers):
            raise ParameterError(f'{len(numbers)} {name}, expected {fingers} or none')
    wanted = sum(joints.position) * 2.0 / fingers
    return GripperCommand(wanted, max(joints.effort, default=0.0) if wanted < width else 0.0,
                          2.0 * min(joints.velocity, default=0.0) or DEFAULT_SPEED)
