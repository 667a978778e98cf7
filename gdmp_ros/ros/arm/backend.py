"""What the node of an arm needs of a kind of arm: one that is simulated, or a robot."""
from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, TYPE_CHECKING

from gdmp_ros.control.arm_driver import ArmDriver
from gdmp_ros.realtime.loop import Loop
from gdmp_ros.ros.parameters import Spec
from gdmp_ros.scene.scene import Scene
from gdmp_ros.sim.arm import Arm

if TYPE_CHECKING:
    from gdmp_ros.ros.arm.node import ArmNode


class ArmBackend:
    """
    One kind of arm.

    :cvar name: of its node
    :cvar specs: parameters of its node
    :cvar guiding: what to do after hand guiding has begun
    :cvar described: whether a driver of its own publishes the states of its joints, its
        description and its links
    :ivar node: of the arm
    :ivar model: of the arm, with its tool; known after `open`
    :ivar period: of its ticks [s]; known after `open`
    """

    name: ClassVar[str]
    specs: ClassVar[Sequence[Spec]]
    guiding: ClassVar[str] = 'only gravity is compensated: guide the arm by hand'
    described: ClassVar[bool] = False
    node: ArmNode
    model: Arm
    period: float

    def open(self) -> ArmDriver:
        """
        Connect to the arm; it does not move.

        :raises GdmpError: if there is none
        """
        raise NotImplementedError

    def offer(self) -> None:
        """Add what only this kind of arm offers: topics, services."""

    def surround(self, scene: Scene) -> None:
        """Know what is around the arm from now on."""

    def begin(self) -> None:
        """Prepare for `cycles`; the arm is not controlled yet."""

    def cycles(self) -> Loop:
        """Control the arm that has begun, and publish its states."""
        raise NotImplementedError

    def beside(self) -> list[Loop]:
        """Loops that run beside `cycles`."""
        return []

    def end(self) -> None:
        """The arm is not controlled any more."""

    def close(self) -> None:
        """Disconnect."""

    def priority(self) -> int:
        """Of the thread of `cycles`; see `gdmp_ros.realtime.loop.Clock.start`."""
        return int(self.node.parameters.realtime_priority)

    def ticks(self) -> bool:
        """Whether time passes for the arm."""
        return True

    def speed(self) -> float:
        """Share of its speed at which the arm executes commands, 0 … 1."""
        return 1.0

    def activity(self) -> str:
        """What it does, if its state does not say it; problems are logged."""
        return ''

    def diagnosed(self) -> dict[str, Any]:
        """More entries of the diagnostics."""
        return {}
