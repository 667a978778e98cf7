"""
The two impedance laws of an arm: a spring at the tool, and springs at the joints.

Each has a governed reference, which moves within the limits and as far as the energy tank pays for
it. The controller (`gdmp_ros.control.controller`) uses one of them at a time.
"""
from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from gdmp_ros.control.contact import Contact
from gdmp_ros.control.energy_budget import apply_energy_budget, LEAST_SOFTENING, release
from gdmp_ros.control.governor import govern
from gdmp_ros.control.impedance import external_wrench, impedance_torque, TOOL_BRAKE
from gdmp_ros.control.joint_spring import joint_energy, joint_law, move_joint_reference
from gdmp_ros.control.joint_target import resting_joints
from gdmp_ros.control.limits import TOOL_SPEED, WRENCH_LIMIT
from gdmp_ros.control.measurement import JointLimits, Measurement
from gdmp_ros.control.posture import Posture
from gdmp_ros.control.reference_kinds import HOLD_JOINT_STIFFNESS
from gdmp_ros.control.settings import ControllerSettings, SMALLEST_DAMPING_RATIO
from gdmp_ros.control.spring import moved_with_tool, spring_power, stored_energy
from gdmp_ros.control.stiffness import diagonal_bounds
from gdmp_ros.control.target import (
    ACCELERATION,
    DAMPING_RATIO,
    POSE,
    resting_target,
    STIFFNESS,
    TWIST,
    WRENCH,
)
from gdmp_ros.control.torque_limits import SPEED_MARGIN
from gdmp_ros.util.settings import numbers

#: Band below the speed limit of the tool in which what drives it decreases [m/s].
TOOL_SPEED_BAND = 0.15


class Response(NamedTuple):
    """
    What a law wants.

    :ivar torque: with gravity and Coriolis torque [Nm]
    :ivar wrench: external, at the tool [N, Nm]
    :ivar commanded: wrench of the law at the tool [N, Nm]
    """

    torque: np.ndarray
    wrench: np.ndarray
    commanded: np.ndarray


class ImpedanceLaw(Protocol):
    """
    A law: springs between a governed reference and the arm.

    :ivar reference: the governed reference
    """

    reference: np.ndarray

    def use(self, settings: ControllerSettings, friction: np.ndarray, joints: JointLimits) -> None:
        """Use other settings from now on; ``friction`` is compensated."""

    def hold(self, measured: Measurement) -> None:
        """Hold the arm where it is, with the stiffness before the first reference."""

    def stored(self, measured: Measurement) -> float:
        """Energy in the springs [J]."""

    def move(self, measured: Measurement, target: np.ndarray, budget: float, dt: float,
             violation: np.ndarray) -> tuple[float, float]:
        """
        Move the reference for one tick.

        :param target: of the guard
        :param budget: energy that may be drawn [J]
        :returns: energy drawn, and energy in the springs at the end [J]
        """

    def respond(self, measured: Measurement, external: np.ndarray, dt: float,
                violation: np.ndarray) -> Response:
        """
        Compute the torque of one tick.

        :param external: torque of the environment on the joints [Nm]
        """

    def power(self, measured: Measurement, twist: np.ndarray, stored: float, dt: float) -> float:
        """Rate of the energy in the springs at the measured motion [W]."""

    def release(self, measured: Measurement, energy: float) -> float:
        """Soften the springs until they have released an energy; returns what they did [J]."""

    def motion(self, measured: Measurement) -> np.ndarray:
        """Target of the tool with the twist and the wrench of the reference."""


