"""
Cartesian impedance with a full 6×6 stiffness, [GDMP] eqs. (39), (40).

The wrench is the gradient of ``½ eᵀ K e`` with e the clipped position error and rotation vector of
the orientation error (base frame), plus damping designed for the inertia felt at the tool.
"""
from __future__ import annotations

import math

import numpy as np

from gdmp_ros.control.settings import GAIN_NUMBERS
from gdmp_ros.control.target import ACCELERATION, DAMPING_RATIO, POSE, STIFFNESS, TWIST
from gdmp_ros.kernels import kernel, records_at
from gdmp_ros.manifolds.linalg import (
    cholesky,
    invert_lower,
    limit_norm,
    multiply,
    transposed_multiply,
)
from gdmp_ros.manifolds.quaternion import rotation_between
from gdmp_ros.manifolds.spectral import symmetric_eigen


@kernel
def task_inertia_inverse(inertia, jacobian, singularity, solved):
    """
    ``A = J M⁻¹ Jᵀ + ε² I`` (6×6), and ``M⁻¹ Jᵀ`` into ``solved`` (n×6).
    """
    n = inertia.shape[0]
    lower, inverse = np.empty(n * n), np.empty(n * n)
    cholesky(n, inertia.reshape(n * n), lower)
    invert_lower(n, lower, inverse)
    half = np.empty((n, 6))
    for i in range(n):
        for j in range(6):
            total = 0.0
            for k in range(i + 1):
                total += inverse[i * n + k] * jacobian[j, k]
            half[i, j] = total
    for i in range(n):
        for j in range(6):
            total = 0.0
            for k in range(i, n):
                total += inverse[k * n + i] * half[k, j]
            solved[i, j] = total
    result = np.empty((6, 6))
    for i in range(6):
        for j in range(i + 1):
            total = singularity * singularity if i == j else 0.0
            for k in range(n):
                total += half[k, i] * half[k, j]
            result[i, j] = total
            result[j, i] = total
    return result


@kernel
def damping_design(stiffness, inertia_inverse, damping_ratio):
    """
    Damping by double diagonalisation, and the task inertia Λ.

    With ``Λ = Q Qᵀ`` and ``K = Q diag(k) Qᵀ`` the damping is ``D = 2 ζ Q diag(√k) Qᵀ``: every mode
    of ``Λ ẍ + D ẋ + K x = 0`` has the damping ratio ζ.

    :param stiffness: K, shape (m, m), positive definite
    :param inertia_inverse: Λ⁻¹, shape (m, m)
    :returns: D and Λ, shape (m, m) each
    """
    m = stiffness.shape[0]
    lower, inverse, work, rotated = (np.empty(m * m), np.empty(m * m), np.empty(m * m),
                                     np.empty(m * m))
    cholesky(m, inertia_inverse.reshape(m * m), lower)
    invert_lower(m, lower, inverse)
    multiply(m, stiffness.reshape(m * m), lower, work)
    transposed_multiply(m, lower, work, rotated)
    values, vectors = np.empty(m), np.empty(m * m)
    symmetric_eigen(m, rotated, values, vectors, work)
    # Rows of V L⁻¹ are the columns of Q.
    multiply(m, vectors, inverse, work)
    damping, inertia = np.empty((m, m)), np.empty((m, m))
    for i in range(m):
        for j in range(i + 1):
            d, inert = 0.0, 0.0
            for k in range(m):
                weight = work[k * m + i] * work[k * m + j]
                d += weight * math.sqrt(max(values[k], 0.0))
                inert += weight
            damping[i, j] = 2.0 * damping_ratio * d
            damping[j, i] = damping[i, j]
            inertia[i, j] = inert
            inertia[j, i] = inert
    return damping, inertia


@kernel
def left_jacobian_inverse(e, v, out):
    """
    ``J_l(e)⁻¹ v`` on SO(3): makes the torque the gradient of the rotational energy.
    """
    angle2 = e[0] * e[0] + e[1] * e[1] + e[2] * e[2]
    if angle2 < 1e-6:
        factor = 1.0 / 12.0 + angle2 / 720.0
    else:
        angle = math.sqrt(angle2)
        factor = 1.0 / angle2 - 0.5 / (angle * math.tan(0.5 * angle))
    cx = e[1] * v[2] - e[2] * v[1]
    cy = e[2] * v[0] - e[0] * v[2]
    cz = e[0] * v[1] - e[1] * v[0]
    out[0] = v[0] - 0.5 * cx + factor * (e[1] * cz - e[2] * cy)
    out[1] = v[1] - 0.5 * cy + factor * (e[2] * cx - e[0] * cz)
    out[2] = v[2] - 0.5 * cz + factor * (e[0] * cy - e[1] * cx)


