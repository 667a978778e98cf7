"""Control loops around a simulated arm, one tick at a time. No ROS."""
from __future__ import annotations

import numpy as np

from gdmp_ros.control.arm_control import ArmControl
from gdmp_ros.control.limits import LIMITS
from gdmp_ros.control.manipulability import (
    position_torque,
    PositionGains,
    PositionState,
    PositionTarget,
)
from gdmp_ros.control.settings import ControllerSettings, LimitSettings
from gdmp_ros.control.tick import Tick
from gdmp_ros.control.torque_limits import TorqueLimiter
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.frames import ToolTransform
from gdmp_ros.sim.gripper import SimulatedGripper
from gdmp_ros.sim.payload import Payload
from gdmp_ros.sim.teaching import Hand


class ClosedLoop(ArmControl):
    """
    A simulated arm and its impedance controller.

    :ivar hand: the hand that pulls the tool, if any
    :ivar gripper: of the arm, if it has one
    """

    def __init__(self, arm: Arm, settings: ControllerSettings | None = None,
                 gripper: SimulatedGripper | None = None):
        super().__init__(arm.limits, arm.friction, settings)
        self.arm, self.gripper = arm, gripper
        self.hand: Hand | None = None
        self.reset()

    def reset(self, position: np.ndarray | None = None, same_stream: bool = False) -> None:
        """
        Hold the arm at rest at ``position`` [rad], by default at its first keyframe.

        :param same_stream: whether the stream that was followed may go on: then it is not followed
            from its middle; otherwise the next reference is taken for the first of a stream
        """
        self.hand = None
        self.arm.reset(position)
        if self.gripper is not None:
            self.gripper.reset()
        self.arm.push(np.zeros(6))
        self.hold(self.arm.measure())
        if not same_stream:
            self.controller.guard.forget_stream()

    def rest(self) -> None:
        """Hold the arm where it is, without velocity: as if its brakes had held it."""
        self.arm.rest()
        self.hold(self.arm.measure())

    @property
    def others(self) -> np.ndarray:
        """Positions of what is not a joint of the arm: fingers, objects; empty without them."""
        return np.array(self.arm.data.qpos[len(self.joints.torque):])

    def use_tool(self, tool: ToolTransform) -> None:
        before = self.arm.measure().pose.copy()
        self.arm.put_tool(tool)
        self.controller.move_tool(before, self.arm.measure().pose.copy())

    def carry(self, payload: Payload) -> None:
        """Carry something from now on: the model changes smoothly, in any state."""
        self.arm.announce(payload)

    def tick(self) -> Tick:
        """Measure, compute the torque and advance by one period."""
        result = self.act()
        self.arm.advance()
        return result

    def act(self) -> Tick:
        """Measure, and let the torque act; the simulation does not advance yet."""
        measured = self.arm.measure()
        if self.hand is not None:
            self.arm.push(self.hand.wrench(measured))
        result = self.compute(measured, self.arm.period)
        if self.gripper is not None:
            self.gripper.advance(self.arm.period)
        self.arm.act(result.torque)
        return result


class PositionLoop:
    """An arm under position control, with its null space free for manipulability."""

    def __init__(self, arm: Arm, gains: PositionGains, torque_slew: float = 950.0):
        """:param torque_slew: largest rate of change of a joint torque [Nm/s]"""
        self.arm, self.gains = arm, gains
        self.limiter = TorqueLimiter(arm.limits, LimitSettings(torque_slew=torque_slew))
        self.limiter.reset(arm.measure().bias)
        self._violation = np.zeros(len(LIMITS))

    def tick(self, target: PositionTarget) -> PositionState:
        """Measure, compute and limit the torque, advance; returns the state before."""
        state = self.arm.linear_state(len(target.position))
        torque = position_torque(state, target, self.gains)
        self.arm.step(self.limiter.apply(self.arm.data.qpos, state.velocity, state.bias, torque,
                                         self.arm.period, self._violation))
        return state

    def settle(self, target: PositionTarget, seconds: float) -> None:
        """Hold a target for a time."""
        for _ in range(round(seconds / self.arm.period)):
            self.tick(target)
