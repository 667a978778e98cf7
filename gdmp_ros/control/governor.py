"""
Reference governor: keeps the reference of the impedance law inside the limits.

The governed reference moves with the target as long as that stays inside the limits. After a limit
or an interruption it lags behind, and catches up at a bounded speed.
"""
from __future__ import annotations

import math

from gdmp_ros.control.joint_constraints import (
    keep_from_singularity,
    keep_joint_speeds,
    keep_joints,
    velocity_map,
)
from gdmp_ros.control.limits import (
    ACCELERATION_LIMIT,
    ANGULAR_ACCELERATION,
    ANGULAR_JERK,
    ANGULAR_SPEED,
    JERK,
    JOINT_SPEED,
    SINGULARITY,
    SPEED,
    WORKSPACE,
)
from gdmp_ros.control.settings import LIMIT_NUMBERS
from gdmp_ros.control.spring import keep_error
from gdmp_ros.control.target import ACCELERATION, POSE, TWIST
from gdmp_ros.kernels import kernel, local_matrix, local_numbers, records_at
from gdmp_ros.manifolds.linalg import limit_norm, norm
from gdmp_ros.manifolds.quaternion import rotation_between

#: Time constant of catching up, unless the catch-up speed limits it [s].
CATCH_UP_S = 0.02
#: The target's acceleration is fed forward as far as it is within this of the mean acceleration of
#: the governed reference: a wrong one would drive the arm [m/s^2, rad/s^2].
LINEAR_MARGIN, ANGULAR_MARGIN = 3.0, 15.0
#: Time constant of that mean [s].
MEAN_S = 0.03


@kernel
def _move_into_workspace(position, velocity, present, limits):
    """
    Move a position to the nearest one inside, and return how far outside it was.

    A workspace that has become smaller leads nothing back: where the reference is beyond a wall,
    it may only go inwards.

    :param present: where the governed reference is
    """
    outside = 0.0
    for i in range(3):
        low, high = limits.workspace_min[i], limits.workspace_max[i]
        outside += max(low - position[i], position[i] - high, 0.0) ** 2
        inside = min(max(position[i], min(low, present[i])), max(high, present[i]))
        if inside != position[i]:
            position[i] = inside
            velocity[i] = 0.0
    return math.sqrt(outside)


@kernel
def catch_up(lag, deceleration, fastest, velocity):
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
def _constrain(reference, velocity, pose, position, jacobian, inertia, joint_limits, gain_numbers,
               limits, violation):
    """Take away what winds up the spring, and what the joints do not allow; scale the rest."""
    velocities = local_matrix(inertia.shape[0], 6)
    velocity_map(jacobian, inertia, velocities)
    keep_error(pose, reference, gain_numbers, velocity)
    taken = keep_from_singularity(velocities, jacobian, limits.singularity_start,
                                  limits.singularity_stop, velocity)
    violation[SINGULARITY] = taken
    stopped = keep_joints(velocities, position, joint_limits[0], joint_limits[1], velocity)
    excess = keep_joint_speeds(velocities, joint_limits[2], velocity)
    violation[JOINT_SPEED] = max(violation[JOINT_SPEED], excess)
    return stopped > 0.0


@kernel
def _accelerate(velocity, present, last, first, limit, jerk, dt, change):
    """
    Write the change of three velocities within limits of acceleration and jerk.

    :param last: change of the last tick
    :returns: by how much acceleration and jerk were exceeded
    """
    for i in range(first, first + 3):
        change[i] = (velocity[i] - present[i]) / dt
    target = norm(3, change[first:first + 3])
    # So that the acceleration, which decreases by one step in every tick, ends at the velocity.
    most = jerk * dt
    limit_norm(3, change[first:first + 3], 0.5 * (math.sqrt(most * (most + 8.0 * target)) - most))
    exceeded = limit_norm(3, change[first:first + 3], limit)
    step = local_numbers(3)
    for i in range(3):
        step[i] = change[first + i] - last[first + i]
    jerked = limit_norm(3, step, most)
    for i in range(3):
        change[first + i] = last[first + i] + step[i]
    return max(exceeded, 0.0), jerked / dt


