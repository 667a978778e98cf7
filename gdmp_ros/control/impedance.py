"""
Cartesian impedance with a full 6×6 stiffness, [GDMP] eqs. (39), (40).

The wrench is that of a spring with a bounded force (`gdmp_ros.control.spring`), plus damping
designed for the inertia felt at the tool, plus the inertial force of the reference motion.
"""
from __future__ import annotations

import math

import numpy as np

from gdmp_ros.control.friction import friction_torque, rest_scale
from gdmp_ros.control.settings import GAIN_NUMBERS
from gdmp_ros.control.spring import spring_wrench
from gdmp_ros.control.target import ACCELERATION, DAMPING_RATIO, STIFFNESS, TWIST, WRENCH
from gdmp_ros.kernels import (
    allocating,
    kernel,
    local_matrix,
    local_numbers,
    local_zeros,
    matrix_at,
    records_at,
    vector_at,
)
from gdmp_ros.manifolds.linalg import (
    cholesky,
    invert_lower,
    multiply,
    norm,
    transposed_multiply,
)
from gdmp_ros.manifolds.spectral import symmetric_eigen

#: A tool is braked this much below its speed limit [m/s], or at half of it, because the torque
#: cannot change at once; with this damping [N s/m].
SPEED_MARGIN, TOOL_BRAKE = 0.15, 200.0


@kernel
def task_inertia_inverse(inertia, jacobian, singularity, solved, result):
    """
    Write ``M⁻¹ Jᵀ`` into ``solved`` (n×6), and ``A = J M⁻¹ Jᵀ + ε² I`` into ``result`` (6×6).
    """
    n = inertia.shape[0]
    lower, inverse = local_numbers(n * n), local_numbers(n * n)
    cholesky(n, vector_at(inertia, 0, n * n), lower)
    invert_lower(n, lower, inverse)
    half = local_matrix(n, 6)
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
    for i in range(6):
        for j in range(i + 1):
            total = singularity * singularity if i == j else 0.0
            for k in range(n):
                total += half[k, i] * half[k, j]
            result[i, j] = total
            result[j, i] = total


@allocating
def damping_design(stiffness, inertia_inverse, damping_ratio):
    """
    As `design_damping`.

    :returns: D and Λ, shape (m, m) each
    """
    m = stiffness.shape[0]
    damping, inertia = np.empty((m, m)), np.empty((m, m))
    design_damping(stiffness, inertia_inverse, damping_ratio, damping, inertia)
    return damping, inertia


@kernel
def design_damping(stiffness, inertia_inverse, damping_ratio, damping, inertia):
    """
    Damping by double diagonalisation, and the task inertia Λ.

    With ``Λ = Q Qᵀ`` and ``K = Q diag(k) Qᵀ`` the damping is ``D = 2 ζ Q diag(√k) Qᵀ``: every mode
    of ``Λ ẍ + D ẋ + K x = 0`` has the damping ratio ζ.

    :param stiffness: K, shape (m, m), positive definite
    :param inertia_inverse: Λ⁻¹, shape (m, m)
    :param damping: result D, shape (m, m)
    :param inertia: result Λ, shape (m, m)
    """
    m = stiffness.shape[0]
    lower, inverse = local_numbers(m * m), local_numbers(m * m)
    work, rotated = local_numbers(m * m), local_numbers(m * m)
    cholesky(m, vector_at(inertia_inverse, 0, m * m), lower)
    invert_lower(m, lower, inverse)
    multiply(m, vector_at(stiffness, 0, m * m), lower, work)
    transposed_multiply(m, lower, work, rotated)
    values, vectors = local_numbers(m), local_numbers(m * m)
    symmetric_eigen(m, rotated, values, vectors, work)
    # Rows of V L⁻¹ are the columns of Q.
    multiply(m, vectors, inverse, work)
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


@kernel
def _limit_wrench(wrench, largest):
    """Scale a wrench as a whole; return the factor."""
    scale = 1.0
    for part in range(2):
        size = norm(3, wrench[3 * part:3 * part + 3])
        if size > largest[part]:
            scale = min(scale, largest[part] / size)
    for i in range(6):
        wrench[i] *= scale
    return scale


@kernel
def _limit_tool_speed(jacobian, dq, largest, force):
    """Reduce what drives a tool that is too fast, and brake it; return the excess [m/s]."""
    velocity, along = local_zeros(3), 0.0
    for i in range(3):
        for j in range(dq.size):
            velocity[i] += jacobian[i, j] * dq[j]
    speed, slow = norm(3, velocity), max(largest - SPEED_MARGIN, 0.5 * largest)
    excess = speed - slow
    if excess <= 0.0:
        return 0.0
    for i in range(3):
        along += force[i] * velocity[i] / speed
    left = along * max(1.0 - excess / (largest - slow), 0.0) if along > 0.0 else along
    for i in range(3):
        force[i] += (left - along - TOOL_BRAKE * excess) * velocity[i] / speed
    return excess


