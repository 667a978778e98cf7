"""What kernels do with MuJoCo, by the addresses of its functions, models and data."""
from __future__ import annotations

import ctypes
import functools
from pathlib import Path

import mujoco
import numpy as np

from gdmp_ros.kernels import call_c, kernel, local_matrix
from gdmp_ros.realtime.native import addresses

_NAMES = ('mj_step1', 'mj_step2', 'mj_jacSite', 'mj_jacDot', 'mj_fullM', 'mj_energyPos',
          'mju_mat2Quat', 'mj_fwdPosition', 'mj_fwdVelocity')
(_STEP1, _STEP2, _JACOBIAN, _RATE, _INERTIA, _ENERGY, _QUATERNION, _POSITION,
 _VELOCITY) = range(len(_NAMES))


@functools.cache
def functions() -> np.ndarray:
    """Addresses of the functions that the kernels call."""
    folder = Path(mujoco.__file__).parent
    return addresses(ctypes.CDLL(str(next(folder.glob('libmujoco*')))), *_NAMES)


def address(thing: mujoco.MjModel | mujoco.MjData) -> int:
    """Address of a model or of its data."""
    return int(thing._address)  # noqa: SLF001  MuJoCo has no public name for it


@kernel
def step(addresses, model, data):
    """Let the torques act that have been set, and compute all that does not depend on the next."""
    call_c(addresses[_STEP2], (model, data))
    call_c(addresses[_STEP1], (model, data))


@kernel
def steps(addresses, model, data, count):
    """Several times `step`."""
    for _ in range(count):
        step(addresses, model, data)


@kernel
def look(addresses, model, data):
    """Compute all that does not depend on torques, in the state of the data."""
    call_c(addresses[_POSITION], (model, data))
    call_c(addresses[_VELOCITY], (model, data))


@kernel
def measure(addresses, model, data, site, body, place, axes, bias, velocity, measured_pose,
            jacobian, inertia, measured_bias, acceleration):
    """
    Write what a controller needs to know in the present state.

    :param addresses: see `functions`
    :param model: address of the model
    :param data: address of its data
    :param site: id of the tool
    :param body: id of the body that carries it
    :param place: position of the site in the data, shape (3,)
    :param axes: its orientation in the data, shape (9,)
    :param bias: gravity and Coriolis torque in the data [Nm], shape (n,)
    :param velocity: of the joints [rad/s]
    :param measured_pose: written, of the tool (x, y, z, qw, qx, qy, qz)
    :param jacobian: written, linear over angular, shape (6, n)
    :param inertia: written, shape (n, n)
    :param measured_bias: written
    :param acceleration: written, J̇ q̇, shape (6,)
    """
    n = velocity.size
    rate, number, turn = local_matrix(6, n), np.int32(site), measured_pose[3:]
    call_c(addresses[_JACOBIAN], (model, data, jacobian[:3], jacobian[3:], number))
    call_c(addresses[_RATE], (model, data, rate[:3], rate[3:], place, np.int32(body)))
    call_c(addresses[_INERTIA], (model, data, inertia))
    call_c(addresses[_ENERGY], (model, data))
    call_c(addresses[_QUATERNION], (turn, axes))
    for i in range(3):
        measured_pose[i] = place[i]
    for i in range(n):
        measured_bias[i] = bias[i]
    for i in range(6):
        acceleration[i] = 0.0
        for j in range(n):
            acceleration[i] += rate[i, j] * velocity[j]


@kernel
def external_torque(smooth, passive, bias, actuator, constraint, first, external):
    """Write the joint torque of the environment: what is not passive, bias or of a motor [Nm]."""
    for i in range(external.size):
        k = first + i
        external[i] = smooth[k] - passive[k] + bias[k] - actuator[k] + constraint[k]
