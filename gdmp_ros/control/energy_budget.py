"""
Motion and stiffness of one tick, as far as there is energy for them.

A reference that moves and a stiffness that grows increase the energy in the spring
(`gdmp_ros.control.spring`); that energy is drawn from the tank (`gdmp_ros.control.tank`).
"""
from __future__ import annotations

import math

from gdmp_ros.control.kinematics import chain_state
from gdmp_ros.control.limits import (
    ENERGY,
    LIMITS,
    POSITION_ERROR,
    ROTATION_ERROR,
    STIFFNESS_RATE,
)
from gdmp_ros.control.memory import arm_view
from gdmp_ros.control.spring import (
    make_spring,
    pose_error,
    spring_energy,
    spring_force,
    SPRING_SIZE,
    stored_energy,
)
from gdmp_ros.control.stiffness import bound_stiffness, compose_modes, relative_modes
from gdmp_ros.control.target import ACCELERATION, POSE, STIFFNESS, TWIST
from gdmp_ros.kernels import kernel, local_matrix, local_numbers, local_zeros, noinline
from gdmp_ros.manifolds.linalg import copy_into, norm

#: Steps of the bisections for the affordable part of a change.
_HALVINGS = 20
_LIMIT_COUNT = len(LIMITS)
#: Smallest factor of the stiffness in a tick in which it is shed.
LEAST_SOFTENING = 0.8


@kernel
def _energy(pose, reference, spring, error):
    pose_error(pose, reference, error)
    return spring_energy(spring, error)


@kernel
def _energy_of(stiffness, error, gain_numbers, spring):
    make_spring(stiffness, gain_numbers, spring)
    return spring_energy(spring, error)


@kernel
def _limit_modes(old, target, error, largest, budget, violation):
    """
    Go from ``old`` towards ``wanted``: decreasing modes always, growing modes as energy allows.

    :param target: replaced by the stiffness that is reached
    :param error: of which the spring stores the energy ``½ eᵀ K e``
    :param largest: log of the largest ratio of a mode
    :param budget: energy for growth, beyond what decreasing modes release [J]
    :returns: energy that was missing [J]
    """
    values, modes, cost = local_numbers(6), local_numbers(36), local_zeros(6)
    relative_modes(old, target, values, modes)
    released, missing = 0.0, 0.0
    for k in range(6):
        size = abs(math.log(max(values[k], 1e-12)))
        if size > largest:
            violation[STIFFNESS_RATE] = max(violation[STIFFNESS_RATE], size - largest)
            values[k] = math.exp(math.copysign(largest, values[k] - 1.0))
        along = 0.0
        for i in range(6):
            along += modes[6 * k + i] * error[i]
        cost[k] = 0.5 * (values[k] - 1.0) * along * along
        released -= min(cost[k], 0.0)
    # An equal part for each mode: modes that need no energy are not limited by the others.
    part = max(budget + released, 0.0) / 6.0
    for k in range(6):
        if cost[k] > part:
            values[k] = 1.0 + (values[k] - 1.0) * part / cost[k]
            missing += cost[k] - part
    compose_modes(values, modes, target)
    return missing


@kernel
def _change_stiffness(old, target, error, gain_numbers, largest, budget, spring, violation):
    """
    Change the stiffness as `_limit_modes`, with the exact energy of the spring.

    :param spring: that of ``old``; replaced
    :returns: energy drawn (negative: released), and energy that was missing [J]
    """
    before = spring_energy(spring, error)
    scaled, force = local_numbers(6), local_numbers(6)
    linear, angular = spring_force(spring, error, force)
    for i in range(3):
        scaled[i] = math.sqrt(linear) * error[i]
        scaled[3 + i] = math.sqrt(angular) * error[3 + i]
    missing = _limit_modes(old, target, scaled, largest, budget, violation)
    drawn = _energy_of(target, error, gain_numbers, spring) - before
    if drawn <= max(budget, 0.0):
        return drawn, missing
    # The bounds of the force change with the stiffness, so that the modes are not quite apart.
    missing += drawn - max(budget, 0.0)
    low, high, change = 0.0, 1.0, local_numbers(36)
    for i in range(36):
        change[i] = target[i] - old[i]
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        for i in range(36):
            target[i] = old[i] + middle * change[i]
        if _energy_of(target, error, gain_numbers, spring) - before <= max(budget, 0.0):
            low = middle
        else:
            high = middle
    for i in range(36):
        target[i] = old[i] + low * change[i]
    return _energy_of(target, error, gain_numbers, spring) - before, missing


@kernel
def _energy_after(numbers, seconds, spring, joints, moved, error):
    """Energy in the spring after the joints of the reference have moved for a time [J]."""
    noinline()
    arm = arm_view(numbers)
    jacobian = local_matrix(6, joints.size)
    for i in range(joints.size):
        joints[i] = arm.governed[i] + seconds * arm.governed_rate[i]
    chain_state(arm.frames, arm.axes, arm.end, joints, moved, jacobian)
    return _energy(arm.pose, moved, spring, error)


