"""Control loops around a simulated arm, one tick at a time. No ROS."""
from __future__ import annotations

import numpy as np

from gdmp_ros.control.controller import ImpedanceController
from gdmp_ros.control.identification import FrictionIdentification
from gdmp_ros.control.limits import LIMITS
from gdmp_ros.control.manipulability import (
    position_torque,
    PositionGains,
    PositionState,
    PositionTarget,
)
from gdmp_ros.control.modes import StreamMode
from gdmp_ros.control.reference_check import Origin
from gdmp_ros.control.settings import ControllerSettings, LimitSettings
from gdmp_ros.control.target import resting_target, whole_target
from gdmp_ros.control.tick import Tick
from gdmp_ros.control.torque_limits import TorqueLimiter
from gdmp_ros.errors import ParameterError
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.hand import Hand
from gdmp_ros.sim.tool import ToolTransform


class ClosedLoop:
    """
    An arm and its impedance controller.

    :ivar hand_guided: whether the arm only compensates gravity, to be guided by hand
    :ivar hand: the hand that pulls the tool, if any
    :ivar identification: motions that show the friction of the joints, while they are made
    """

    def __init__(self, arm: Arm, settings: ControllerSettings | None = None):
        self.arm = arm
        self.controller = ImpedanceController(arm.limits, arm.friction, settings)
        self.hand_guided = False
        self.hand: Hand | None = None
        self.identification: FrictionIdentification | None = None
        self.reset()

    def reset(self, position: np.ndarray | None = None) -> None:
        """Hold the arm at rest at ``position`` [rad], by default at its first keyframe."""
        self.hand = self.identification = None
        self.arm.reset(position)
        self.arm.push(np.zeros(6))
        self.controller.reset(self.arm.measure())

    def follow(self, target: np.ndarray) -> bool:
        """
        Offer a reference of a motion to the guard; whether it is followed.

        :param target: `gdmp_ros.control.target.TARGET_SIZE` numbers, or ``REQUIRED_SIZE``
        """
        guard = self.controller.guard
        return guard.offer(whole_target(target), Origin(guard.settings.frame))

    def warm_up(self) -> None:
        """Run each kind of tick once, so that no kernel is compiled in a real-time loop; reset."""
        self.tick()
        guard, target = self.controller.guard, resting_target(self.arm.measure().pose)
        self.follow(target)
        self.tick()
        # Otherwise a stream that begins soon would be taken for the one of this tick.
        guard.offer(target, Origin(guard.settings.frame, mode=StreamMode.ENDED))
        self.tick()
        self.hand_guided = True
        self.tick()
        self.hand_guided = False
        self.identify_friction()
        self.tick()
        self.reset()

    def identify_friction(self) -> None:
        """Begin the motions that show the friction of the joints, from the present posture."""
        self.identification = FrictionIdentification(self.arm.limits, self.arm.measure().position)

    def put_tool(self, tool: ToolTransform) -> None:
        """
        Control another point of the tool's body; the arm goes on holding with the same wrench.

        :raises ParameterError: while references are followed
        """
        self.check_tool()
        before = self.arm.measure().pose.copy()
        self.arm.put_tool(tool)
        self.controller.move_tool(before, self.arm.measure().pose.copy())

    def check_tool(self) -> None:
        """:raises ParameterError: while the tool cannot change"""
        if self.controller.guard.following:
            raise ParameterError('the arm follows references: stop their publisher, or call '
                                 '~/stop, first')

    def tick(self) -> Tick:
        """Measure, compute the torque and advance by one period."""
        measured = self.arm.measure()
        if self.hand is not None:
            self.arm.push(self.hand.wrench(measured))
        period, identification = self.arm.period, self.identification
        if identification is not None and not identification.done:
            result = self.controller.move_joints(measured, *identification.target(), period)
            identification.add(measured, result.torque, period)
        elif self.hand_guided:
            result = self.controller.hand_guide(measured, period)
        else:
            result = self.controller.tick(measured, period)
        self.arm.step(result.torque)
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
