"""
Reference governor: keeps the reference of the impedance law inside the limits.

The governed reference is a posture of the arm; its pose is that of the tool there. It moves with
the target as long as the limits allow it: what the joints do is the solution of one problem in
each tick, of which all limits are rows (`gdmp_ros.control.limit_rows`). Along a limit it slides:
the position of the tool has priority over its orientation, and that over the posture of the null
space. Limits of speed and acceleration make it slower, but bend no path. After a limit or an
interruption it lags behind, and catches up at a bounded speed.
"""
from __future__ import annotations

import math

from gdmp_ros.control.kinematics import chain_state
from gdmp_ros.control.limit_rows import limit_rows, OTHER_ROWS
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
from gdmp_ros.control.memory import arm_view
from gdmp_ros.control.own_body import body_rows
from gdmp_ros.control.quadratic_program import solve
from gdmp_ros.control.settings import LIMIT_NUMBERS
from gdmp_ros.control.singularity import ROTATION_LENGTH
from gdmp_ros.control.spring import keep_error
from gdmp_ros.control.surroundings import MOST_ROWS, NEARER_M, SLACK, surroundings_rows
from gdmp_ros.control.target import ACCELERATION, POSE, TWIST
from gdmp_ros.kernels import kernel, local_matrix, local_numbers, local_zeros, noinline, records_at
from gdmp_ros.manifolds.linalg import copy_into, limit_norm, norm
from gdmp_ros.manifolds.quaternion import pose_distance, rotation_between

#: Time constant of catching up, unless the catch-up speed limits it [s].
CATCH_UP_S = 0.02
#: The target's acceleration is fed forward as far as it is within this of the mean acceleration of
#: the governed reference: a wrong one would drive the arm [m/s^2, rad/s^2].
LINEAR_MARGIN, ANGULAR_MARGIN = 3.0, 15.0
#: Time constant of that mean [s].
MEAN_S = 0.03
#: Weights of orientation and posture beside that of the position: far enough apart that the
#: important one is hardly disturbed.
ORIENTATION_WEIGHT, POSTURE_WEIGHT = 1e-2 * ROTATION_LENGTH ** 2, 1e-6
#: Weight of the posture while the joints go straight to it.
RETURN_WEIGHT = 1e3
#: Time constant with which the null space approaches its posture [s], and its largest speed
#: [rad/s].
POSTURE_S, POSTURE_SPEED = 1.0, 0.3
#: A reference that makes no way for this time [s], and whose target is where the posture of the
#: null space has the tool, within these distances [m, rad], goes there joint by joint.
RETURN_S, RETURN_DISTANCE, RETURN_ANGLE = 0.2, 0.01, 0.05
#: The reference makes no way if it has less than this share of the velocity that is asked, as a
#: mean over this time [s], while it is this far from its target [m], or one joint is [rad].
NO_WAY, WAY_S, OFF_TARGET, OFF_JOINTS = 0.05, 0.05, 0.002, 0.01
#: References that may make no way stand after this time [s], and go on as fast.
HELD_IN_S = 0.3
#: Part of the tool's speed limit that joints may ask for: before the limit the tool is braked.
TOOL_SPEED_SHARE = 0.9
#: While joints go there, they keep this share of their speed even if the reference moves away
#: from a tool that is held: an arm that leans on something would not leave it otherwise.
LEAST_SHARE = 0.1


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
def _collect_rows(arm, position, pose, jacobian, singular, rows, bounds, ids):
    """
    Write the rows of all limits that may bind; see `gdmp_ros.control.limit_rows.limit_rows`.

    :param singular: whether singular directions are among them
    """
    n, limits = position.size, records_at(arm.limits, 0, 1, LIMIT_NUMBERS)[0]
    count, value = limit_rows(position, pose, jacobian, arm.joint_limits, arm.limits, rows,
                              bounds, ids)
    if not singular and count > 0 and ids[count - 1] == 2 * n + 6:
        count -= 1
    count = body_rows(arm.frames, arm.axes, position, arm.capsules, arm.pairs,
                      0.5 * limits.acceleration, limits.speed, 2 * n + OTHER_ROWS, rows, bounds,
                      ids, count)
    count, arm.scalars.slowed, arm.scalars.clearance, arm.scalars.nearest = surroundings_rows(
        arm.frames, arm.axes, position, arm.capsules, arm.volumes, SLACK,
        0.5 * limits.acceleration, limits.speed, limits.retreat_speed,
        2 * n + OTHER_ROWS + arm.pairs.shape[0], rows, bounds, ids, count)
    if limits.retreat_speed == 0.0:
        arm.scalars.slowed = min(arm.scalars.slowed, arm.scalars.left)
    hold_back_smoothly(arm.scalars)
    return count, value


