"""
Springs of the joints, and a reference that moves within the limits and the energy.

The spring of a joint has the energy ``½ k e²`` up to the error `CLIP`, then ``k CLIP |e| - ½ k
CLIP²``: its torque grows no further, and is still the gradient of the energy.
"""
from __future__ import annotations

import math

from gdmp_ros.control.friction import friction_torque, rest_scale
from gdmp_ros.control.governor import CATCH_UP_S, keep_joints_inside
from gdmp_ros.control.joint_target import LEAST_STIFFNESS
from gdmp_ros.control.limits import ENERGY, JOINT_POSITION, JOINT_SPEED, STIFFNESS_RATE
from gdmp_ros.control.memory import arm_view
from gdmp_ros.control.settings import GAIN_NUMBERS, LIMIT_NUMBERS
from gdmp_ros.kernels import kernel, local_numbers, noinline, records_at

#: Error beyond which the torque of a spring grows no further [rad].
CLIP = 0.2
#: Speed with which a reference catches up [rad/s].
CATCH_UP = 0.5
#: Time constant of the acceleration of a reference [s].
MEAN_S = 0.005
#: Part of the rate of a torque with which a decreasing stiffness may change it.
FALL_SHARE = 0.5
#: Steps of the bisection for the affordable part of a motion.
_HALVINGS = 20


@kernel
def joint_energy(position, reference):
    """
    Energy in the springs [J].

    :param position: of the joints [rad], shape (n,)
    :param reference: target of the joints, ``3 n + 1`` numbers
    """
    n, total = position.size, 0.0
    for i in range(n):
        error = abs(reference[i] - position[i])
        bent = min(error, CLIP)
        total += reference[2 * n + i] * bent * (error - 0.5 * bent)
    return total


@kernel
def joint_springs(position, reference, torque):
    """Write the torque of the springs [Nm]."""
    n = position.size
    for i in range(n):
        error = reference[i] - position[i]
        torque[i] = reference[2 * n + i] * min(max(error, -CLIP), CLIP)


@kernel
def _govern_joint(i, n, reference, target, limits, acceleration, dt, violation):
    """
    Where one joint of the governed reference would be next, and its velocity, without its range.

    See `move_joint_reference`.
    """
    goal, desired, fastest = target[i], target[n + i], limits[2, i]
    outside = max(limits[0, i] - goal, goal - limits[1, i])
    violation[JOINT_POSITION] = max(violation[JOINT_POSITION], outside)
    q, v = reference[i], reference[n + i]
    change = desired - v
    if (abs(goal - q - dt * (v + 0.5 * change)) <= acceleration * dt * dt
            and abs(desired) <= fastest and abs(change) <= acceleration * dt):
        return goal, desired
    lag = goal - q - dt * desired
    distance = abs(lag)
    speed = min(distance / CATCH_UP_S, CATCH_UP, math.sqrt(acceleration * distance))
    desired += math.copysign(speed, lag)
    if abs(desired) > fastest:
        violation[JOINT_SPEED] = max(violation[JOINT_SPEED], abs(desired) - fastest)
        desired = math.copysign(fastest, desired)
    v += min(max(desired - v, -acceleration * dt), acceleration * dt)
    return q + dt * v, v


