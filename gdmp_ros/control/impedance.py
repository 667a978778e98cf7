"""
Cartesian impedance with a full 6×6 stiffness, [GDMP] eqs. (39), (40).

The wrench is the gradient of ``½ eᵀ K e`` with e the clipped position error and rotation vector of
the orientation error (base frame), plus damping designed for the inertia felt at the tool.
"""
from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np

from gdmp_ros.compilation import compiled
from gdmp_ros.manifolds.linalg import (
    cholesky,
    invert_lower,
    multiply,
    transposed_multiply,
)
from gdmp_ros.manifolds.spectral import symmetric_eigen


@dataclass(frozen=True)
class ImpedanceGains:
    """
    Constants of the law.

    :ivar singularity: ε in ``Λ = (J M⁻¹ Jᵀ + ε² I)⁻¹`` [1/√kg]: keeps it finite at singularities
    :ivar position_clip: largest position error acted upon [m]
    :ivar rotation_clip: largest rotation error acted upon [rad]
    :ivar posture_stiffness: of the null-space posture [Nm/rad]
    :ivar posture_damping: in the null space [Nm s/rad]
    :ivar feed_forward: 1 adds what the reference itself costs, the inertial force ``Λ ẍ_d`` and
        the viscous friction of the joints at its velocity; 0 does not
    """

    singularity: float = 0.02
    position_clip: float = 0.1
    rotation_clip: float = 0.5
    posture_stiffness: float = 5.0
    posture_damping: float = 2.0
    feed_forward: float = 1.0

    def array(self) -> np.ndarray:
        """Return the numbers as the kernel takes them."""
        return np.array([self.singularity, self.position_clip, self.rotation_clip,
                         self.posture_stiffness, self.posture_damping, self.feed_forward])


(_SINGULARITY, _POSITION_CLIP, _ROTATION_CLIP, _POSTURE_STIFFNESS, _POSTURE_DAMPING,
 _FEED_FORWARD) = range(6)
# Where the numbers of a target lie: `Target.array`.
POSE, TWIST, ACCELERATION, STIFFNESS, DAMPING_RATIO = 0, 7, 13, 19, 55
TARGET_SIZE = 56


@compiled
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


@compiled
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
    lower, inverse, work, turned = (np.empty(m * m), np.empty(m * m), np.empty(m * m),
                                    np.empty(m * m))
    cholesky(m, inertia_inverse.reshape(m * m), lower)
    invert_lower(m, lower, inverse)
    multiply(m, stiffness.reshape(m * m), lower, work)
    transposed_multiply(m, lower, work, turned)
    values, vectors = np.empty(m), np.empty(m * m)
    symmetric_eigen(m, turned, values, vectors, work)
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


@compiled
def rotation_error(measured, wanted, out):
    """
    Rotation vector from the measured to the wanted quaternion (wxyz), in the base frame [rad].

    The shorter way round: the sign of the measured quaternion is chosen first.
    """
    dot = 0.0
    for i in range(4):
        dot += measured[i] * wanted[i]
    sign = 1.0 if dot >= 0.0 else -1.0
    w, x, y, z = (sign * measured[0], sign * measured[1], sign * measured[2], sign * measured[3])
    a, b, c, d = wanted[0], wanted[1], wanted[2], wanted[3]
    vx = -a * x + b * w - c * z + d * y
    vy = -a * y + b * z + c * w - d * x
    vz = -a * z - b * y + c * x + d * w
    norm = math.sqrt(vx * vx + vy * vy + vz * vz)
    real = a * w + b * x + c * y + d * z
    scale = 2.0 * math.atan2(norm, real) / norm if norm > 1e-12 else 2.0
    out[0], out[1], out[2] = scale * vx, scale * vy, scale * vz


@compiled
def clip_norm(v, limit):
    """Shorten ``v`` to ``limit``."""
    total = 0.0
    for i in range(v.size):
        total += v[i] * v[i]
    norm = math.sqrt(total)
    if norm > limit:
        for i in range(v.size):
            v[i] *= limit / norm


@compiled
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