@kernel
def _feed_forward(reference, mean, target, first, limit, margin):
    """Write the feed-forward: the target's acceleration, near the mean of the reference's."""
    deviation = local_numbers(3)
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
            or violation[SINGULARITY] > 0.0 or violation[JERK] > 0.0
            or violation[ANGULAR_JERK] > 0.0)


@kernel
def _wanted_velocity(reference, target, limits, dt, velocity, violation):
    """Velocity of the target plus that which reduces the lag, before the speed limits."""
    lag = local_numbers(6)
    for i in range(6):
        velocity[i] = target[TWIST + i] - 0.5 * dt * target[ACCELERATION + i]
    violation[WORKSPACE] = _move_into_workspace(target[POSE:POSE + 3], velocity,
                                                 reference[POSE:POSE + 3], limits)
    rotation_between(reference[POSE + 3:POSE + 7], target[POSE + 3:POSE + 7], lag[3:])
    for i in range(3):
        lag[i] = target[POSE + i] - reference[POSE + i]
    for i in range(6):
        lag[i] -= dt * velocity[i]
    catch_up(lag[:3], 0.5 * limits.acceleration, limits.catch_up_speed, velocity[:3])
    catch_up(lag[3:], 0.5 * limits.angular_acceleration, limits.catch_up_angular_speed,
              velocity[3:])


@kernel
def govern(reference, past, target, pose, position, jacobian, inertia, joint_limits, gain_numbers,
           limit_numbers, dt, violation):
    """
    Write the twist and the acceleration of the governed reference for the next tick.

    Its pose is moved later, as far as there is energy (`gdmp_ros.control.energy_budget`).

    :param reference: the governed reference, `TARGET_SIZE` numbers
    :param past: its mean acceleration and its last one, shape (2, 6); changed
    :param target: what the guard gives; its position is moved into the workspace
    :param pose: measured (x, y, z, qw, qx, qy, qz)
    :param position: of the joints, measured [rad]
    :param joint_limits: lowest and highest position [rad], largest speed [rad/s], shape (3, n)
    :param gain_numbers: `ImpedanceGains` as numbers
    :param limit_numbers: `LimitSettings` as numbers
    :param violation: written: by how much each limit was exceeded
    """
    limits = records_at(limit_numbers, 0, 1, LIMIT_NUMBERS)[0]
    velocity, change, mean, last = local_numbers(6), local_numbers(6), past[0], past[1]
    _wanted_velocity(reference, target, limits, dt, velocity, violation)
    stopped = _constrain(reference, velocity, pose, position, jacobian, inertia, joint_limits,
                         gain_numbers, limits, violation)
    _brake_at_walls(reference, velocity, limits)
    violation[SPEED] = limit_norm(3, velocity[:3], limits.speed)
    violation[ANGULAR_SPEED] = limit_norm(3, velocity[3:], limits.angular_speed)
    violation[ACCELERATION_LIMIT], violation[JERK] = _accelerate(
        velocity, reference[TWIST:TWIST + 6], last, 0, limits.acceleration, limits.jerk, dt,
        change)
    violation[ANGULAR_ACCELERATION], violation[ANGULAR_JERK] = _accelerate(
        velocity, reference[TWIST:TWIST + 6], last, 3, limits.angular_acceleration,
        limits.angular_jerk, dt, change)
    for i in range(6):
        last[i] = -reference[TWIST + i] / dt
        reference[TWIST + i] += dt * change[i]
    limit_norm(3, reference[TWIST:TWIST + 3], limits.speed)
    limit_norm(3, reference[TWIST + 3:TWIST + 6], limits.angular_speed)
    for i in range(6):
        last[i] += reference[TWIST + i] / dt
        change[i] = last[i]
        mean[i] += dt / MEAN_S * (change[i] - mean[i])
    _feed_forward(reference, mean, target, 0, limits.acceleration, LINEAR_MARGIN)
    _feed_forward(reference, mean, target, 3, limits.angular_acceleration, ANGULAR_MARGIN)
    if stopped or _is_limited(violation):
        for i in range(6):
            reference[ACCELERATION + i] = 0.0
