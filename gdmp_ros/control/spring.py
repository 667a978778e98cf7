"""
The spring between tool and reference: a potential with a bounded force.

With e the position error and the rotation vector of the orientation error (base frame), K is split
into what acts on the translation and what acts on the rest:
``eᵀ K e = eₜᵀ S eₜ + (eᵣ + L eₜ)ᵀ C (eᵣ + L eₜ)``, C the rotational block, ``L = C⁻¹ Kᵣₜ`` and
``S = Kₜₜ - Kₜᵣ L``. Each part q contributes ``½ q`` up to ``q = c²``, then ``c √q - ½ c²``: the
force grows no further, and is still the gradient of the energy. Of an anisotropic K with a clipped
error it would not be, and a closed loop beyond the clip would gain energy.
"""
from __future__ import annotations

import math

import numpy as np

from gdmp_ros.control.settings import GAIN_NUMBERS
from gdmp_ros.control.target import (
    ACCELERATION,
    extrapolate_pose,
    POSE,
    resting_target,
    STIFFNESS,
    TWIST,
)
from gdmp_ros.kernels import kernel, local_numbers, records_at
from gdmp_ros.manifolds.linalg import cholesky, copy_into, invert_lower, multiply
from gdmp_ros.manifolds.quaternion import rotation_between
from gdmp_ros.manifolds.spectral import symmetric_eigen

# Index of the first number of each part: S, L, C, and the bounds c of both parts.
_TRANSLATION, _COUPLING, _ROTATION, _BOUNDS = 0, 9, 18, 27
SPRING_SIZE = 29
#: Share of the bound from which a reference moves away more slowly.
SLOW_FROM = 0.7
#: Steps of `moved_with_tool`.
POSE_STEPS = 5


@kernel
def _bound(block, clip, largest, work):
    """The c with which the stiffest direction reaches its clip, or its largest force."""
    values, vectors = local_numbers(3), local_numbers(9)
    symmetric_eigen(3, block, values, vectors, work)
    root = math.sqrt(max(values[0], values[1], values[2], 1e-12))
    return min(clip * root, largest / root)


@kernel
def make_spring(stiffness, gain_numbers, spring):
    """
    Prepare a stiffness.

    :param stiffness: K, 36 numbers, positive definite
    :param gain_numbers: `ImpedanceGains` as numbers
    :param spring: written, `SPRING_SIZE` numbers
    """
    gains = records_at(gain_numbers, 0, 1, GAIN_NUMBERS)[0]
    block, coupling = spring[_TRANSLATION:_COUPLING], spring[_COUPLING:_ROTATION]
    rotation, work = spring[_ROTATION:_BOUNDS], local_numbers(9)
    lower, inverse = local_numbers(9), local_numbers(9)
    compliance, towards = local_numbers(9), local_numbers(9)
    for i in range(3):
        for j in range(3):
            block[3 * i + j] = stiffness[6 * i + j]
            rotation[3 * i + j] = stiffness[6 * (i + 3) + j + 3]
            towards[3 * i + j] = stiffness[6 * (i + 3) + j]
    cholesky(3, rotation, lower)
    invert_lower(3, lower, inverse)
    for i in range(3):
        for j in range(3):
            total = 0.0
            for k in range(3):
                total += inverse[3 * k + i] * inverse[3 * k + j]
            compliance[3 * i + j] = total
    multiply(3, compliance, towards, coupling)
    for i in range(3):
        for j in range(3):
            for k in range(3):
                block[3 * i + j] -= stiffness[6 * i + 3 + k] * coupling[3 * k + j]
    spring[_BOUNDS] = _bound(block, gains.position_clip, gains.wrench_max[0], work)
    spring[_BOUNDS + 1] = _bound(rotation, gains.rotation_clip, gains.wrench_max[1], work)


@kernel
def pose_error(pose, target, error):
    """
    Write the position error and the rotation vector of the orientation error.

    :param pose: measured (x, y, z, qw, qx, qy, qz)
    :param target: `TARGET_SIZE` numbers
    :param error: result in the base frame, shape (6,) [m, rad]
    """
    for i in range(3):
        error[i] = target[POSE + i] - pose[i]
    rotation_between(pose[3:7], target[POSE + 3:POSE + 7], error[3:])


@kernel
def _forces(spring, error, forces):
    """Write ``S eₜ`` and ``C (eᵣ + L eₜ)``; return both squares."""
    first, second = 0.0, 0.0
    turned = local_numbers(3)
    for i in range(3):
        turned[i] = error[3 + i]
        for j in range(3):
            turned[i] += spring[_COUPLING + 3 * i + j] * error[j]
    for i in range(3):
        forces[i], forces[3 + i] = 0.0, 0.0
        for j in range(3):
            forces[i] += spring[_TRANSLATION + 3 * i + j] * error[j]
            forces[3 + i] += spring[_ROTATION + 3 * i + j] * turned[j]
        first += error[i] * forces[i]
        second += turned[i] * forces[3 + i]
    return max(first, 0.0), max(second, 0.0)


@kernel
def _share(square, bound):
    """Part of the linear force that acts."""
    return 1.0 if square <= bound * bound else bound / math.sqrt(square)


