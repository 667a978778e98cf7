"""Control loops around a simulated arm, one tick at a time. No ROS."""
from __future__ import annotations

import numpy as np

from gdmp_ros.control.controller import ImpedanceController, Tick
from gdmp_ros.control.guard import Origin
from gdmp_ros.control.limits import LIMITS
from gdmp_ros.control.manipulability import (
    position_torque,
    PositionGains,
    PositionState,
    PositionTarget,
)
from gdmp_ros.control.settings import ControllerSettings, LimitSettings
from gdmp_ros.control.target import resting_target
from gdmp_ros.control.torque_limits import TorqueLimiter
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.hand import Hand


class ClosedLoop:
    """
    An arm and its impedance controller.

    :ivar hand_guided: whether the arm only compensates gravity, to be guided by hand
    :ivar hand: the hand that pulls the tool, if any
    """

    def __init__(self, arm: Arm, settings: ControllerSettings | None = None):
        self.arm = arm
        self.controller = ImpedanceController(arm.limits, arm.friction, settings)
        self.hand_guided = False
        self.hand: Hand | None = None
        self.reset()

    def reset(self, position: np.ndarray | None = None) -> None:
        """Hold the arm at rest at ``position`` [rad], by default at its first keyframe."""
        self.hand = None
        self.arm.reset(position)
        self.arm.push(np.zeros(6))
        self.controller.reset(self.arm.measure())

    def follow(self, target: np.ndarray) -> bool:
        """Offer a reference (`gdmp_ros.control.target.TARGET_SIZE` numbers) to the guard."""
        guard = self.controller.guard
        return guard.offer(target.copy(), Origin(guard.settings.frame))

    def warm_up(self) -> None:
        """Run each kind of tick once, so that no kernel is compiled in a real-time loop; reset."""
        self.tick()
        self.follow(resting_target(self.arm.measure().pose))
        self.tick()
        self.hand_guided = True
        self.tick()
        self.hand_guided = False
        self.reset()

    def tick(self) -> Tick:
        """Measure, compute the torque and advance by one period."""
        measured = self.arm.measure()
        if self.hand is not None:
            self.arm.push(self.hand.wrench(measured))
        compute = self.controller.hand_guide if self.hand_guided else self.controller.tick
        result = compute(measured, self.arm.period)
        self.arm.step(result.torque)
        return result


class PositionLoop:
    """An arm under position control, with its null space free for manipulability."""

    def __init__(self, arm: Arm, gains: PositionGains, torque_rate: float = 1.0):
        """:param torque_rate: largest change of a joint torque per tick [Nm]"""
        self.arm, self.gains = arm, gains
        self.limiter = TorqueLimiter(arm.limits, LimitSettings(torque_rate=torque_rate))
        self.limiter.reset(arm.measure().bias)
        self._violation = np.zeros(len(LIMITS))

    def tick(self, target: PositionTarget) -> PositionState:
        """Measure, compute and limit the torque, advance; returns the state before."""
        state = self.arm.linear_state(len(target.position))
        torque = position_torque(state, target, self.gains)
        self.arm.step(self.limiter.apply(self.arm.data.qpos, state.velocity, state.bias, torque,
                                         self._violation))
        return state

    def settle(self, target: PositionTarget, seconds: float) -> None:
        """Hold a target for a time."""
        for _ in range(round(seconds / self.arm.period)):
            self.tick(target)
