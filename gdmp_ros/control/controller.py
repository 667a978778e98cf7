"""Impedance controller: guard, governor, energy tank, impedance law and torque limits."""
from __future__ import annotations

import numpy as np

from gdmp_ros.control.contact import Contact
from gdmp_ros.control.energy_budget import apply_energy_budget, release
from gdmp_ros.control.friction import friction_of, without_friction
from gdmp_ros.control.governor import govern
from gdmp_ros.control.guard import ReferenceGuard
from gdmp_ros.control.identification import joint_torque
from gdmp_ros.control.impedance import external_wrench, impedance_torque
from gdmp_ros.control.limits import ENERGY, LimitCounters, LIMITS, TOOL_SPEED, TORQUE, WRENCH_LIMIT
from gdmp_ros.control.measurement import JointLimits, Measurement
from gdmp_ros.control.modes import ArmMode
from gdmp_ros.control.posture import Posture
from gdmp_ros.control.settings import ControllerSettings, SMALLEST_DAMPING_RATIO
from gdmp_ros.control.spring import moved_with_tool, spring_power, stored_energy
from gdmp_ros.control.stiffness import diagonal_bounds
from gdmp_ros.control.tank import EnergyTank
from gdmp_ros.control.target import (
    ACCELERATION,
    DAMPING_RATIO,
    POSE,
    resting_target,
    STIFFNESS,
    WRENCH,
)
from gdmp_ros.control.tick import Tick
from gdmp_ros.control.torque_limits import SPEED_MARGIN, TorqueLimiter
from gdmp_ros.manifolds.linalg import is_finite
from gdmp_ros.util.settings import numbers

#: Joint damping of an arm that gives way [Nm s/rad]: it stops, and a hand moves it.
COMPLIANT_DAMPING = 5.0