@kernel
def share_of_way(numbers, rates):
    """
    Share of the speed at which the measured arm comes no nearer to what is around than it may.

    :param rates: velocities of the joints that are wanted [rad/s]
    """
    noinline()
    arm = arm_view(numbers)
    n = rates.size
    limits = records_at(arm.limits, 0, 1, LIMIT_NUMBERS)[0]
    rows = local_matrix(MOST_ROWS, n)
    bounds, ids = local_numbers(MOST_ROWS), local_numbers(MOST_ROWS)
    # As near as a way may come that is accepted.
    count, _, arm.scalars.clearance, arm.scalars.nearest = surroundings_rows(
        arm.frames, arm.axes, arm.position, arm.capsules, arm.volumes, -NEARER_M,
        0.5 * limits.acceleration, limits.speed, 0.0, 0, rows, bounds, ids, 0)
    return _largest_share(rates, rows[:count], bounds[:count])


@kernel
def hold_back_smoothly(s):
    """Let the share of the way that is allowed follow what is permitted."""
    step = s.dt / HELD_IN_S
    s.allowed += min(max(s.permitted - s.allowed, -step), step)


@kernel
def _move_joints(numbers, jacobian, twist, violation):
    """
    Write the joint velocities that bring a twist about, as far as the limits allow it.

    :param jacobian: of the reference
    :param twist: replaced by the one that is reached
    :returns: the limit that takes most away, or -1; and the speed, as a share of what is allowed
    """
    noinline()
    arm = arm_view(numbers)
    n, rates, limits = (arm.position.size, arm.governed_rate,
                        records_at(arm.limits, 0, 1, LIMIT_NUMBERS)[0])
    most = 2 * n + OTHER_ROWS + arm.pairs.shape[0] + MOST_ROWS
    rows, bounds, ids = local_matrix(most, n), local_numbers(most), local_numbers(most)
    hessian, gradient, last = local_matrix(n, n), local_numbers(n), local_numbers(n)
    count, value = _collect_rows(arm, arm.governed, arm.reference[POSE:POSE + 3], jacobian, True,
                                 rows, bounds, ids)
    copy_into(rates, last)
    weight = _approach_posture(arm.scalars, arm.governed, arm.posture, limits, last, rates)
    for i in range(n):
        gradient[i] = weight * rates[i]
        for j in range(i + 1):
            linear, angular = 0.0, 0.0
            for k in range(3):
                linear += jacobian[k, i] * jacobian[k, j]
                angular += jacobian[3 + k, i] * jacobian[3 + k, j]
            hessian[i, j] = linear + ORIENTATION_WEIGHT * angular
            hessian[j, i] = hessian[i, j]
        for k in range(6):
            gradient[i] += (1.0 if k < 3 else ORIENTATION_WEIGHT) * jacobian[k, i] * twist[k]
        hessian[i, i] += weight
    multipliers = local_zeros(most)
    steps = solve(hessian, gradient, rows[:count], bounds[:count], rates, multipliers[:count])
    if steps < 0:
        _slow_down(last, rows[:count], bounds[:count], rates)
    blocking = _strongest(multipliers[:count], ids)
    if arm.scalars.slowed < NO_WAY:
        blocking = 2 * n + OTHER_ROWS + arm.pairs.shape[0] + arm.scalars.nearest
    for i in range(count):
        if ids[i] == 2 * n + 6 and multipliers[i] > 0.0:
            start, stop = limits.singularity_start, limits.singularity_stop
            violation[SINGULARITY] = min((start - value) / (start - stop), 1.0)
    for j in range(6):
        twist[j] = 0.0
        for i in range(n):
            twist[j] += jacobian[j, i] * rates[i]
    fastest, fastest_turn, held = limits.speed, limits.angular_speed, 1.0
    if arm.scalars.returns > 0.0:
        fastest, fastest_turn = limits.catch_up_speed, limits.catch_up_angular_speed
        held = max(LEAST_SHARE,
                   _share_that_keeps_error(arm.pose, arm.reference, arm.gains, twist))
    # At rest the norms are 0.
    share = min(arm.scalars.slowed, arm.scalars.allowed,
                held * fastest / max(norm(3, twist[:3]), 1e-9),
                held * fastest_turn / max(norm(3, twist[3:]), 1e-9))
    for i in range(n):
        excess = abs(rates[i]) - arm.joint_limits[2, i]
        if excess > 0.0:
            violation[JOINT_SPEED] = max(violation[JOINT_SPEED], excess)
            share = min(share, arm.joint_limits[2, i] / abs(rates[i]))
    used = 0.0
    for i in range(n):
        rates[i] *= share
        used = max(used, abs(rates[i]) / arm.joint_limits[2, i])
    for j in range(6):
        twist[j] *= share
    return blocking, max(used, norm(3, twist[:3]) / fastest, norm(3, twist[3:]) / fastest_turn)