@compiled
def _elastic_wrench(pose, target, gains, stiffness):
    error = np.empty(6)
    for i in range(3):
        error[i] = target[POSE + i] - pose[i]
    rotation_error(pose[3:7], target[POSE + 3:POSE + 7], error[3:])
    clip_norm(error[:3], gains[_POSITION_CLIP])
    clip_norm(error[3:], gains[_ROTATION_CLIP])
    wrench = np.empty(6)
    for i in range(6):
        total = 0.0
        for j in range(6):
            total += stiffness[i, j] * error[j]
        wrench[i] = total
    left_jacobian_inverse(error[3:], wrench[3:].copy(), wrench[3:])
    return wrench


@compiled
def _posture(q, dq, rest, gains, jacobian, solved, task_inertia, torque):
    """Add the posture torque projected to the null space: ``(I - Jᵀ Λ J M⁻¹) τ``."""
    n = q.size
    wanted, task = np.empty(n), np.zeros(6)
    for i in range(n):
        wanted[i] = gains[_POSTURE_STIFFNESS] * (rest[i] - q[i]) - gains[_POSTURE_DAMPING] * dq[i]
    for j in range(6):
        for i in range(n):
            task[j] += solved[i, j] * wanted[i]
    for i in range(n):
        total = wanted[i]
        for j in range(6):
            for k in range(6):
                total -= jacobian[j, i] * task_inertia[j, k] * task[k]
        torque[i] += total


@compiled
def _feed_forward(target, gains, friction, jacobian, solved, task_inertia, torque):
    """
    Add ``Jᵀ Λ ẍ_d`` and the friction of the joint velocities ``M⁻¹ Jᵀ Λ ẋ_d``.

    At the reference's velocity, not at the measured one: no energy is fed into a measured motion.
    """
    for j in range(6):
        push, flow = 0.0, 0.0
        for k in range(6):
            push += task_inertia[j, k] * target[ACCELERATION + k]
            flow += task_inertia[j, k] * target[TWIST + k]
        for i in range(torque.size):
            torque[i] += gains[_FEED_FORWARD] * (jacobian[j, i] * push
                                                 + friction[i] * solved[i, j] * flow)


def felt_wrench(jacobian: np.ndarray, inertia: np.ndarray, external: np.ndarray,
                singularity: float) -> np.ndarray:
    """
    Wrench at the tool that explains joint torques from outside: ``Λ J M⁻¹ τ_ext`` [N, Nm].

    :param external: joint torque acting from outside [Nm], shape (n,)
    """
    solved = np.empty((len(external), 6))
    inverse = task_inertia_inverse(inertia, jacobian, singularity, solved)
    return np.asarray(np.linalg.solve(inverse, solved.T @ external))


@compiled
def impedance_torque(q, dq, pose, jacobian, inertia, bias, friction, target, rest, gains, external,
                     torque, wrench):
    """
    One tick of the law.

    :param pose: measured (x, y, z, qw, qx, qy, qz)
    :param friction: viscous, of the joints [Nm s/rad], shape (n,)
    :param target: `TARGET_SIZE` numbers: pose, twist, acceleration, 6×6 stiffness, damping ratio
    :param rest: posture of the null space [rad]
    :param external: joint torque acting from outside [Nm]
    :param torque: result [Nm], shape (n,): impedance + posture + gravity and Coriolis
    :param wrench: result, external wrench at the tool [N, Nm], shape (6,)
    """
    n = q.size
    stiffness = target[STIFFNESS:STIFFNESS + 36].reshape(6, 6)
    solved = np.empty((n, 6))
    inverse = task_inertia_inverse(inertia, jacobian, gains[_SINGULARITY], solved)
    damping, task_inertia = damping_design(stiffness, inverse, target[DAMPING_RATIO])
    force = _elastic_wrench(pose, target, gains, stiffness)
    felt = np.zeros(6)
    rate = np.empty(6)
    for j in range(6):
        rate[j] = target[TWIST + j]
        for i in range(n):
            rate[j] -= jacobian[j, i] * dq[i]
            felt[j] += solved[i, j] * external[i]
    for j in range(6):
        total = force[j]
        wrench[j] = 0.0
        for k in range(6):
            total += damping[j, k] * rate[k]
            wrench[j] += task_inertia[j, k] * felt[k]
        force[j] = total
    for i in range(n):
        torque[i] = bias[i]
        for j in range(6):
            torque[i] += jacobian[j, i] * force[j]
    _feed_forward(target, gains, friction, jacobian, solved, task_inertia, torque)
    _posture(q, dq, rest, gains, jacobian, solved, task_inertia, torque)