@kernel
def _potential(square, bound):
    if square <= bound * bound:
        return 0.5 * square
    return bound * math.sqrt(square) - 0.5 * bound * bound


@kernel
def spring_energy(spring, error):
    """
    Energy in the spring [J].

    :param spring: from `make_spring`
    :param error: from `pose_error`
    """
    first, second = _forces(spring, error, local_numbers(6))
    return _potential(first, spring[_BOUNDS]) + _potential(second, spring[_BOUNDS + 1])


@kernel
def spring_force(spring, error, force):
    """
    Write the gradient of the energy by the error, shape (6,).

    :returns: parts of the linear force that act, translation and rotation
    """
    forces = local_numbers(6)
    first, second = _forces(spring, error, forces)
    linear = _share(first, spring[_BOUNDS])
    angular = _share(second, spring[_BOUNDS + 1])
    for i in range(3):
        force[3 + i] = angular * forces[3 + i]
        force[i] = linear * forces[i]
    for i in range(3):
        for j in range(3):
            force[i] += spring[_COUPLING + 3 * j + i] * force[3 + j]
    return linear, angular


@kernel
def keep_error(pose, reference, gain_numbers, twist):
    """
    Let a reference move no further away where the force of its spring grows no further.

    It would only wind up: a blocked tool that is released would fly after it.

    :param twist: of the reference; changed
    """
    spring, error, forces = local_numbers(SPRING_SIZE), local_numbers(6), local_numbers(6)
    make_spring(reference[STIFFNESS:STIFFNESS + 36], gain_numbers, spring)
    pose_error(pose, reference, error)
    first, second = _forces(spring, error, forces)
    for part in range(2):
        square, bound = (first, spring[_BOUNDS]) if part == 0 else (second, spring[_BOUNDS + 1])
        share = min((math.sqrt(square) / bound - SLOW_FROM) / (1.0 - SLOW_FROM), 1.0)
        if share <= 0.0:
            continue
        power, size = 0.0, 0.0
        for i in range(3 * part, 3 * part + 3):
            power += forces[i] * twist[i]
            size += forces[i] ** 2
        if power > 0.0:
            for i in range(3 * part, 3 * part + 3):
                twist[i] -= share * power / size * forces[i]


@kernel
def stored_energy(pose, reference, gain_numbers):
    """
    Energy in the spring of a reference [J].

    :param pose: of the tool
    :param reference: `TARGET_SIZE` numbers
    :param gain_numbers: `ImpedanceGains` as numbers
    """
    spring, error = local_numbers(SPRING_SIZE), local_numbers(6)
    make_spring(reference[STIFFNESS:STIFFNESS + 36], gain_numbers, spring)
    pose_error(pose, reference, error)
    return spring_energy(spring, error)


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
def spring_wrench(pose, target, gain_numbers, wrench):
    """
    Write the wrench of the spring between tool and reference [N, Nm], in the base frame.

    :param pose: of the tool (x, y, z, qw, qx, qy, qz)
    :param target: `TARGET_SIZE` numbers
    """
    spring, error = local_numbers(SPRING_SIZE), local_numbers(6)
    make_spring(target[STIFFNESS:STIFFNESS + 36], gain_numbers, spring)
    pose_error(pose, target, error)
    spring_force(spring, error, wrench)
    turning = local_numbers(3)
    copy_into(wrench[3:], turning)
    left_jacobian_inverse(error[3:], turning, wrench[3:])


@kernel
def spring_power(pose, twist, reference, gain_numbers, stored, dt):
    """
    Rate at which a motion increases the energy in the spring of a reference [W].

    :param twist: of the tool [m/s, rad/s]
    :param stored: energy in the spring now [J]
    """
    moving, ahead = local_numbers(ACCELERATION), local_numbers(7)
    for i in range(7):
        moving[POSE + i] = pose[i]
    for i in range(6):
        moving[TWIST + i] = twist[i]
    extrapolate_pose(moving, dt, ahead)
    return (stored_energy(ahead, reference, gain_numbers) - stored) / dt


def moved_with_tool(reference: np.ndarray, before: np.ndarray, after: np.ndarray,
                    gain_numbers: np.ndarray) -> np.ndarray:
    """
    Where a reference must be after another point became the tool, so that no torque changes.

    :param reference: `TARGET_SIZE` numbers
    :param before: pose of the last tool (x, y, z, qw, qx, qy, qz)
    :param after: pose of the new one
    :returns: (x, y, z, qw, qx, qy, qz)
    """
    wrench, pulls, held, result = np.empty(6), np.empty(6), after.copy(), reference.copy()
    spring_wrench(before, reference, gain_numbers, wrench)
    wrench[3:] += np.cross(before[:3] - after[:3], wrench[:3])
    compliance = np.linalg.inv(reference[STIFFNESS:STIFFNESS + 36].reshape(6, 6))
    moved = resting_target(after)
    # The rotational part is not linear: corrected step by step.
    for _ in range(POSE_STEPS):
        result[POSE:POSE + 7] = held
        spring_wrench(after, result, gain_numbers, pulls)
        moved[TWIST:TWIST + 6] += compliance @ (wrench - pulls)
        extrapolate_pose(moved, 1.0, held)
    return held