@kernel
def keep_joints_inside(numbers, asked, rates):
    """
    Change velocities of the reference of the joints so that it stays within the limits.

    They slide along joint ranges, walls and the own body; where the tool would be too fast all
    joints are slower. Singularities are no limit of joints.

    :param asked: velocities towards the target
    :param rates: those that are possible where the arm is; changed
    :returns: whether they were changed
    """
    noinline()
    arm = arm_view(numbers)
    limits = records_at(arm.limits, 0, 1, LIMIT_NUMBERS)[0]
    n, s, place = rates.size, arm.scalars, arm.joint_reference[:rates.size]
    pose, jacobian = local_numbers(7), local_matrix(6, n)
    chain_state(arm.frames, arm.axes, arm.end, place, pose, jacobian)
    most = 2 * n + OTHER_ROWS + arm.pairs.shape[0] + MOST_ROWS
    rows, bounds, ids = local_matrix(most, n), local_numbers(most), local_numbers(most)
    count, _ = _collect_rows(arm, place, pose[:3], jacobian, False, rows, bounds, ids)
    hessian, multipliers, kept = local_matrix(n, n), local_zeros(most), local_numbers(n)
    for i in range(n):
        for j in range(n):
            hessian[i, j] = 1.0 if i == j else 0.0
    if solve(hessian, rates, rows[:count], bounds[:count], kept, multipliers[:count]) < 0:
        kept[:] = 0.0
    blocking = _strongest(multipliers[:count], ids)
    moving = local_numbers(3)
    for j in range(3):
        moving[j] = 0.0
        for i in range(n):
            moving[j] += jacobian[j, i] * kept[i]
    fastest = min(limits.speed, TOOL_SPEED_SHARE * limits.tool_speed)
    share = min(s.slowed, s.allowed, fastest / max(norm(3, moving), 1e-9))
    away, changed = 0.0, False
    for i in range(n):
        kept[i] *= share
        changed = changed or abs(kept[i] - rates[i]) > 1e-12
        rates[i] = kept[i]
        away = max(away, abs(arm.joint_target[i] - place[i]))
    _notice_block(s, _progress(asked, rates), away > OFF_JOINTS, blocking)
    return changed


