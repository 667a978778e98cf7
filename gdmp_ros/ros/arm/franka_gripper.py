"""The hand of a Franka: topics and action of a gripper."""
from __future__ import annotations

from gdmp_ros.errors import ParameterError
from gdmp_ros.franka.gripper import FrankaGripper
from gdmp_ros.ros.arm.parameters import GRIPPER
from gdmp_ros.ros.gripper import GripperInterface
from gdmp_ros.ros.lifecycle import ManagedNode
from gdmp_ros.ros.parameters import Parameters
from gdmp_ros.ros.running import run


class FrankaGripperNode(ManagedNode):
    """The managed node ``franka_gripper``; a process of its own (`gdmp_ros.franka.gripper`)."""

    _gripper: FrankaGripper | None = None
    _interface: GripperInterface | None = None

    def __init__(self) -> None:
        super().__init__('franka_gripper')
        self.parameters = Parameters(self, GRIPPER)

    def configure(self) -> None:
        if not self.parameters.host:
            raise ParameterError('host is empty, expected the address of the robot')
        self._gripper = FrankaGripper(self.parameters.host, self.parameters.homing)
        self._interface = GripperInterface(self, self._gripper)
        self.parameters.locked = True

    def cleanup(self) -> None:
        self.release()
        if self._interface is not None:
            self._interface.destroy()
            self._interface = None
        if self._gripper is not None:
            self._gripper.close()
            self._gripper = None
        self.parameters.locked = False


def main(arguments: list[str] | None = None) -> int:
    """Run the node ``franka_gripper``."""
    return run([FrankaGripperNode], arguments)


if __name__ == '__main__':
    raise SystemExit(main())
