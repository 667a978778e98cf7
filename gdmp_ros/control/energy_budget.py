"""
Motion and stiffness of one tick, as far as there is energy for them.

The energy stored in the spring is ``V = ½ eᵀ K e`` of the clipped error. A reference that moves
and a stiffness that grows increase it; that energy is drawn from the tank
(`gdmp_ros.control.tank`).
"""
from __future__ import annotations

import math

import numpy as np

from gdmp_ros.control.impedance import elastic_error
from gdmp_ros.control.limits import ENERGY, POSITION_ERROR, ROTATION_ERROR, STIFFNESS_RATE
from gdmp_ros.control.settings import GAIN_NUMBERS
from gdmp_ros.control.stiffness import bound_stiffness, compose_modes, relative_modes
from gdmp_ros.control.target import ACCELERATION, extrapolate_pose, POSE, STIFFNESS, TWIST
from gdmp_ros.kernels import kernel, records_at
from gdmp_ros.manifolds.quaternion import rotation_between

#: Steps of the bisection for the affordable part of a reference step.
_HALVINGS = 20


@kernel
def _energy(pose, reference, stiffness, gains, error):
    elastic_error(pose, reference, gains, error)
    total = 0.0
    for i in range(6):
        for j in range(6):
            total += error[i] * stiffness[6 * i + j] * error[j]
    return 0.5 * total


@kernel
def stored_energy(pose, reference, gain_numbers):
    """
    Energy in the spring, ``½ eᵀ K e`` [J].

    :param pose: of the tool
    :param reference: `TARGET_SIZE` numbers
    :param gain_numbers: `ImpedanceGains` as numbers
    """
    gains = records_at(gain_numbers, 0, 1, GAIN_NUMBERS)[0]
    return _energy(pose, reference, reference[STIFFNESS:STIFFNESS + 36], gains, np.empty(6))


@kernel
def _change_stiffness(old, wanted, error, largest, budget, violation):
    """
    Go from ``old`` towards ``wanted``: decreasing modes always, growing modes as energy allows.

    :param wanted: replaced by the stiffness that is reached
    :param largest: log of the largest ratio of a mode
    :param budget: energy for growth, beyond what decreasing modes release [J]
    :returns: energy drawn (negative: released), and energy that was missing [J]
    """
    values, modes, cost = np.empty(6), np.empty(36), np.zeros(6)
    relative_modes(old, wanted, values, modes)
    released, drawn, missing = 0.0, 0.0, 0.0
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
            cost[k] = part
        drawn += max(cost[k], 0.0)
    compose_modes(values, modes, wanted)
    return drawn - released, missing


@kernel
def _move_reference(reference, pose, stiffness, gains, budget, dt):
    """
    Move the pose of the reference with its twist, as far as there is energy.

    :returns: energy drawn, and energy that was missing [J]
    """
    moved, error = np.empty(ACCELERATION), np.empty(6)
    before = _energy(pose, reference, stiffness, gains, error)
    extrapolate_pose(reference, dt, moved)
    drawn = _energy(pose, moved, stiffness, gains, error) - before
    missing = max(drawn - budget, 0.0)
    if missing > 0.0:
        # The energy is convex along the step and affordable at its beginning.
        low, high = 0.0, 1.0
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            extrapolate_pose(reference, middle * dt, moved)
            if _energy(pose, moved, stiffness, gains, error) - before <= budget:
                low = middle
            else:
                high = middle
        extrapolate_pose(reference, low * dt, moved)
        drawn = _energy(pose, moved, stiffness, gains, error) - before
        for i in range(TWIST, ACCELERATION + 6):
            reference[i] *= low
    for i in range(7):
        reference[POSE + i] = moved[i]
    return drawn, missing


@kernel
def _report_clipping(reference, pose, gains, violation):
    rotation = np.empty(3)
    rotation_between(pose[3:7], reference[POSE + 3:POSE + 7], rotation)
    distance, angle = 0.0, 0.0
    for i in range(3):
        distance += (reference[POSE + i] - pose[i]) ** 2
        angle += rotation[i] ** 2
    violation[POSITION_ERROR] = max(math.sqrt(distance) - gains.position_clip, 0.0)
    violation[ROTATION_ERROR] = max(math.sqrt(angle) - gains.rotation_clip, 0.0)


@kernel
def apply_energy_budget(reference, target, pose, gain_numbers, bounds, largest, budget, dt,
                        violation):
    """
    Move the reference and change its stiffness for one tick, inside the bounds and the energy.

    :param reference: the governed reference, `TARGET_SIZE` numbers; changed
    :param target: what the guard gives; its stiffness is overwritten
    :param pose: measured
    :param gain_numbers: `ImpedanceGains` as numbers
    :param bounds: of the stiffness, lower and upper, shape (2, 36)
    :param largest: log of the largest ratio of a stiffness mode in a tick
    :param budget: energy that may be drawn [J]
    :param violation: written: by how much each limit was exceeded
    :returns: energy drawn, and energy in the spring at the end [J]
    """
    gains = records_at(gain_numbers, 0, 1, GAIN_NUMBERS)[0]
    stiffness, wanted = (reference[STIFFNESS:STIFFNESS + 36],
                         target[STIFFNESS:STIFFNESS + 36])
    error = np.empty(6)
    elastic_error(pose, reference, gains, error)
    bound_stiffness(wanted, bounds[0], bounds[1], violation)
    stiffening, short = _change_stiffness(stiffness, wanted, error, largest, budget, violation)
    for i in range(36):
        stiffness[i] = wanted[i]
    violation[STIFFNESS_RATE] /= dt
    moving, missing = _move_reference(reference, pose, stiffness, gains, budget - stiffening, dt)
    if short + missing > 1e-12:
        violation[ENERGY] = short + missing
    _report_clipping(reference, pose, gains, violation)
    return stiffening + moving, _energy(pose, reference, stiffness, gains, error)