@kernel
def _strongest(multipliers, ids):
    """The limit that takes most away, or -1."""
    strongest, blocking = 0.0, -1.0
    for i in range(multipliers.size):
        if multipliers[i] > strongest:
            strongest, blocking = multipliers[i], ids[i]
    return blocking


@kernel
def _approach_posture(s, position, posture, limits, last, rates):
    """
    Write the joint velocities that lead to the posture.

    :param last: velocities of the last tick
    :returns: their weight
    """
    n, furthest = position.size, 0.0
    if s.returns == 0.0:
        for i in range(n):
            rest = (posture[i] - position[i]) / POSTURE_S
            rates[i] = min(max(rest, -POSTURE_SPEED), POSTURE_SPEED)
        return POSTURE_WEIGHT
    for i in range(n):
        furthest = max(furthest, abs(posture[i] - position[i]))
    # All joints arrive together.
    change = limits.joint_acceleration * s.dt
    speed = min(math.sqrt(limits.joint_acceleration * furthest), furthest / CATCH_UP_S)
    for i in range(n):
        wanted = speed / max(furthest, 1e-12) * (posture[i] - position[i])
        rates[i] = min(max(wanted, last[i] - change), last[i] + change)
    return RETURN_WEIGHT


@kernel
def _progress(asked, made):
    """Return the share of an asked velocity that is made."""
    size, along = 0.0, 0.0
    for i in range(asked.size):
        size += asked[i] ** 2
        along += asked[i] * made[i]
    return along / size if size > 0.0 else 1.0


@kernel
def _share_that_keeps_error(pose, reference, gains, twist):
    """Return the part of a twist that leads a reference no further away from a tool that stays."""
    removed, share = local_numbers(6), 1.0
    copy_into(twist, removed)
    keep_error(pose, reference, gains, removed)
    for first in (0, 3):
        size, along = 0.0, 0.0
        for i in range(first, first + 3):
            removed[i] = twist[i] - removed[i]
            size += removed[i] ** 2
            along += removed[i] * twist[i]
        if along > 0.0:
            share = min(share, 1.0 - size / along)
    return max(share, 0.0)


@kernel
def _decide_return(numbers):
    """
    Decide whether the joints go straight to the posture.

    They do if the target is there, and a limit leaves no other way.
    """
    arm = arm_view(numbers)
    s, pose = arm.scalars, local_numbers(7)
    if s.returns == 0.0 and (s.blocked < RETURN_S or s.blocking < 0.0):
        return
    chain_state(arm.frames, arm.axes, arm.end, arm.posture, pose,
                local_matrix(6, arm.position.size))
    distance, angle = pose_distance(pose, arm.target[POSE:POSE + 7])
    there = True
    for i in range(arm.position.size):
        there = there and abs(arm.posture[i] - arm.governed[i]) < 1e-4
    s.returns = 1.0 if distance < RETURN_DISTANCE and angle < RETURN_ANGLE and not there else 0.0


@kernel
def _slow_down(last, rows, bounds, rates):
    """
    No velocity was found: the largest part of the last one that satisfies all rows.

    Where one asks to go away from something, and another is in the way, it stands.
    """
    share = _largest_share(last, rows, bounds)
    for k in range(last.size):
        rates[k] = share * last[k]


@kernel
def _largest_share(rates, rows, bounds):
    """Largest part of velocities that satisfies all rows; 0 where one asks to go away."""
    share = 1.0
    for i in range(bounds.size):
        speed = 0.0
        for k in range(rates.size):
            speed += rows[i, k] * rates[k]
        if speed > max(bounds[i], 0.0):
            share = min(share, max(bounds[i], 0.0) / speed)
    return share


