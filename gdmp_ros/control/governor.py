"""
Reference governor: keeps the reference of the impedance law inside the limits.

The governed reference moves with the target as long as that stays inside the limits. After a limit
or an interruption it lags behind, and catches up at a bounded speed.
"""
from __future__ import annotations

import math

import numpy as np

from gdmp_ros.control.impedance import task_inertia_inverse
from gdmp_ros.control.limits import (
    ACCELERATION_LIMIT,
    ANGULAR_ACCELERATION,
    ANGULAR_SPEED,
    JOINT_SPEED,
    SINGULARITY,
    SPEED,
    WORKSPACE,
)
from gdmp_ros.control.settings import ImpedanceGains, LIMIT_NUMBERS
from gdmp_ros.control.singularity import singular_rate, singular_value
from gdmp_ros.control.target import ACCELERATION, POSE, TWIST
from gdmp_ros.control.torque_limits import SPEED_MARGIN
from gdmp_ros.kernels import kernel, records_at
from gdmp_ros.manifolds.linalg import cholesky, invert_lower, limit_norm, norm
from gdmp_ros.manifolds.quaternion import rotation_between

#: Time constant of catching up, unless the catch-up speed limits it [s].
CATCH_UP_S = 0.02
#: The target's acceleration is fed forward as far as it is within this of the mean acceleration of
#: the governed reference: a wrong one would drive the arm [m/s^2, rad/s^2].
LINEAR_MARGIN, ANGULAR_MARGIN = 3.0, 15.0
#: Time constant of that mean [s].
MEAN_S = 0.03
_EPSILON = ImpedanceGains.singularity


@kernel
def _move_into_workspace(position, velocity, limits):
    """Move a position to the nearest one inside, and return how far outside it was."""
    outside = 0.0
    for i in range(3):
        inside = min(max(position[i], limits.workspace_min[i]), limits.workspace_max[i])
        if inside != position[i]:
            outside += (position[i] - inside) ** 2
            position[i] = inside
            velocity[i] = 0.0
    return math.sqrt(outside)


@kernel
def _catch_up(lag, deceleration, fastest, velocity):
    """Add the velocity that closes a lag without overshoot."""
    distance = norm(3, lag)
    if distance < 1e-12:
        return
    speed = min(distance / CATCH_UP_S, fastest, math.sqrt(2.0 * deceleration * distance))
    for i in range(3):
        velocity[i] += speed / distance * lag[i]


@kernel
def _brake_at_walls(position, velocity, limits):
    """Slow down so that the acceleration limit allows to stop at a wall of the workspace."""
    for i in range(3):
        above = max(limits.workspace_max[i] - position[i], 0.0)
        below = max(position[i] - limits.workspace_min[i], 0.0)
        velocity[i] = min(velocity[i], math.sqrt(limits.acceleration * above))
        velocity[i] = max(velocity[i], -math.sqrt(limits.acceleration * below))


@kernel
def _joint_velocity(jacobian, inertia, twist, out):
    """``M⁻¹ Jᵀ Λ ẋ``: the joint velocity that belongs to a twist."""
    n = inertia.shape[0]
    solved = np.empty((n, 6))
    inverse = task_inertia_inverse(inertia, jacobian, _EPSILON, solved)
    lower, lower_inverse = np.empty(36), np.empty(36)
    cholesky(6, inverse.reshape(36), lower)
    invert_lower(6, lower, lower_inverse)
    half, force = np.zeros(6), np.zeros(6)
    for i in range(6):
        for j in range(i + 1):
            half[i] += lower_inverse[6 * i + j] * twist[j]
    for i in range(6):
        for j in range(i, 6):
            force[i] += lower_inverse[6 * j + i] * half[j]
    for i in range(n):
        out[i] = 0.0
        for j in range(6):
            out[i] += solved[i, j] * force[j]


