"""Topics and action of a gripper, whatever it is: ``gripper/command``, ``/state``, ``/move``."""
from __future__ import annotations

from typing import Any

from gdmp_msgs.action import MoveGripper
from gdmp_msgs.msg import GripperCommand as CommandMessage
from gdmp_msgs.msg import GripperState as StateMessage

from gdmp_ros.control.gripper import DEFAULT_SPEED, Gripper, GripperCommand, GripperState
from gdmp_ros.errors import GdmpError
from gdmp_ros.realtime.loop import NS
from gdmp_ros.ros.lifecycle import ManagedNode

COMMAND, STATE, MOVE = 'gripper/command', 'gripper/state', 'gripper/move'
#: Longest time for a command [s].
LONGEST_S = 20.0
#: Time between two looks at the gripper while a command is carried out [s].
LOOK_S = 0.05


def command_of(message: Any) -> GripperCommand:
    """Command of a message or of the goal of an action."""
    return GripperCommand(message.width, message.force, message.speed or DEFAULT_SPEED)


def command_message(command: GripperCommand) -> CommandMessage:
    """Message of a command."""
    return CommandMessage(width=command.width, force=command.force, speed=command.speed)


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
        result, command = MoveGripper.Result(), command_of(handle.request)
        try:
            number = self._gripper.command(command)
        except GdmpError as error:
            handle.abort()
            result.message = str(error)
            return result
        clock = self._node.clock
        ends = clock.now() / NS + LONGEST_S

        def done() -> bool:
            state = self._gripper.state
            handle.publish_feedback(MoveGripper.Feedback(width=state.width))
            return state.commands > number or (state.commands == number and not state.moving)
        await self._node.wait_until(done, LOOK_S, LONGEST_S)
        state = self._gripper.state
        result.width, result.holding = state.width, state.holding
        if state.commands > number:
            result.message = 'a newer command replaced it'
        elif state.moving or clock.now() / NS > ends:
            result.message = f'not done within {LONGEST_S:g} s'
        elif command.force and not state.holding:
            result.message = state.problem or 'there is nothing between the fingers'
        else:
            result.message = state.problem
        result.success = not result.message
        if result.success:
            handle.succeed()
        else:
            handle.abort()
        return result