@kernel
def _notice_block(s, way, away, blocking):
    """
    Count the time for which the reference makes no way although it is off its target.

    :param way: share of the velocity that is asked which it has; joint by joint, of that which
        is allowed
    :param away: whether it is off its target
    """
    s.way += min(s.dt / WAY_S, 1.0) * (way - s.way)
    if not away:
        s.way = 1.0
    if s.way < NO_WAY:
        s.blocked += s.dt
        if blocking >= 0.0:
            s.blocking = blocking
    else:
        s.blocked, s.blocking = 0.0, -1.0


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
def _wanted_velocity(reference, target, limits, dt, velocity, lag, violation):
    """Velocity of the target plus that which reduces the lag, before the speed limits."""
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
def govern(numbers):
    """
    Write the velocities of the governed reference for the next tick, and its acceleration.

    It is moved later, as far as there is energy (`gdmp_ros.control.energy_budget`).

    :param numbers: memory (`gdmp_ros.control.memory`), with the target of the guard, whose
        position is moved into the workspace, and the posture that the null space approaches
    """
    noinline()
    arm = arm_view(numbers)
    reference, target, violation, dt = arm.reference, arm.target, arm.violation, arm.scalars.dt
    limits = records_at(arm.limits, 0, 1, LIMIT_NUMBERS)[0]
    n, mean, last, wish = arm.position.size, arm.past[0], arm.past[1], arm.past[2]
    velocity, change, asked, lag = (local_numbers(6), local_numbers(6), local_numbers(6),
                                    local_numbers(6))
    jacobian = local_matrix(6, n)
    chain_state(arm.frames, arm.axes, arm.end, arm.governed, reference[POSE:POSE + 7], jacobian)
    _wanted_velocity(reference, target, limits, dt, velocity, lag, violation)
    violation[SPEED] = limit_norm(3, velocity[:3], limits.speed)
    violation[ANGULAR_SPEED] = limit_norm(3, velocity[3:], limits.angular_speed)
    copy_into(velocity, asked)
    keep_error(arm.pose, reference, arm.gains, velocity)
    violation[ACCELERATION_LIMIT], violation[JERK] = _accelerate(
        velocity, wish, last, 0, limits.acceleration, limits.jerk, dt, change)
    violation[ANGULAR_ACCELERATION], violation[ANGULAR_JERK] = _accelerate(
        velocity, wish, last, 3, limits.angular_acceleration, limits.angular_jerk, dt, change)
    for i in range(6):
        last[i] = -wish[i] / dt
        wish[i] += dt * change[i]
    limit_norm(3, wish[:3], limits.speed)
    limit_norm(3, wish[3:], limits.angular_speed)
    for i in range(6):
        last[i] += wish[i] / dt
        velocity[i] = wish[i]
    _decide_return(numbers)
    blocking, way = _move_joints(numbers, jacobian, velocity, violation)
    if arm.scalars.returns == 0.0:
        # Beside a velocity, an angular velocity counts as that of a point at this distance.
        for i in range(3, 6):
            asked[i] *= ROTATION_LENGTH
            change[i] = ROTATION_LENGTH * velocity[i]
        copy_into(velocity[:3], change[:3])
        way = _progress(asked, change)
    away = math.hypot(norm(3, lag[:3]), ROTATION_LENGTH * norm(3, lag[3:])) > OFF_TARGET
    _notice_block(arm.scalars, way, away, blocking)
    for i in range(6):
        mean[i] += dt / MEAN_S * ((velocity[i] - reference[TWIST + i]) / dt - mean[i])
        reference[TWIST + i] = velocity[i]
    _feed_forward(reference, mean, target, 0, limits.acceleration, LINEAR_MARGIN)
    _feed_forward(reference, mean, target, 3, limits.angular_acceleration, ANGULAR_MARGIN)
    if blocking >= 0.0 or _is_limited(violation):
        for i in range(6):
            reference[ACCELERATION + i] = 0.0
