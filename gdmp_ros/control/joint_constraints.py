"""
What the joints allow of a velocity of the tool.

The joints move with ``M⁻¹ Jᵀ Λ ẋ``. A joint that comes near its limit, and the approach to a
singularity, take away only the component of the velocity that leads there.
"""
from __future__ import annotations

from gdmp_ros.control.impedance import task_inertia_inverse
from gdmp_ros.control.settings import ImpedanceGains
from gdmp_ros.control.singularity import ROTATION_LENGTH, singular_rate, singular_value
from gdmp_ros.kernels import kernel, local_matrix, local_numbers, local_zeros
from gdmp_ros.manifolds.linalg import cholesky, invert_lower

#: The reference keeps the joints this far from their limits [rad], and approaches that posture
#: with this time constant [s].
JOINT_STOP, JOINT_STOP_S = 0.05, 0.25
#: Largest speed with which a joint that is too close is led back [rad/s].
LEAD_BACK = 0.2
#: The same for a singularity, as a share of the approach.
LEAD_BACK_SHARE = 1.5
_EPSILON = ImpedanceGains.singularity


@kernel
def velocity_map(jacobian, inertia, out):
    """``M⁻¹ Jᵀ Λ``: joint velocity for each velocity of the tool, shape (n, 6)."""
    n = inertia.shape[0]
    solved = local_matrix(n, 6)
    inverse, half = local_matrix(6, 6), local_numbers(6)
    task_inertia_inverse(inertia, jacobian, _EPSILON, solved, inverse)
    lower, root = local_numbers(36), local_numbers(36)
    cholesky(6, inverse.reshape(36), lower)
    invert_lower(6, lower, root)
    for i in range(n):
        half[:] = 0.0
        for j in range(6):
            for k in range(j + 1):
                half[j] += root[6 * j + k] * solved[i, k]
        for j in range(6):
            out[i, j] = 0.0
            for k in range(j, 6):
                out[i, j] += root[6 * k + j] * half[k]


@kernel
def _dot(first, second, begin):
    total = 0.0
    for i in range(begin, begin + 3):
        total += first[i] * second[i]
    return total


@kernel
def _change(twist, gradient, amount):
    """Change ``gradient · twist`` by an amount, and the twist as little as possible."""
    square = 0.0
    for j in range(6):
        weight = 1.0 if j < 3 else 1.0 / ROTATION_LENGTH ** 2
        square += weight * gradient[j] ** 2
    if square < 1e-12:
        return
    for j in range(6):
        weight = 1.0 if j < 3 else 1.0 / ROTATION_LENGTH ** 2
        twist[j] += amount / square * weight * gradient[j]


@kernel
def keep_joints(velocities, position, lower, upper, twist):
    """
    Let no joint come closer to its limit than `JOINT_STOP`.

    :param position: of the joints, measured [rad]
    :param twist: changed
    :returns: largest joint velocity that was taken away [rad/s]
    """
    most = 0.0
    # A joint that was corrected may be moved again by the next one.
    for _ in range(3):
        for i in range(position.size):
            speed = 0.0
            for j in range(6):
                speed += velocities[i, j] * twist[j]
            up = max((upper[i] - JOINT_STOP - position[i]) / JOINT_STOP_S, -LEAD_BACK)
            down = min((lower[i] + JOINT_STOP - position[i]) / JOINT_STOP_S, LEAD_BACK)
            excess = max(speed - up, 0.0) + min(speed - down, 0.0)
            if excess != 0.0:
                most = max(most, abs(excess))
                _change(twist, velocities[i], -excess)
    return most


@kernel
def keep_from_singularity(velocities, jacobian, start, stop, twist):
    """
    Slow down the approach to a singularity.

    :param start: singular value below which the approach is slowed down [m]
    :param stop: singular value at which it ends [m]
    :param twist: changed
    :returns: fraction of the approach that was taken away
    """
    n = jacobian.shape[1]
    direction = local_numbers(6)
    value = singular_value(jacobian, direction)
    if value >= start:
        return 0.0
    gradient, unit = local_zeros(6), local_zeros(n)
    for i in range(n):
        unit[i] = 1.0
        slope = singular_rate(jacobian, unit, direction)
        unit[i] = 0.0
        for j in range(6):
            gradient[j] += slope * velocities[i, j]
    linear, angular = _dot(gradient, twist, 0), _dot(gradient, twist, 3)
    rate = linear + angular
    if rate >= 0.0:
        return 0.0
    # Beyond 1 it leads back.
    taken = min(1.0 - (value - stop) / (start - stop), LEAD_BACK_SHARE)
    # Apart: the approach of a translation must not be made good by a rotation.
    share = taken * rate / (min(linear, 0.0) + min(angular, 0.0))
    for first in range(0, 6, 3):
        part, square = _dot(gradient, twist, first), _dot(gradient, gradient, first)
        if part < 0.0 and square > 1e-12:
            for j in range(first, first + 3):
                twist[j] -= share * part / square * gradient[j]
    return taken


@kernel
def keep_joint_speeds(velocities, fastest, twist):
    """
    Scale a twist so that no joint is faster than allowed.

    :param fastest: allowed for each joint [rad/s]
    :param twist: changed
    :returns: by how much a joint would have been faster [rad/s]
    """
    share, most = 1.0, 0.0
    for i in range(fastest.size):
        speed = 0.0
        for j in range(6):
            speed += velocities[i, j] * twist[j]
        excess = abs(speed) - fastest[i]
        if excess > 0.0:
            most = max(most, excess)
            share = min(share, fastest[i] / abs(speed))
    for j in range(6):
        twist[j] *= share
    return most
