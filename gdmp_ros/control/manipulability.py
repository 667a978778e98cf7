"""
Velocity manipulability, and its tracking in the null space of a position task.

Source: [GDMP] eqs. (35) to (38); eq. (36) prints the inverse, (37) and (38) track ``Υ = J Jᵀ``.
"""
from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from gdmp_ros.control.impedance import damping_design


def manipulability(jacobian: np.ndarray) -> np.ndarray:
    """``Υ = J Jᵀ`` of a linear Jacobian, shape ``(m, m)`` [m²]."""
    return np.asarray(jacobian @ jacobian.T)


def jacobian_derivative(linear: np.ndarray, angular: np.ndarray) -> np.ndarray:
    """
    Derivative of a linear Jacobian with respect to each joint of a chain of revolute joints.

    Joint k rotates everything beyond it: the derivative of column i is ``z_k × j_i`` for k ≤ i,
    and ``z_i × j_k`` otherwise.

    :param linear: columns j_i, shape ``(3, n)`` [m]
    :param angular: axes z_i, shape ``(3, n)``
    :returns: shape ``(n, 3, n)``: by joint k, its rows and columns [m/rad]
    """
    n = linear.shape[1]
    first = np.minimum.outer(np.arange(n), np.arange(n))
    last = np.maximum.outer(np.arange(n), np.arange(n))
    return np.asarray(np.cross(angular.T[first], linear.T[last]).transpose(0, 2, 1))


def divergence(desired: np.ndarray, actual: np.ndarray) -> float:
    """``g = log det((Υ̂ + Υ)/2) - ½ log det(Υ̂ Υ)``, [GDMP] eq. (38): 0 if they are equal."""
    middle = np.linalg.slogdet(0.5 * (desired + actual))[1]
    return float(middle - 0.5 * (np.linalg.slogdet(desired)[1] + np.linalg.slogdet(actual)[1]))


def divergence_gradient(desired: np.ndarray, jacobian: np.ndarray,
                        derivative: np.ndarray) -> np.ndarray:
    """
    Gradient of `divergence` with respect to the joints, shape ``(n,)`` [1/rad].

    :param jacobian: J, shape ``(m, n)``
    :param derivative: ∂J/∂q_k, shape ``(n, m, n)``
    """
    actual = manipulability(jacobian)
    # d log det S = tr(S⁻¹ dS), and dΥ = dJ Jᵀ + its transpose.
    weight = np.linalg.inv(desired + actual) - 0.5 * np.linalg.inv(actual)
    return np.asarray(2.0 * np.einsum('ab,kbi,ai->k', weight, derivative, jacobian))


@dataclass(frozen=True)
class PositionGains:
    """
    Constants of `position_torque`.

    :ivar stiffness: of the position task, shape (m, m) [N/m]
    :ivar damping_ratio: 1 is critical
    :ivar alpha: α of [GDMP] eq. (37) [Nm]; with 0 the null space is only damped
    :ivar null_damping: D_n, for joint velocities in the null space [Nm s/rad]
    :ivar singularity: ε in ``Λ = (J M⁻¹ Jᵀ + ε² I)⁻¹`` [1/√kg]
    """

    stiffness: np.ndarray
    damping_ratio: float = 0.7
    alpha: float = 0.0
    null_damping: float = 1.0
    singularity: float = 0.02


@dataclass(frozen=True)
class PositionTarget:
    """
    Desired motion of the tool, and desired manipulability.

    :ivar position: shape (m,) [m], with velocity [m/s] and acceleration [m/s²]
    :ivar manipulability: Υ̂, shape (m, m) [m²]; None for no preference
    """

    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    manipulability: np.ndarray | None = field(default=None)


@dataclass(frozen=True)
class PositionState:
    """
    State of the arm.

    :ivar position: of the tool, shape (m,) [m]
    :ivar jacobian: linear, shape (m, n)
    :ivar derivative: of the Jacobian, shape (n, m, n)
    :ivar velocity: of the joints, shape (n,) [rad/s]
    :ivar inertia: of the joints, shape (n, n)
    :ivar bias: gravity and Coriolis torque [Nm], shape (n,)
    :ivar friction: viscous, of the joints [Nm s/rad], shape (n,)
    :ivar jdot_qdot: J̇ q̇, shape (m,) [m/s²]
    """

    position: np.ndarray
    jacobian: np.ndarray
    derivative: np.ndarray
    velocity: np.ndarray
    inertia: np.ndarray
    bias: np.ndarray
    friction: np.ndarray
    jdot_qdot: np.ndarray


def position_torque(state: PositionState, target: PositionTarget,
                    gains: PositionGains) -> np.ndarray:
    """
    Impedance in position, and manipulability in its null space, [GDMP] eq. (37).

    ``τ = Jᵀ F - (I - Jᵀ J̄ᵀ)(α ∇g + D_n q̇)``, plus gravity and Coriolis torque, and the inertial
    force and the joint friction of the desired motion.

    :returns: joint torques [Nm], shape ``(n,)``
    """
    jacobian, dq = state.jacobian, state.velocity
    solved = np.linalg.solve(state.inertia, jacobian.T)
    inverse = jacobian @ solved + gains.singularity ** 2 * np.eye(len(jacobian))
    damping, task_inertia = damping_design(np.ascontiguousarray(gains.stiffness), inverse,
                                           gains.damping_ratio)
    rate = target.velocity - jacobian @ dq
    force = (gains.stiffness @ (target.position - state.position) + damping @ rate
             + task_inertia @ (target.acceleration - state.jdot_qdot))
    # J̄ = M⁻¹ Jᵀ Λ, the inertia-weighted inverse.
    weighted = solved @ task_inertia
    rest = -gains.null_damping * dq
    if target.manipulability is not None and gains.alpha > 0.0:
        rest = rest - gains.alpha * divergence_gradient(target.manipulability, jacobian,
                                                        state.derivative)
    null = rest - jacobian.T @ (weighted.T @ rest)
    return np.asarray(jacobian.T @ force + null + state.bias
                      + state.friction * (weighted @ target.velocity))