@kernel
def _move_reference(numbers, spring, budget):
    """
    Move the joints of the reference with their velocities, as far as there is energy.

    :returns: energy drawn, and energy that was missing [J]
    """
    arm = arm_view(numbers)
    reference, dt = arm.reference, arm.scalars.dt
    moved, error, joints = local_numbers(7), local_numbers(6), local_numbers(arm.position.size)
    before = _energy(arm.pose, reference, spring, error)
    drawn = _energy_after(numbers, dt, spring, joints, moved, error) - before
    missing = max(drawn - budget, 0.0)
    if missing > 0.0:
        # The energy is convex along the step and affordable at its beginning.
        low, high = 0.0, 1.0
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            if _energy_after(numbers, middle * dt, spring, joints, moved, error) - before <= (
                    budget):
                low = middle
            else:
                high = middle
        drawn = _energy_after(numbers, low * dt, spring, joints, moved, error) - before
        for i in range(TWIST, ACCELERATION + 6):
            reference[i] *= low
        for i in range(6):
            arm.past[2, i] *= low
        for i in range(joints.size):
            arm.governed_rate[i] *= low
    copy_into(moved, reference[POSE:POSE + 7])
    copy_into(joints, arm.governed)
    return drawn, missing


@kernel
def _report_clipping(spring, error, violation):
    linear, angular = spring_force(spring, error, local_numbers(6))
    violation[POSITION_ERROR] = (1.0 - linear) * norm(3, error[:3])
    violation[ROTATION_ERROR] = (1.0 - angular) * norm(3, error[3:])


@kernel
def apply_energy_budget(numbers, largest, budget):
    """
    Move the reference and change its stiffness for one tick, inside the bounds and the energy.

    :param numbers: memory (`gdmp_ros.control.memory`); the stiffness of its target is overwritten
    :param largest: log of the largest ratio of a stiffness mode in a tick
    :param budget: energy that may be drawn [J]
    :returns: energy drawn, and energy in the spring at the end [J]
    """
    noinline()
    arm = arm_view(numbers)
    pose, reference, violation = arm.pose, arm.reference, arm.violation
    stiffness, desired = (reference[STIFFNESS:STIFFNESS + 36],
                          arm.target[STIFFNESS:STIFFNESS + 36])
    error, spring = local_numbers(6), local_numbers(SPRING_SIZE)
    pose_error(pose, reference, error)
    make_spring(stiffness, arm.gains, spring)
    bound_stiffness(desired, arm.bounds[0], arm.bounds[1], violation)
    stiffening, short = _change_stiffness(stiffness, desired, error, arm.gains, largest, budget,
                                          spring, violation)
    copy_into(desired, stiffness)
    violation[STIFFNESS_RATE] /= arm.scalars.dt
    moving, missing = _move_reference(numbers, spring, budget - stiffening)
    if short + missing > 1e-12:
        violation[ENERGY] = short + missing
    stored = _energy(pose, reference, spring, error)
    _report_clipping(spring, error, violation)
    return stiffening + moving, stored


@kernel
def soften(stiffness, error, gain_numbers, least, energy):
    """
    Reduce a stiffness as a whole until the spring has released an energy.

    :param stiffness: 36 numbers, changed
    :param error: from `pose_error`
    :param least: smallest factor
    :param energy: to be released [J]
    :returns: energy that was released [J]
    """
    spring, scaled = local_numbers(SPRING_SIZE), local_numbers(36)
    before = _energy_of(stiffness, error, gain_numbers, spring)
    low, high = least, 1.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        for i in range(36):
            scaled[i] = middle * stiffness[i]
        if before - _energy_of(scaled, error, gain_numbers, spring) >= energy:
            low = middle
        else:
            high = middle
    for i in range(36):
        stiffness[i] *= low
    return before - _energy_of(stiffness, error, gain_numbers, spring)


@kernel
def release(pose, reference, gain_numbers, bounds, energy):
    """
    Let the spring of a reference release an energy by a smaller stiffness.

    :param pose: of the tool
    :param bounds: smallest and largest stiffness (`gdmp_ros.control.stiffness.diagonal_bounds`)
    :returns: what it released [J]
    """
    error, stiffness = local_numbers(6), reference[STIFFNESS:STIFFNESS + 36]
    pose_error(pose, reference, error)
    before = stored_energy(pose, reference, gain_numbers)
    soften(stiffness, error, gain_numbers, LEAST_SOFTENING, energy)
    # The lower bound has priority: a spring below it would not come back.
    bound_stiffness(stiffness, bounds[0], bounds[1], local_zeros(_LIMIT_COUNT))
    return before - stored_energy(pose, reference, gain_numbers)