@kernel
def elastic_error(pose, target, gains, error):
    """
    Write the position error and the rotation vector of the orientation error, both clipped.

    :param gains: record of `ImpedanceGains`
    :param error: result in the base frame, shape (6,) [m, rad]
    """
    for i in range(3):
        error[i] = target[POSE + i] - pose[i]
    rotation_between(pose[3:7], target[POSE + 3:POSE + 7], error[3:])
    limit_norm(3, error[:3], gains.position_clip)
    limit_norm(3, error[3:], gains.rotation_clip)


@kernel
def _elastic_wrench(pose, target, gains, wrench):
    error = np.empty(6)
    elastic_error(pose, target, gains, error)
    for i in range(6):
        wrench[i] = 0.0
        for j in range(6):
            wrench[i] += target[STIFFNESS + 6 * i + j] * error[j]
    left_jacobian_inverse(error[3:], wrench[3:].copy(), wrench[3:])


@kernel
def _add_posture(q, dq, rest, gains, jacobian, solved, task_inertia, torque):
    """Add the posture torque projected to the null space: ``(I - Jᵀ Λ J M⁻¹) τ``."""
    n = q.size
    posture, task = np.empty(n), np.zeros(6)
    for i in range(n):
        posture[i] = gains.posture_stiffness * (rest[i] - q[i]) - gains.posture_damping * dq[i]
    for j in range(6):
        for i in range(n):
            task[j] += solved[i, j] * posture[i]
    for i in range(n):
        total = posture[i]
        for j in range(6):
            for k in range(6):
                total -= jacobian[j, i] * task_inertia[j, k] * task[k]
        torque[i] += total


@kernel
def _add_feed_forward(target, friction, jacobian, solved, task_inertia, torque):
    """
    Add ``Jᵀ Λ ẍ_d`` and the friction at the joint velocities ``M⁻¹ Jᵀ Λ ẋ_d``.

    Friction is compensated at the velocity of the reference, not at the measured one, so that no
    energy is added to a motion that an external force causes.
    """
    for j in range(6):
        force, impulse = 0.0, 0.0
        for k in range(6):
            force += task_inertia[j, k] * target[ACCELERATION + k]
            impulse += task_inertia[j, k] * target[TWIST + k]
        for i in range(torque.size):
            torque[i] += jacobian[j, i] * force + friction[i] * solved[i, j] * impulse


def external_wrench(jacobian: np.ndarray, inertia: np.ndarray, external: np.ndarray,
                    singularity: float) -> np.ndarray:
    """
    Wrench at the tool that explains external joint torques: ``Λ J M⁻¹ τ_ext`` [N, Nm].

    :param external: external joint torque [Nm], shape (n,)
    """
    solved = np.empty((len(external), 6))
    inverse = task_inertia_inverse(inertia, jacobian, singularity, solved)
    return np.asarray(np.linalg.solve(inverse, solved.T @ external))


@kernel
def impedance_torque(q, dq, pose, jacobian, inertia, bias, friction, target, rest, gain_numbers,
                     external, torque, wrench):
    """
    Compute the joint torque of one tick.

    :param pose: measured (x, y, z, qw, qx, qy, qz)
    :param friction: viscous, of the joints [Nm s/rad], shape (n,)
    :param target: `TARGET_SIZE` numbers: pose, twist, acceleration, 6×6 stiffness, damping ratio
    :param rest: posture of the null space [rad]
    :param gain_numbers: `ImpedanceGains` as numbers
    :param external: external joint torque [Nm]
    :param torque: result [Nm], shape (n,): impedance + posture + gravity and Coriolis
    :param wrench: result, external wrench at the tool [N, Nm], shape (6,)
    """
    gains = records_at(gain_numbers, 0, 1, GAIN_NUMBERS)[0]
    n = q.size
    solved, force, rate, impulse = np.empty((n, 6)), np.empty(6), np.empty(6), np.zeros(6)
    inverse = task_inertia_inverse(inertia, jacobian, gains.singularity, solved)
    stiffness = target[STIFFNESS:STIFFNESS + 36].reshape(6, 6)
    damping, task_inertia = damping_design(stiffness, inverse, target[DAMPING_RATIO])
    _elastic_wrench(pose, target, gains, force)
    for j in range(6):
        rate[j] = target[TWIST + j]
        for i in range(n):
            rate[j] -= jacobian[j, i] * dq[i]
            impulse[j] += solved[i, j] * external[i]
    for j in range(6):
        wrench[j] = 0.0
        for k in range(6):
            force[j] += damping[j, k] * rate[k]
            wrench[j] += task_inertia[j, k] * impulse[k]
    for i in range(n):
        torque[i] = bias[i]
        for j in range(6):
            torque[i] += jacobian[j, i] * force[j]
    if gains.feed_forward > 0.0:
        _add_feed_forward(target, friction, jacobian, solved, task_inertia, torque)
    _add_posture(q, dq, rest, gains, jacobian, solved, task_inertia, torque)
