"""The gripper of the robot, by its topics."""
from __future__ import annotations

from gdmp_msgs.msg import GripperCommand as CommandMessage
from gdmp_msgs.msg import GripperState as StateMessage

from gdmp_ros.control.gripper import GripperCommand, GripperState
from gdmp_ros.realtime.loop import NS
from gdmp_ros.ros.gripper import command_message, state_of
from gdmp_ros.ros.lifecycle import ManagedNode

#: Oldest state that counts [s].
STATE_S = 1.0


class GripperTopics:
    """Sends commands, and knows the newest state."""

    def __init__(self, node: ManagedNode, prefix: str):
        """:param prefix: of the topics"""
        self._node = node
        self._commands = node.add_publisher(CommandMessage, f'{prefix}/command', 10)
        # Polled: read while a skill with commands is played.
        self._states = node.add_subscription(StateMessage, f'{prefix}/state', None)
        self._state: tuple[GripperState, int] | None = None

    def send(self, command: GripperCommand) -> None:
        """Let the gripper begin a command."""
        message = command_message(command)
        message.header.stamp = self._node.stamp()
        self._commands.publish(message)

    def state(self) -> GripperState | None:
        """The newest state; None if nothing is known of the gripper."""
        message, now = self._states.newest_message(), self._node.clock.now()
        if message is not None:
            self._state = state_of(message), now
        if self._state is None or now - self._state[1] > STATE_S * NS:
            return None
        return self._state[0]
