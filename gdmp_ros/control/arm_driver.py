"""What the control of an arm needs of it, simulated or real: measure, command, recover."""
from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from gdmp_ros.control.arm_states import State
from gdmp_ros.control.kinematics import Chain
from gdmp_ros.control.measurement import JointLimits, Measurement
from gdmp_ros.control.own_body import Body
from gdmp_ros.errors import GdmpError


class ArmStopped(GdmpError):
    """
    An arm has ended its control by itself: a reflex, the user stop, or the network.

    :ivar connected: whether it still answers
    """

    def __init__(self, message: str, connected: bool):
        super().__init__(message)
        self.connected = connected


class ArmDriver(Protocol):
    """
    One arm; only one thread at a time uses it. All methods but `check_payload` may raise
    `ArmStopped`.
    """

    @property
    def joints(self) -> JointLimits:
        """Limits of the joints."""

    @property
    def friction(self) -> np.ndarray:
        """Viscous friction of each joint, as the model knows it [Nm s/rad]."""

    @property
    def chain(self) -> Chain:
        """The joints between the base and the tool."""

    @property
    def body(self) -> Body:
        """Shape of the arm."""

    @property
    def end_pose(self) -> np.ndarray:
        """Where the tool is in the frame of the last joint (x, y, z, qw, qx, qy, qz)."""

    @property
    def dt(self) -> float:
        """Time for which the next torque acts [s]."""

    @property
    def taken(self) -> np.ndarray | None:
        """
        Lowest and highest torque with which the arm may compare the next [Nm], shape ``(2, n)``.

        None if it takes every command, so that this is the last one.
        """

    @property
    def controlled(self) -> bool:
        """Whether torques act; otherwise something else holds the arm."""

    def begin(self) -> Measurement:
        """Let torques act from now on; the arm is at rest."""

    def measure(self) -> Measurement | None:
        """Wait for the next state; None while the arm does not answer."""

    def command(self, torque: np.ndarray) -> None:
        """Send joint torques for the state that was measured last [Nm]."""

    def end(self) -> None:
        """Let no torque act any more; the arm holds its position by itself."""

    def recover(self) -> Measurement:
        """End a fault, and `begin` again."""

    def reset(self) -> Measurement:
        """
        Put the arm to rest at its home posture, and its world to its beginning.

        :raises ParameterError: if it is not simulated
        """

    def use_tool(self, tool: Any) -> tuple[np.ndarray, np.ndarray]:
        """
        Measure another point of the tool's body from now on.

        :param tool: a `gdmp_ros.sim.frames.ToolTransform`
        :returns: poses of the last tool and of the new one (x, y, z, qw, qx, qy, qz)
        """

    def check_payload(self, state: State) -> None:
        """:raises ParameterError: if what the arm carries cannot change in a state"""

    def carry(self, payload: Any) -> Measurement | None:
        """
        Carry something from now on.

        :param payload: a `gdmp_ros.sim.payload.Payload`
        :returns: state of an arm whose control has ended for it, and begins again; else None
        """