class ImpedanceController:
    """Impedance control of an arm that follows references; without ROS and simulator."""

    guard: ReferenceGuard
    tank: EnergyTank
    _limiter: TorqueLimiter

    def __init__(self, joints: JointLimits, friction: np.ndarray,
                 settings: ControllerSettings | None = None):
        """
        Prepare to control.

        :param friction: viscous friction of the model's joints [Nm s/rad], shape (n,)
        :raises ParameterError: if the settings do not fit the joints
        """
        self.counters, self.posture = LimitCounters(), Posture(joints)
        self.contact = Contact((settings or ControllerSettings()).contact)
        self._joints, self._model_friction = joints, friction
        self._next: ControllerSettings | None = None
        self._refills = False
        self._use(settings or ControllerSettings())

    def configure(self, settings: ControllerSettings) -> None:
        """
        Use other settings from the next tick on; torque, stiffness and energy carry over.

        :raises ParameterError: if they do not fit the joints
        """
        self.check(settings)
        self._next = settings

    def check(self, settings: ControllerSettings) -> None:
        """:raises ParameterError: if the settings do not fit the joints"""
        friction_of(settings.friction, self._model_friction)
        self.posture.check(settings.posture)

    def refill_tank(self) -> None:
        """Fill the energy tank as at the start, with the next tick."""
        self._refills = True

    def reset(self, measured: Measurement) -> None:
        """Hold the measured pose, with the tank as at the start."""
        settings = self.settings
        self.posture.be(measured.position)
        self.posture.use(settings.posture)
        self._limiter = TorqueLimiter(self._joints, settings.limits)
        self._limiter.reset(measured.bias)
        if hasattr(self, 'guard'):
            self.guard.restart(measured.pose)
        else:
            self.guard = ReferenceGuard(settings.guard, measured.pose, settings.damping_ratio)
        self.tank = EnergyTank(settings.tank, self._credit)
        self._last_pose = measured.pose.copy()
        self.contact.reset()
        self._hold(measured.pose)

    def tick(self, measured: Measurement, dt: float) -> Tick:
        """Compute the torque for the next ``dt`` seconds."""
        if self.guard.mode is ArmMode.COMPLIANT:
            slowed = measured.bias - COMPLIANT_DAMPING * measured.velocity
            return self._without_reference(measured, slowed, dt, ArmMode.COMPLIANT)
        self._take_settings()
        violation = np.zeros(len(LIMITS))
        self.tank.measure(measured, self._stored_energy(measured.pose), dt)
        twist = measured.jacobian @ measured.velocity
        known = is_finite(measured.pose) and is_finite(twist)
        target = self.guard.target(dt, *((measured.pose, twist) if known else ())).copy()
        requested = target[STIFFNESS:STIFFNESS + 36].copy()
        spring = self._move_reference(measured, target, dt, violation)
        torque, wrench, commanded = self._impedance(measured, dt, violation)
        if is_finite(torque):
            self._feel(wrench, dt)
            torque, spring = self._settle(measured, torque, twist, spring, dt, violation)
        else:
            torque, spring = self._limited(measured, self._recover(measured), dt, violation), 0.0
            violation[TORQUE] = np.inf
        self._sent(measured, torque, spring, dt, violation)
        if known:
            self._last_pose = measured.pose.copy()
        return Tick(measured, twist, wrench, self._reference[STIFFNESS:STIFFNESS + 36].copy(),
                    requested, torque, commanded, self.guard.mode, spring, self.tank.energy,
                    violation)

    def _feel(self, wrench: np.ndarray, dt: float) -> None:
        collision = self.contact.feel(wrench, self._reference, dt)
        if collision and self.guard.following:
            comply = self.settings.contact.collision_reaction == 'comply'
            (self.guard.comply if comply else self.guard.stop)(collision)

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
        return self._without_reference(measured, measured.bias, dt, ArmMode.GUIDED)

    def move_joints(self, measured: Measurement, position: np.ndarray, velocity: np.ndarray,
                    dt: float, mode: ArmMode) -> Tick:
        """
        Compute the torque for the next ``dt`` seconds of an arm that follows joint positions.

        For slow motions without contact; the limits stay in force. From the next `tick` on the arm
        is held where it is.
        """
        return self._without_reference(measured, joint_torque(measured, position, velocity), dt,
                                       mode)

    def move_tool(self, before: np.ndarray, after: np.ndarray) -> None:
        """
        Go on holding with the same wrench, after another point became the tool.

        :param before: pose of the last tool (x, y, z, qw, qx, qy, qz)
        :param after: pose of the new one
        """
        pose, stored = self._reference[POSE:POSE + 7], self._stored_energy(before)
        pose[:] = moved_with_tool(self._reference, before, after, self._gains)
        if self._stored_energy(after) - stored > self.tank.energy:
            pose[:] = after
        self.guard.hold(pose.copy(), self.guard.mode)

    def _without_reference(self, measured: Measurement, wanted: np.ndarray, dt: float,
                           mode: ArmMode) -> Tick:
        self._take_settings()
        twist = measured.jacobian @ measured.velocity
        violation = np.zeros(len(LIMITS))
        self.tank.measure(measured, 0.0, dt)
        self.posture.be(measured.position)
        self.guard.measure(dt, measured.pose, twist)
        self.guard.hold(measured.pose, mode)
        self._hold(measured.pose)
        torque = self._limited(measured, wanted, dt, violation)
        self._sent(measured, torque, 0.0, dt, violation)
        wrench = external_wrench(measured, self._external(measured),
                                 self.settings.gains.singularity)
        return Tick(measured, twist, wrench, np.zeros(36), np.zeros(36), torque, np.zeros(6),
                    mode, 0.0, self.tank.energy, violation)

    def _use(self, settings: ControllerSettings) -> None:
        self.settings = settings
        limits, joints = settings.limits, self._joints
        self._gains, self._limits = numbers(settings.gains), numbers(limits)
        self._joint_limits = np.array([
            joints.lower, joints.upper, SPEED_MARGIN * joints.fastest(limits.joint_speed)])
        self._stiffness_bounds = diagonal_bounds(limits.stiffness_min, limits.stiffness_max)
        self._friction, self._credit = friction_of(settings.friction, self._model_friction)
        self._dry = self._friction[1] if self._friction[1].any() else None

    def _take_settings(self) -> None:
        settings, self._next = self._next, None
        if self._refills:
            self._refills = False
            self.tank.fill()
        if settings is None:
            return
        if settings.posture != self.settings.posture:
            self.posture.use(settings.posture)
        self._use(settings)
        last = self._limiter.last
        self._limiter = TorqueLimiter(self._joints, settings.limits)
        self._limiter.reset(last)
        self.guard.configure(settings.guard, settings.damping_ratio)
        self.tank.configure(settings.tank)
        self.contact.settings = settings.contact
        self.tank.credit = self._credit

    def _hold(self, pose: np.ndarray) -> None:
        """Hold a pose from now on, with the stiffness before the first reference."""
        self._reference = resting_target(pose)
        self._past_accelerations = np.zeros((2, 6))

    def _move_reference(self, measured: Measurement, target: np.ndarray, dt: float,
                        violation: np.ndarray) -> float:
        """Move the governed reference for one tick, and return the energy in the spring [J]."""
        reference, tank = self._reference, self.tank
        govern(reference, self._past_accelerations, target, measured.pose, measured.position,
               measured.jacobian, measured.inertia, self._joint_limits, self._gains, self._limits,
               dt, violation)
        reference[WRENCH:] = target[WRENCH:]
        self.contact.correct(reference, dt)
        # 0 in a message stands for nothing.
        reference[DAMPING_RATIO] = max(target[DAMPING_RATIO] or self.settings.damping_ratio,
                                       SMALLEST_DAMPING_RATIO)
        drawn, spring = apply_energy_budget(
            reference, target, measured.pose, self._gains, self._stiffness_bounds,
            dt * self.settings.limits.stiffness_rate, tank.spendable(dt), dt, violation)
        tank.draw(drawn)
        return float(spring)

    def _impedance(self, measured: Measurement, dt: float, violation: np.ndarray
                   ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Torque of the impedance law [Nm], external and commanded wrench [N, Nm]."""
        target = self._reference.copy()
        posture = self.posture.advance(dt)
        # Subtract J̇q̇: the arm produces it without torque.
        target[ACCELERATION:ACCELERATION + 6] -= measured.jdot_qdot
        torque, wrench, force = np.empty(len(measured.position)), np.empty(6), np.empty(6)
        scale, too_fast = impedance_torque(
            measured.position, measured.velocity, measured.pose, measured.jacobian,
            measured.inertia, measured.bias, self._friction, target, posture, self._gains,
            self.settings.limits.tool_speed, self._external(measured), torque, wrench, force)
        violation[WRENCH_LIMIT], violation[TOOL_SPEED] = 1.0 - scale, too_fast
        return torque, wrench, force

    def _settle(self, measured: Measurement, wanted: np.ndarray, twist: np.ndarray, spring: float,
                dt: float, violation: np.ndarray) -> tuple[np.ndarray, float]:
        """
        Limit a torque; with too little energy for it shed wrench, then stiffness.

        :returns: torque to be sent [Nm], energy in the spring [J]
        """
        torque, tank = self._limited(measured, wanted, dt, violation), self.tank
        power = spring_power(measured.pose, twist, self._reference, self._gains, spring, dt)
        missing = tank.missing(measured, torque, power, dt)
        if missing <= 0.0:
            return torque, spring
        violation[ENERGY] += missing
        velocity, bias = measured.velocity, measured.bias
        driving = dt * float(velocity @ (torque - bias))
        if driving > 0.0:
            wanted = bias + max(1.0 - missing / driving, 0.0) * (wanted - bias)
            torque = self._limited(measured, wanted, dt, violation)
            missing = tank.missing(measured, torque, power, dt)
        if missing > 0.0:
            released = release(measured.pose, self._reference, self._gains,
                               self._stiffness_bounds, missing)
            tank.draw(-released)
            spring -= released
        return torque, spring

    def _limited(self, measured: Measurement, torque: np.ndarray, dt: float,
                 violation: np.ndarray) -> np.ndarray:
        return self._limiter.limited(measured.position, measured.velocity, measured.bias, torque,
                                     dt, violation)

    def _sent(self, measured: Measurement, torque: np.ndarray, spring: float, dt: float,
              violation: np.ndarray) -> None:
        """Remember the torque that is sent, and count the violations."""
        self._limiter.sent(torque)
        self.tank.remember(measured, torque, spring, dt)
        self.counters.add(violation)

    def _recover(self, measured: Measurement) -> np.ndarray:
        """No torque could be computed: hold the measured pose, and compensate gravity."""
        pose = np.where(np.isfinite(measured.pose), measured.pose, self._last_pose)
        self._hold(pose)
        self.guard.measure(0.0, pose, np.zeros(6))
        self.guard.fault('a measurement or a torque was not finite')
        self.tank.empty()
        return measured.bias.copy() if is_finite(measured.bias) else self._limiter.last

    def _external(self, measured: Measurement) -> np.ndarray:
        return without_friction(measured, self._dry, self.settings.gains.friction_smoothing)

    def _stored_energy(self, pose: np.ndarray) -> float:
        return float(stored_energy(pose, self._reference, self._gains))
