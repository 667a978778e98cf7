"""
Admittance: how an arm that takes joint positions gives way to a force.

The impedance law moves a *virtual arm*, which has the kinematics of the real one, no weight and a
chosen mass, and feels the wrench that a sensor measures. Its joint positions are the commands. So
all limits, the guard and the energy tank are those of an arm with torques.

Commands act late. Beside something with the stiffness k_e an admittance is calm only if its
damping is larger than k_e times the whole delay: the tool is damped relative to its reference,
and the step of the virtual arm is implicit in this damping.
"""
from __future__ import annotations

from dataclasses import dataclass

from gdmp_ros.kernels import kernel, local_numbers
from gdmp_ros.manifolds.linalg import cholesky, invert_lower
from gdmp_ros.manifolds.quaternion import rotate
from gdmp_ros.util.settings import setting

#: Damping of the tool, in units of contact stiffness times delay: below 1.5 it rings, above 2 it
#: is sluggish.
DAMPING_SHARE = 1.9
#: Rotational damping is that of a force with this lever [m].
LEVER_M = 0.1


@dataclass(frozen=True)
class AdmittanceSettings:
    """How an arm that takes joint positions gives way to a force."""

    virtual_mass: float = setting(
        2.0, 'mass with which the tool gives way, in the mean of its directions', 'kg', 0.5, 50.0)
    contact_stiffness: float = setting(
        30_000.0, 'largest stiffness of what is touched: the tool is damped for it', 'N/m', 100.0,
        1e6)
    servo_delay: float = setting(
        0.02, 'time from a command until the arm is there, until it is measured in motion', 's',
        0.001, 0.1)
    servo_delay_max: float = setting(
        0.05, 'delay above which the arm stops', 's', 0.001, 0.2)
    sensor_max: tuple[float, float] = setting(
        (100.0, 10.0), 'largest force and torque that the sensor can measure: with more in one '
        'direction the arm stops', 'N, Nm', 0.1, 10_000.0)
    sensor_bias: tuple[float, float, float, float, float, float] = setting(
        (0.0,) * 6, 'what the sensor measures without a load, in its frame', 'N, Nm', -1000.0,
        1000.0)
    measured_timeout: float = setting(
        0.1, 'without measured joints, or a measured wrench, for this time the arm stops', 's',
        0.002, 1.0)
    following_error: float = setting(
        0.1, 'largest distance of a joint from where its command leads', 'rad', 0.001, 1.0)


@kernel
def external_wrench(wrench, sensor, tool, site, center, carried, external):
    """
    Write the wrench of the environment at the tool, in the frame of the base.

    :param wrench: measured, in the frame of the sensor
    :param sensor: its pose in the frame of the base, as ``tool``, and ``site`` of the payload
    :param center: of the payload, in the frame of the site [m]
    :param carried: force that the payload exerts: weight and inertia [N], shape (3,)
    """
    at = local_numbers(3)
    for first in (0, 3):
        rotate(sensor[3:], wrench[first:first + 3], external[first:first + 3])
    for i in range(3):
        at[i] = sensor[i] - tool[i]
    _add_moment(at, external, external[3:], 1.0)
    rotate(site[3:], center, at)
    for i in range(3):
        at[i] += site[i] - tool[i]
        external[i] -= carried[i]
    _add_moment(at, carried, external[3:], -1.0)


@kernel
def _add_moment(arm, force, moment, sign):
    moment[0] += sign * (arm[1] * force[2] - arm[2] * force[1])
    moment[1] += sign * (arm[2] * force[0] - arm[0] * force[2])
    moment[2] += sign * (arm[0] * force[1] - arm[1] * force[0])


@kernel
def advance(position, velocity, inertia, jacobian, torque, wrench, twist, damping, dt):
    """
    Let the virtual arm move for ``dt`` seconds.

    ``(M + dt Jᵀ D J) q̇' = M q̇ + dt (τ + Jᵀ (F + D v))``: implicit in the damping.

    :param position: of its joints [rad], changed, as ``velocity`` [rad/s]
    :param inertia: M, shape ``(n, n)``
    :param jacobian: J of the tool, linear over angular, shape ``(6, n)``
    :param torque: of the impedance law, without weight and Coriolis torque [Nm]
    :param wrench: F, external, at the tool [N, Nm]
    :param twist: v of the reference of the tool [m/s, rad/s]
    :param damping: linear and angular [Ns/m, Nms/rad]
    """
    n = position.size
    matrix, lower, inverse = local_numbers(n * n), local_numbers(n * n), local_numbers(n * n)
    right, half = local_numbers(n), local_numbers(n)
    for i in range(n):
        right[i] = dt * torque[i]
        for k in range(6):
            share = damping[0] if k < 3 else damping[1]
            right[i] += dt * jacobian[k, i] * (wrench[k] + share * twist[k])
        for j in range(n):
            matrix[i * n + j] = inertia[i, j]
            right[i] += inertia[i, j] * velocity[j]
            for k in range(6):
                share = damping[0] if k < 3 else damping[1]
                matrix[i * n + j] += dt * share * jacobian[k, i] * jacobian[k, j]
    cholesky(n, matrix, lower)
    invert_lower(n, lower, inverse)
    for i in range(n):
        half[i] = 0.0
        for j in range(i + 1):
            half[i] += inverse[i * n + j] * right[j]
    for i in range(n):
        velocity[i] = 0.0
        for j in range(i, n):
            velocity[i] += inverse[j * n + i] * half[j]
        position[i] += dt * velocity[i]