class ToolImpedance:
    """A spring between the tool and its reference."""

    def __init__(self, posture: Posture, contact: Contact):
        self.reference = np.empty(0)
        self._posture, self._contact = posture, contact

    def use(self, settings: ControllerSettings, friction: np.ndarray, joints: JointLimits) -> None:
        """Use other settings from now on; ``friction`` is compensated."""
        self._settings, self._friction = settings, friction
        limits = settings.limits
        self._gains, self._limits = numbers(settings.gains), numbers(limits)
        self._joint_limits = np.array([
            joints.lower, joints.upper, SPEED_MARGIN * joints.fastest(limits.joint_speed)])
        self._bounds = diagonal_bounds(limits.stiffness_min, limits.stiffness_max)

    def hold_pose(self, pose: np.ndarray) -> None:
        """Hold a pose from now on, with the stiffness before the first reference."""
        self.reference = resting_target(pose)
        self._past_accelerations = np.zeros((2, 6))

    def hold(self, measured: Measurement) -> None:
        """Hold the arm where it is, with the stiffness before the first reference."""
        self.hold_pose(measured.pose)

    def stored(self, measured: Measurement) -> float:
        """Energy in the springs [J]."""
        return self.stored_at(measured.pose)

    def stored_at(self, pose: np.ndarray) -> float:
        """Energy in the spring with the tool at a pose [J]."""
        return float(stored_energy(pose, self.reference, self._gains))

    def move(self, measured: Measurement, target: np.ndarray, budget: float, dt: float,
             violation: np.ndarray) -> tuple[float, float]:
        """Move the reference for one tick."""
        reference = self.reference
        govern(reference, self._past_accelerations, target, measured.pose, measured.position,
               measured.jacobian, measured.inertia, self._joint_limits, self._gains, self._limits,
               dt, violation)
        reference[WRENCH:] = target[WRENCH:]
        self._contact.correct(reference, dt)
        reference[DAMPING_RATIO] = _damping_ratio(target[DAMPING_RATIO], self._settings)
        drawn, stored = apply_energy_budget(
            reference, target, measured.pose, self._gains, self._bounds,
            dt * self._settings.limits.stiffness_rate, budget, dt, violation)
        return drawn, float(stored)

    def respond(self, measured: Measurement, external: np.ndarray, dt: float,
                violation: np.ndarray) -> Response:
        """Compute the torque of one tick."""
        target = self.reference.copy()
        posture = self._posture.advance(dt)
        # Subtract J̇q̇: the arm produces it without torque.
        target[ACCELERATION:ACCELERATION + 6] -= measured.jdot_qdot
        result = Response(np.empty(len(measured.position)), np.empty(6), np.empty(6))
        scale, too_fast = impedance_torque(
            measured.position, measured.velocity, measured.pose, measured.jacobian,
            measured.inertia, measured.bias, self._friction, target, posture, self._gains,
            self._settings.limits.tool_speed, external, *result)
        violation[WRENCH_LIMIT], violation[TOOL_SPEED] = 1.0 - scale, too_fast
        return result

    def power(self, measured: Measurement, twist: np.ndarray, stored: float, dt: float) -> float:
        """Rate of the energy in the springs at the measured motion [W]."""
        return float(spring_power(measured.pose, twist, self.reference, self._gains, stored, dt))

    def release(self, measured: Measurement, energy: float) -> float:
        """Soften the springs until they have released an energy; returns what they did [J]."""
        return release(measured.pose, self.reference, self._gains, self._bounds, energy)

    def motion(self, measured: Measurement) -> np.ndarray:
        """Target of the tool with the twist and the wrench of the reference."""
        return self.reference

    def follow_tool(self, before: np.ndarray, after: np.ndarray, energy: float) -> np.ndarray:
        """
        Keep the wrench after another point became the tool.

        :param before: pose of the last tool
        :param after: pose of the new one
        :param energy: that may be drawn for it [J]; with less, the new tool is held where it is
        :returns: the new pose of the reference
        """
        pose, stored = self.reference[POSE:POSE + 7], self.stored_at(before)
        pose[:] = moved_with_tool(self.reference, before, after, self._gains)
        if self.stored_at(after) - stored > energy:
            pose[:] = after
        return pose.copy()