@kernel
def _add_posture(q, dq, rest, rate, gains, jacobian, solved, task_inertia, torque):
    """Add the posture torque projected to the null space: ``(I - Jᵀ Λ J M⁻¹) τ``."""
    n = q.size
    posture, task = local_numbers(n), local_zeros(6)
    for i in range(n):
        posture[i] = (gains.posture_stiffness * (rest[i] - q[i])
                      + gains.posture_damping * (rate[i] - dq[i]))
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
def _add_friction(target, rates, friction, gains, pull, jacobian, inertia, torque):
    """
    Add the joint friction (`friction_torque`).

    :param rates: velocities of the joints that follow the target [rad/s]
    :param friction: viscous [Nm s/rad] and dry [Nm], shape (2, n)
    :param pull: torque of the springs at tool and posture [Nm]
    """
    for i in range(torque.size):
        stiffness = gains.posture_stiffness
        for j in range(6):
            for k in range(6):
                stiffness += jacobian[j, i] * target[STIFFNESS + 6 * j + k] * jacobian[k, i]
        scale = rest_scale(friction[1, i], gains.friction_at_rest, stiffness, inertia[i, i],
                           target[DAMPING_RATIO])
        torque[i] += friction_torque(friction[0, i], friction[1, i], rates[i], pull[i],
                                     gains.friction_smoothing, gains.friction_at_rest, scale)


@kernel
def external_wrench(jacobian, inertia, external, singularity, wrench):
    """
    Write the wrench at the tool that explains external joint torques: ``Λ J M⁻¹ τ_ext``.

    :param external: external joint torque [Nm], shape (n,)
    :param wrench: written [N, Nm], shape (6,)
    """
    n = external.size
    solved, inverse = local_matrix(n, 6), local_matrix(6, 6)
    lower, lower_inverse, work = local_numbers(36), local_numbers(36), local_numbers(6)
    task_inertia_inverse(inertia, jacobian, singularity, solved, inverse)
    cholesky(6, vector_at(inverse, 0, 36), lower)
    invert_lower(6, lower, lower_inverse)
    for j in range(6):
        work[j] = 0.0
        for k in range(j + 1):
            total = 0.0
            for i in range(n):
                total += solved[i, k] * external[i]
            work[j] += lower_inverse[6 * j + k] * total
    for j in range(6):
        wrench[j] = 0.0
        for k in range(j, 6):
            wrench[j] += lower_inverse[6 * k + j] * work[k]


@kernel
def impedance_torque(q, dq, pose, jacobian, inertia, bias, friction, target, joints, rates,
                     gain_numbers, tool_speed, external, torque, wrench, force):
    """
    Compute the joint torque of one tick.

    :param pose: measured (x, y, z, qw, qx, qy, qz)
    :param friction: of the joints, viscous [Nm s/rad] and dry [Nm], shape (2, n)
    :param target: `TARGET_SIZE` numbers: pose, twist, acceleration, 6×6 stiffness, damping ratio
    :param joints: positions of the joints with which the tool is at the target [rad]
    :param rates: their velocities [rad/s]
    :param gain_numbers: `ImpedanceGains` as numbers
    :param tool_speed: speed limit of the tool [m/s]
    :param external: external joint torque [Nm]
    :param torque: result [Nm], shape (n,): impedance + posture + gravity and Coriolis
    :param wrench: result, external wrench at the tool [N, Nm], shape (6,)
    :param force: result, commanded wrench at the tool [N, Nm], shape (6,)
    :returns: factor by which the commanded wrench was reduced to its limit, and by how much the
        tool is too fast [m/s]
    """
    gains = records_at(gain_numbers, 0, 1, GAIN_NUMBERS)[0]
    n = q.size
    solved, rate, impulse = local_matrix(n, 6), local_numbers(6), local_zeros(6)
    inverse, damping, task_inertia = local_matrix(6, 6), local_matrix(6, 6), local_matrix(6, 6)
    task_inertia_inverse(inertia, jacobian, gains.singularity, solved, inverse)
    stiffness = matrix_at(target, STIFFNESS, 6, 6)
    design_damping(stiffness, inverse, target[DAMPING_RATIO], damping, task_inertia)
    spring_wrench(pose, target, gain_numbers, force)
    pull = local_zeros(n)
    for i in range(n):
        for j in range(6):
            pull[i] += jacobian[j, i] * force[j]
    for j in range(6):
        rate[j] = target[TWIST + j]
        for i in range(n):
            rate[j] -= jacobian[j, i] * dq[i]
            impulse[j] += solved[i, j] * external[i]
    for j in range(6):
        wrench[j] = 0.0
        force[j] += target[WRENCH + j]
        for k in range(6):
            force[j] += damping[j, k] * rate[k]
            if gains.feed_forward > 0.0:
                force[j] += task_inertia[j, k] * target[ACCELERATION + k]
            wrench[j] += task_inertia[j, k] * impulse[k]
    too_fast = _limit_tool_speed(jacobian, dq, tool_speed, force)
    scale = _limit_wrench(force, gains.wrench_max)
    for i in range(n):
        torque[i] = bias[i]
        for j in range(6):
            torque[i] += jacobian[j, i] * force[j]
        pull[i] -= torque[i]
    _add_posture(q, dq, joints, rates, gains, jacobian, solved, task_inertia, torque)
    if gains.feed_forward > 0.0:
        for i in range(n):
            pull[i] += torque[i]
        _add_friction(target, rates, friction, gains, pull, jacobian, inertia, torque)
    return scale, too_fast