@kernel
def move_joint_reference(numbers, largest, budget):
    """
    Move the governed reference, and change its stiffness, for one tick.

    :param numbers: memory (`gdmp_ros.control.memory`), with the target of the guard
    :param largest: log of the largest ratio of a stiffness in a tick
    :param budget: energy that may be drawn [J]
    :returns: energy drawn, and energy in the springs at the end [J]
    """
    noinline()
    arm = arm_view(numbers)
    reference, target, mean, position = (arm.joint_reference, arm.joint_target, arm.joint_mean,
                                         arm.position)
    violation, dt, n = arm.violation, arm.scalars.dt, arm.position.size
    limits = records_at(arm.limits, 0, 1, LIMIT_NUMBERS)[0]
    acceleration, slew = limits.joint_acceleration, limits.torque_slew
    before = joint_energy(position, reference)
    start, displacement, last = local_numbers(n), local_numbers(n), local_numbers(n)
    asked, rates = local_numbers(n), local_numbers(n)
    for i in range(n):
        start[i], last[i] = reference[i], reference[n + i]
        q, v = _govern_joint(i, n, reference, target, arm.joint_limits, acceleration, dt,
                             violation)
        # It does not wind up in front of an obstacle.
        q = min(max(q, position[i] - CLIP), position[i] + CLIP)
        displacement[i], asked[i], rates[i] = q - start[i], v, (q - start[i]) / dt
        reference[n + i] = v
    if keep_joints_inside(numbers, asked, rates):
        for i in range(n):
            displacement[i], reference[n + i] = dt * rates[i], rates[i]
    for i in range(n):
        mean[i] += min(dt / MEAN_S, 1.0) * ((reference[n + i] - last[i]) / dt - mean[i])
    share = 1.0
    for i in range(n):
        reference[i] = start[i] + displacement[i]
    moving = joint_energy(position, reference) - before
    if moving > max(budget, 0.0):
        violation[ENERGY] = max(violation[ENERGY], moving - max(budget, 0.0))
        low, high = 0.0, 1.0
        for _ in range(_HALVINGS):
            share = 0.5 * (low + high)
            for i in range(n):
                reference[i] = start[i] + share * displacement[i]
            if joint_energy(position, reference) - before <= max(budget, 0.0):
                low = share
            else:
                high = share
        for i in range(n):
            reference[i] = start[i] + low * displacement[i]
            reference[n + i] *= low
            mean[i] *= low
        moving = joint_energy(position, reference) - before
    left = budget - moving
    for i in range(n):
        _change_stiffness(2 * n + i, abs(reference[i] - position[i]), reference, target, largest,
                          slew, left / n, dt, violation)
    stored = joint_energy(position, reference)
    return stored - before, stored


@kernel
def _change_stiffness(k, error, reference, target, largest, slew, budget, dt, violation):
    """
    Let one stiffness approach that of the target: growth as far as it is affordable.

    It decreases so slowly that the torque of the spring keeps a part of the rate of the motor. A
    torque that stays behind would do work for which no energy is drawn.

    :param slew: largest rate of the torque [Nm/s]
    """
    old = reference[k]
    change = math.log(max(target[k], LEAST_STIFFNESS) / old)
    if abs(change) > largest:
        violation[STIFFNESS_RATE] = max(violation[STIFFNESS_RATE], (abs(change) - largest) / dt)
        change = math.copysign(largest, change)
    bent = min(error, CLIP)
    form = bent * (error - 0.5 * bent)
    new = max(old * math.exp(change), old - FALL_SHARE * slew * dt / max(bent, 1e-9))
    if (new - old) * form > max(budget, 0.0):
        violation[ENERGY] = max(violation[ENERGY], (new - old) * form - max(budget, 0.0))
        new = old + max(budget, 0.0) / form
    reference[k] = new


@kernel
def joint_law(position, velocity, inertia, bias, friction, gain_numbers, reference, mean, torque):
    """
    Compute the joint torque of one tick.

    :param friction: of the joints, viscous [Nm s/rad] and dry [Nm], shape (2, n)
    :param gain_numbers: `ImpedanceGains` as numbers
    :param reference: governed target of the joints
    :param mean: its acceleration [rad/s²]
    :param torque: written [Nm]
    """
    n = position.size
    gains = records_at(gain_numbers, 0, 1, GAIN_NUMBERS)[0]
    joint_springs(position, reference, torque)
    for i in range(n):
        rate = reference[n + i]
        damping = 2.0 * reference[3 * n] * math.sqrt(reference[2 * n + i] * inertia[i, i])
        spring = torque[i]
        torque[i] += bias[i] + damping * (rate - velocity[i])
        if gains.feed_forward > 0.0:
            scale = rest_scale(friction[1, i], gains.friction_at_rest, reference[2 * n + i],
                               inertia[i, i], reference[3 * n])
            torque[i] += friction_torque(friction[0, i], friction[1, i], rate, spring,
                                         gains.friction_smoothing, gains.friction_at_rest, scale)
            for j in range(n):
                torque[i] += inertia[i, j] * mean[j]