class JointImpedance:
    """Springs between the joints and their reference."""

    def __init__(self) -> None:
        self.reference = np.empty(0)
        self._mean = np.empty(0)

    def use(self, settings: ControllerSettings, friction: np.ndarray, joints: JointLimits) -> None:
        """Use other settings from now on; ``friction`` is compensated."""
        self._settings, self._friction, self._gains = settings, friction, numbers(settings.gains)
        self._limits = np.array([joints.lower, joints.upper,
                                 SPEED_MARGIN * joints.fastest(settings.limits.joint_speed)])

    def hold(self, measured: Measurement) -> None:
        """Hold the arm where it is, with the stiffness before the first reference."""
        self.reference = resting_joints(
            measured.position, np.full(len(measured.position), HOLD_JOINT_STIFFNESS),
            self._settings.damping_ratio)
        self._mean = np.zeros(len(measured.position))

    def stored(self, measured: Measurement) -> float:
        """Energy in the springs [J]."""
        return float(joint_energy(measured.position, self.reference))

    def move(self, measured: Measurement, target: np.ndarray, budget: float, dt: float,
             violation: np.ndarray) -> tuple[float, float]:
        """Move the reference for one tick."""
        limits = self._settings.limits
        self.reference[-1] = _damping_ratio(target[-1], self._settings)
        drawn, stored = move_joint_reference(
            self.reference, self._mean, target, measured.position, self._limits,
            limits.joint_acceleration, dt * limits.stiffness_rate, budget, dt, violation)
        return drawn, stored

    def respond(self, measured: Measurement, external: np.ndarray, dt: float,
                violation: np.ndarray) -> Response:
        """Compute the torque of one tick."""
        gains = self._settings.gains
        torque = np.empty(len(measured.position))
        joint_law(measured.position, measured.velocity, measured.inertia, measured.bias,
                  self._friction, self._gains, self.reference, self._mean, torque)
        torque = self._slowed(measured, torque, violation)
        return Response(torque, external_wrench(measured, external, gains.singularity),
                        np.zeros(6))

    def _slowed(self, measured: Measurement, torque: np.ndarray, violation: np.ndarray
                ) -> np.ndarray:
        """The torque for a tool that is too fast: less of what drives it, and a brake."""
        largest = self._settings.limits.tool_speed
        band = min(TOOL_SPEED_BAND, 0.5 * largest)
        velocity = measured.jacobian[:3] @ measured.velocity
        speed = float(np.linalg.norm(velocity))
        excess = speed - largest + band
        if excess <= 0.0:
            return torque
        violation[TOOL_SPEED] = excess
        active = torque - measured.bias
        if active @ measured.velocity > 0.0:
            active *= max(1.0 - excess / band, 0.0)
        brake = measured.jacobian[:3].T @ velocity * (-TOOL_BRAKE * excess / speed)
        return np.asarray(measured.bias + active + brake)

    def power(self, measured: Measurement, twist: np.ndarray, stored: float, dt: float) -> float:
        """Rate of the energy in the springs at the measured motion [W]."""
        ahead = measured.position + dt * measured.velocity
        return (float(joint_energy(ahead, self.reference)) - stored) / dt

    def release(self, measured: Measurement, energy: float) -> float:
        """Soften the springs until they have released an energy; returns what they did [J]."""
        n, before = len(measured.position), self.stored(measured)
        if before <= 0.0:
            return 0.0
        self.reference[2 * n:3 * n] *= max(1.0 - energy / before, LEAST_SOFTENING)
        return before - self.stored(measured)

    def motion(self, measured: Measurement) -> np.ndarray:
        """Target of the tool with the twist and the wrench of the reference."""
        n, target = len(measured.position), resting_target(measured.pose)
        target[TWIST:TWIST + 6] = measured.jacobian @ self.reference[n:2 * n]
        return target


def stiffness_at_tool(law: ImpedanceLaw) -> np.ndarray:
    """36 numbers; zeros if the spring is not at the tool."""
    return (law.reference[STIFFNESS:STIFFNESS + 36].copy() if isinstance(law, ToolImpedance)
            else np.zeros(36))


def _damping_ratio(asked: float, settings: ControllerSettings) -> float:
    """Damping ratio of a reference; 0 in a message stands for nothing."""
    return max(asked or settings.damping_ratio, SMALLEST_DAMPING_RATIO)
