"""Control loops around a simulated arm, one tick at a time; knows no ROS."""
from __future__ import annotations

import numpy as np

from gdmp_ros.control.controller import (
    ControllerSettings,
    HOLD_STIFFNESS,
    ImpedanceController,
    Tick,
)
from gdmp_ros.control.impedance import DAMPING_RATIO, POSE, STIFFNESS, TARGET_SIZE
from gdmp_ros.control.limits import LIMITS, LimitSettings, TorqueLimiter
from gdmp_ros.control.manipulability import (
    position_torque,
    PositionGains,
    PositionState,
    PositionTarget,
)
from gdmp_ros.control.guard import Origin
from gdmp_ros.sim.hand import Grip
from gdmp_ros.sim.arm import Arm


class ClosedLoop:
    """
    An arm and its impedance controller.

    :ivar led: whether the arm is weightless, to be led by hand, instead of following references
    :ivar hand: what pulls at the tool, if anything
    """

    def __init__(self, arm: Arm, settings: ControllerSettings | None = None):
        self.arm = arm
        self.controller = ImpedanceController(arm.limits, arm.friction, settings)
        self.led = False
        self.hand: Grip | None = None
        self.reset()

    def reset(self, position: np.ndarray | None = None) -> None:
        """Put the arm at rest at ``position`` [rad], at its first keyframe by default, holding."""
        self.hand = None
        self.arm.reset(position)
        self.arm.push(np.zeros(6))
        self.controller.reset(self.arm.measure())

    def follow(self, target: np.ndarray) -> bool:
        """Offer a reference (`gdmp_ros.control.impedance.TARGET_SIZE` numbers) to the guard."""
        guard = self.controller.guard
        return guard.offer(target.copy(), Origin(guard.settings.frame))

    def warm_up(self) -> None:
        """Do once what a tick may do, so that nothing is compiled in a real-time loop; reset."""
        self.tick()
        target = np.zeros(TARGET_SIZE)
        target[POSE:POSE + 7] = self.arm.measure().pose
        target[STIFFNESS:STIFFNESS + 36] = HOLD_STIFFNESS.reshape(-1)
        target[DAMPING_RATIO] = 0.7
        self.follow(target)
        self.tick()
        self.led = True
        self.tick()
        self.led = False
        self.reset()

    def tick(self) -> Tick:
        """Measure, compute the torque and let one period pass."""
        measured = self.arm.measure()
        if self.hand is not None:
            self.arm.push(self.hand.wrench(measured))
        act = self.controller.lead if self.led else self.controller.tick
        result = act(measured, self.arm.period)
        self.arm.step(result.torque)
        return result


class PositionLoop:
    """An arm that keeps a position, with its null space free for manipulability."""

    def __init__(self, arm: Arm, gains: PositionGains, torque_rate: float = 1.0):
        """:param torque_rate: largest change of a joint torque per tick [Nm]"""
        self.arm, self.gains = arm, gains
        self.limiter = TorqueLimiter(arm.limits, LimitSettings(torque_rate=torque_rate))
        self.limiter.reset(arm.measure().bias)
        self._excess = np.zeros(len(LIMITS))

    def tick(self, target: PositionTarget) -> PositionState:
        """Measure, compute the torque, limit it and let one period pass; the state before."""
        state = self.arm.linear_state(len(target.position))
        torque = position_torque(state, target, self.gains)
        self.arm.step(self.limiter.apply(self.arm.data.qpos, state.velocity, state.bias, torque,
                                         self._excess))
        return state

    def settle(self, target: PositionTarget, seconds: float) -> None:
        """Hold one target for a while."""
        for _ in range(round(seconds / self.arm.period)):
            self.tick(target)
