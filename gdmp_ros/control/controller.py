"""Impedance controller: guard, governor, energy tank, impedance law and torque limits."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gdmp_ros.control.energy_budget import apply_energy_budget, stored_energy
from gdmp_ros.control.governor import govern
from gdmp_ros.control.guard import ReferenceGuard
from gdmp_ros.control.impedance import external_wrench, impedance_torque
from gdmp_ros.control.limits import ENERGY, LimitCounters, LIMITS, TORQUE
from gdmp_ros.control.measurement import JointLimits, Measurement
from gdmp_ros.control.settings import ControllerSettings
from gdmp_ros.control.stiffness import diagonal_bounds
from gdmp_ros.control.tank import EnergyTank
from gdmp_ros.control.target import (
    ACCELERATION,
    DAMPING_RATIO,
    extrapolate_pose,
    POSE,
    resting_target,
    STIFFNESS,
    TARGET_SIZE,
    TWIST,
)
from gdmp_ros.control.torque_limits import TorqueLimiter
from gdmp_ros.util.settings import numbers


class Tick(NamedTuple):
    """
    What happened in one tick.

    :ivar measurement: at the beginning of the tick
    :ivar twist: of the tool [m/s, rad/s]
    :ivar wrench: external, at the tool [N, Nm]
    :ivar stiffness: applied, 36 numbers row by row
    :ivar requested: stiffness of the reference
    :ivar torque: commanded [Nm]
    :ivar spring: energy in the spring [J]
    :ivar tank: energy in the tank [J]
    :ivar violation: by how much each limit was exceeded, shape ``(len(LIMITS),)``
    """

    measurement: Measurement
    twist: np.ndarray
    wrench: np.ndarray
    stiffness: np.ndarray
    requested: np.ndarray
    torque: np.ndarray
    spring: float
    tank: float
    violation: np.ndarray


class ImpedanceController:
    """Impedance control of an arm that follows references; without ROS and simulator."""

    guard: ReferenceGuard
    tank: EnergyTank
    _limiter: TorqueLimiter

    def __init__(self, joints: JointLimits, friction: np.ndarray,
                 settings: ControllerSettings | None = None):
        """:param friction: viscous, of the joints [Nm s/rad], shape (n,)"""
        self.counters = LimitCounters()
        self._joints, self._friction = joints, friction
        self._next: ControllerSettings | None = None
        self._use(settings or ControllerSettings())

    def configure(self, settings: ControllerSettings) -> None:
        """Use other settings from the next tick on; torque, stiffness and energy carry over."""
        self._next = settings

    def reset(self, measured: Measurement) -> None:
        """Hold the measured pose, with the tank as at the start."""
        settings = self.settings
        self._posture = measured.position.copy()
        self._limiter = TorqueLimiter(self._joints, settings.limits)
        self._limiter.reset(measured.bias)
        self.guard = ReferenceGuard(settings.guard, measured.pose, settings.damping_ratio)
        self.tank = EnergyTank(settings.tank, self._friction)
        self._last_pose = measured.pose.copy()
        self._hold(measured.pose)

    def tick(self, measured: Measurement, dt: float) -> Tick:
        """Compute the torque for the next ``dt`` seconds."""
        self._take_settings()
        violation = np.zeros(len(LIMITS))
        self.tank.measure(measured, self._stored_energy(measured.pose), dt)
        target = self.guard.target(dt).copy()
        requested = target[STIFFNESS:STIFFNESS + 36].copy()
        spring = self._move_reference(measured, target, dt, violation)
        torque, wrench = self._impedance(measured)
        twist = measured.jacobian @ measured.velocity
        torque, missing = self.tank.damping_injection(
            measured, torque, self._spring_power(measured.pose, twist, spring, dt), dt)
        violation[ENERGY] += missing
        if not np.isfinite(torque).all():
            torque, spring = self._recover(measured), 0.0
            violation[TORQUE] = np.inf
        torque = self._send(measured, torque, spring, violation)
        if np.isfinite(measured.pose).all():
            self._last_pose = measured.pose.copy()
        return Tick(measured, twist, wrench, self._reference[STIFFNESS:STIFFNESS + 36].copy(),
                    requested, torque, spring, self.tank.energy, violation)

    @property
    def reference(self) -> np.ndarray:
        """The governed reference, `TARGET_SIZE` numbers."""
        return self._reference.copy()

    def hand_guide(self, measured: Measurement, dt: float) -> Tick:
        """
        Compute the torque for the next ``dt`` seconds of an arm that a person guides by hand.

        Gravity is compensated and the limits stay in force; there is no stiffness and no
        reference. From the next `tick` on the arm is held where it is.
        """
        self._take_settings()
        violation = np.zeros(len(LIMITS))
        self.tank.measure(measured, 0.0, dt)
        self._posture = measured.position.copy()
        self.guard.hold(measured.pose)
        self._hold(measured.pose)
        torque = self._send(measured, measured.bias, 0.0, violation)
        wrench = external_wrench(measured.jacobian, measured.inertia, measured.external,
                                 self.settings.gains.singularity)
        return Tick(measured, measured.jacobian @ measured.velocity, wrench, np.zeros(36),
                    np.zeros(36), torque, 0.0, self.tank.energy, violation)

    def _use(self, settings: ControllerSettings) -> None:
        self.settings = settings
        limits = settings.limits
        self._gains, self._limits = numbers(settings.gains), numbers(limits)
        self._stiffness_bounds = diagonal_bounds(limits.stiffness_min, limits.stiffness_max)

    def _take_settings(self) -> None:
        settings, self._next = self._next, None
        if settings is None:
            return
        self._use(settings)
        last = self._limiter.last
        self._limiter = TorqueLimiter(self._joints, settings.limits)
        self._limiter.reset(last)
        self.guard.configure(settings.guard, settings.damping_ratio)
        self.tank.configure(settings.tank)

    def _hold(self, pose: np.ndarray) -> None:
        """Hold a pose from now on, with the stiffness before the first reference."""
        self._reference = resting_target(pose)
        self._mean_acceleration = np.zeros(6)

    def _move_reference(self, measured: Measurement, target: np.ndarray, dt: float,
                        violation: np.ndarray) -> float:
        """Move the governed reference for one tick, and return the energy in the spring [J]."""
        reference, tank = self._reference, self.tank
        govern(reference, self._mean_acceleration, target, measured.jacobian, measured.inertia,
               self._limits, dt, violation)
        reference[DAMPING_RATIO] = target[DAMPING_RATIO]
        drawn, spring = apply_energy_budget(
            reference, target, measured.pose, self._gains, self._stiffness_bounds,
            dt * self.settings.limits.stiffness_rate, tank.spendable(dt), dt, violation)
        tank.draw(drawn)
        return float(spring)

    def _impedance(self, measured: Measurement) -> tuple[np.ndarray, np.ndarray]:
        """Torque of the impedance law [Nm], and external wrench [N, Nm]."""
        target = self._reference.copy()
        # With an empty tank only spring and damper act, nothing that drives.
        target[TWIST:ACCELERATION + 6] *= self.tank.feedforward_scale()
        # Subtract J̇q̇: the arm produces it without torque.
        target[ACCELERATION:ACCELERATION + 6] -= measured.jdot_qdot
        torque, wrench = np.empty(len(self._posture)), np.empty(6)
        impedance_torque(measured.position, measured.velocity, measured.pose, measured.jacobian,
                         measured.inertia, measured.bias, self._friction, target, self._posture,
                         self._gains, measured.external, torque, wrench)
        return torque, wrench

    def _send(self, measured: Measurement, torque: np.ndarray, spring: float,
              violation: np.ndarray) -> np.ndarray:
        """Limit and remember the torque, and count the violations."""
        torque = self._limiter.apply(measured.position, measured.velocity, measured.bias, torque,
                                     violation)
        self.tank.remember(measured, torque, spring)
        self.counters.add(violation)
        return torque

    def _recover(self, measured: Measurement) -> np.ndarray:
        """No torque could be computed: hold the measured pose, and compensate gravity."""
        self._hold(np.where(np.isfinite(measured.pose), measured.pose, self._last_pose))
        self.tank.empty()
        return measured.bias.copy() if np.isfinite(measured.bias).all() else self._limiter.last

    def _stored_energy(self, pose: np.ndarray) -> float:
        return float(stored_energy(pose, self._reference, self._gains))

    def _spring_power(self, pose: np.ndarray, twist: np.ndarray, spring: float, dt: float
                      ) -> float:
        """Rate at which the measured motion increases the energy in the spring [W]."""
        moving, ahead = np.zeros(TARGET_SIZE), np.empty(7)
        moving[POSE:POSE + 7] = pose
        moving[TWIST:TWIST + 6] = twist
        extrapolate_pose(moving, dt, ahead)
        return (self._stored_energy(ahead) - spring) / dt
