"""The hand of a Franka: topics and action of a gripper."""
from __future__ import annotations

from collections.abc import Callable
from typing import Any

from gdmp_ros.errors import ParameterError
from gdmp_ros.franka.gripper import FrankaGripper, opened
from gdmp_ros.ros.arm.parameters import GRIPPER
from gdmp_ros.ros.gripper import GripperInterface
from gdmp_ros.ros.lifecycle import ManagedNode
from gdmp_ros.ros.parameters import Parameters
from gdmp_ros.ros.running import run


class FrankaGripperNode(ManagedNode):
    """The managed node ``franka_gripper``; a process of its own (`gdmp_ros.franka.gripper`)."""

    _gripper: FrankaGripper | None = None

    def __init__(self, opened: Callable[[str], Any] = opened) -> None:
        """:param opened: connects to a hand"""
        super().__init__('franka_gripper')
        self._opened = opened
        self.parameters = Parameters(self, GRIPPER)

    def configure(self) -> None:
        if not self.parameters.host:
            raise ParameterError('host is empty, expected the address of the robot')
        self._gripper = FrankaGripper(self.parameters.host, self.parameters.homing, self.clock,
                                      self._opened)
        GripperInterface(self, self._gripper)
        self.parameters.locked = True

    def cleanup(self) -> None:
        super().cleanup()
        if self._gripper is not None:
            self._gripper.close()
            self._gripper = None


def main(arguments: list[str] | None = None) -> int:
    """Run the node ``franka_gripper``."""
    return run([FrankaGripperNode], arguments)


if __name__ == '__main__':
    raise SystemExit(main())