@kernel
def _slow_down(velocity, jacobian, inertia, limits, violation):
    """Scale a twist for the joint speed limit, and on the way to a singularity."""
    n = inertia.shape[0]
    joints, direction = np.empty(n), np.empty(6)
    _joint_velocity(jacobian, inertia, velocity, joints)
    fastest = 0.0
    for i in range(n):
        fastest = max(fastest, abs(joints[i]))
    scale, allowed = 1.0, SPEED_MARGIN * limits.joint_speed
    if fastest > allowed:
        violation[JOINT_SPEED] = fastest - allowed
        scale = allowed / fastest
    value = singular_value(jacobian, direction)
    if value < limits.singularity_start and singular_rate(jacobian, joints, direction) < 0.0:
        left = ((value - limits.singularity_stop)
                / (limits.singularity_start - limits.singularity_stop))
        left = max(left, 0.0)
        violation[SINGULARITY] = 1.0 - left
        scale = min(scale, left)
    for i in range(6):
        velocity[i] *= scale


@kernel
def _feed_forward(reference, mean, target, first, limit, margin):
    """Write the feed-forward: the target's acceleration, near the mean of the reference's."""
    deviation = np.empty(3)
    for i in range(3):
        deviation[i] = target[ACCELERATION + first + i] - mean[first + i]
    limit_norm(3, deviation, margin)
    for i in range(3):
        deviation[i] += mean[first + i]
    limit_norm(3, deviation, limit)
    for i in range(3):
        reference[ACCELERATION + first + i] = deviation[i]


@kernel
def _is_limited(violation):
    return (violation[WORKSPACE] > 0.0 or violation[SPEED] > 0.0
            or violation[ANGULAR_SPEED] > 0.0 or violation[ACCELERATION_LIMIT] > 0.0
            or violation[ANGULAR_ACCELERATION] > 0.0 or violation[JOINT_SPEED] > 0.0
            or violation[SINGULARITY] > 0.0)


@kernel
def _wanted_velocity(reference, target, limits, dt, velocity, violation):
    """Velocity of the target plus that which reduces the lag, before the speed limits."""
    lag = np.empty(6)
    for i in range(6):
        velocity[i] = target[TWIST + i] - 0.5 * dt * target[ACCELERATION + i]
    violation[WORKSPACE] = _move_into_workspace(target[POSE:POSE + 3], velocity, limits)
    rotation_between(reference[POSE + 3:POSE + 7], target[POSE + 3:POSE + 7], lag[3:])
    for i in range(3):
        lag[i] = target[POSE + i] - reference[POSE + i]
    for i in range(6):
        lag[i] -= dt * velocity[i]
    _catch_up(lag[:3], 0.5 * limits.acceleration, limits.catch_up_speed, velocity[:3])
    _catch_up(lag[3:], 0.5 * limits.angular_acceleration, limits.catch_up_angular_speed,
              velocity[3:])


@kernel
def govern(reference, mean, target, jacobian, inertia, limit_numbers, dt, violation):
    """
    Write the twist and the acceleration of the governed reference for the next tick.

    Its pose is moved later, as far as there is energy (`gdmp_ros.control.energy_budget`).

    :param reference: the governed reference, `TARGET_SIZE` numbers
    :param mean: its mean acceleration, shape (6,); changed
    :param target: what the guard gives; its position is moved into the workspace
    :param limit_numbers: `LimitSettings` as numbers
    :param violation: written: by how much each limit was exceeded
    """
    limits = records_at(limit_numbers, 0, 1, LIMIT_NUMBERS)[0]
    velocity, change = np.empty(6), np.empty(6)
    _wanted_velocity(reference, target, limits, dt, velocity, violation)
    _slow_down(velocity, jacobian, inertia, limits, violation)
    _brake_at_walls(reference, velocity, limits)
    violation[SPEED] = limit_norm(3, velocity[:3], limits.speed)
    violation[ANGULAR_SPEED] = limit_norm(3, velocity[3:], limits.angular_speed)
    for i in range(6):
        change[i] = (velocity[i] - reference[TWIST + i]) / dt
    violation[ACCELERATION_LIMIT] = limit_norm(3, change[:3], limits.acceleration)
    violation[ANGULAR_ACCELERATION] = limit_norm(3, change[3:], limits.angular_acceleration)
    for i in range(6):
        reference[TWIST + i] += dt * change[i]
        mean[i] += dt / MEAN_S * (change[i] - mean[i])
    _feed_forward(reference, mean, target, 0, limits.acceleration, LINEAR_MARGIN)
    _feed_forward(reference, mean, target, 3, limits.angular_acceleration, ANGULAR_MARGIN)
    if _is_limited(violation):
        for i in range(6):
            reference[ACCELERATION + i] = 0.0
