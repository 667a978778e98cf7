"""The impedance loop around a simulated arm, one tick at a time; knows no ROS."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gdmp_ros.control.impedance import (
    ACCELERATION,
    DAMPING_RATIO,
    impedance_torque,
    ImpedanceGains,
    STIFFNESS,
)
from gdmp_ros.control.limits import TorqueLimiter
from gdmp_ros.control.manipulability import (
    position_torque,
    PositionGains,
    PositionState,
    PositionTarget,
)
from gdmp_ros.control.reference import GuardSettings, ReferenceGuard
from gdmp_ros.sim.panda import Arm, Measurement

#: Stiffness while nothing has been asked for [N/m, Nm/rad].
HOLD_STIFFNESS = np.diag([400.0, 400.0, 400.0, 30.0, 30.0, 30.0])


class Tick(NamedTuple):
    """
    What happened in one tick, measured before it.

    :ivar twist: of the tool [m/s, rad/s]
    :ivar wrench: external, at the tool [N, Nm]
    :ivar stiffness: applied, 36 numbers row-major
    :ivar torque: commanded [Nm]
    """

    measurement: Measurement
    twist: np.ndarray
    wrench: np.ndarray
    stiffness: np.ndarray
    torque: np.ndarray


class ClosedLoop:
    """An arm, its control law, its limits and the guard of its reference."""

    def __init__(self, arm: Arm, gains: ImpedanceGains | None = None,
                 guard: GuardSettings | None = None, damping_ratio: float = 0.7,
                 torque_rate: float = 1.0):
        """:param torque_rate: largest change of a joint torque per tick [Nm]"""
        self.arm = arm
        self._gains = (gains or ImpedanceGains()).array()
        self._settings = guard or GuardSettings()
        self._damping_ratio = damping_ratio
        limits = arm.limits
        self.limiter = TorqueLimiter(limits.lower, limits.upper, limits.torque, torque_rate)
        self.reset()

    def reset(self, position: np.ndarray | None = None) -> None:
        """Put the arm at rest at ``position`` [rad], at its first keyframe by default, holding."""
        self.arm.reset(position)
        measured = self.arm.measure()
        self._rest = measured.position.copy()
        self.limiter.reset(measured.bias)
        self.guard = ReferenceGuard(self._settings, measured.pose.copy(), HOLD_STIFFNESS,
                                    self._damping_ratio)

    def tick(self) -> Tick:
        """Measure, compute the torque, limit it and let one period pass."""
        measured = self.arm.measure()
        target = self.guard.target(self.arm.period).copy()
        # What the joints' velocity brings by itself need not be pushed for.
        target[ACCELERATION:ACCELERATION + 6] -= measured.drift
        torque, wrench = np.empty(len(self._rest)), np.empty(6)
        impedance_torque(measured.position, measured.velocity, measured.pose, measured.jacobian,
                         measured.inertia, measured.bias, self.arm.friction, target, self._rest,
                         self._gains, measured.external, torque, wrench)
        torque = self.limiter.apply(measured.position, torque)
        twist = measured.jacobian @ measured.velocity
        result = Tick(measured, twist, wrench, target[STIFFNESS:DAMPING_RATIO], torque)
        self.arm.step(torque)
        return result


class PositionLoop:
    """An arm that keeps a position, with its null space free for manipulability."""

    def __init__(self, arm: Arm, gains: PositionGains, torque_rate: float = 1.0):
        """:param torque_rate: largest change of a joint torque per tick [Nm]"""
        self.arm, self.gains = arm, gains
        limits = arm.limits
        self.limiter = TorqueLimiter(limits.lower, limits.upper, limits.torque, torque_rate)
        self.limiter.reset(arm.measure().bias)

    def tick(self, target: PositionTarget) -> PositionState:
        """Measure, compute the torque, limit it and let one period pass; the state before."""
        state = self.arm.linear_state(len(target.position))
        torque = position_torque(state, target, self.gains)
        self.arm.step(self.limiter.apply(self.arm.data.qpos, torque))
        return state

    def settle(self, target: PositionTarget, seconds: float) -> None:
        """Hold one target for a while."""
        for _ in range(round(seconds / self.arm.period)):
            self.tick(target)
