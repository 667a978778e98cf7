"""What kernels do with MuJoCo, by the addresses of its functions, models and data."""
from __future__ import annotations

import ctypes
import functools
from pathlib import Path
from typing import NamedTuple

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


class ModelView(NamedTuple):
    """
    A model with its data, for kernels; until another model or other data take their place.

    :ivar functions: see `functions`
    :ivar places: address of the model, of its data, id of the tool's site and of its body
    :ivar site_position: of the site in the data, shape (3,)
    :ivar site_axes: its orientation in the data, shape (9,)
    :ivar position: of the joints in the data, as ``velocity`` and ``bias``
    """

    functions: np.ndarray
    places: np.ndarray
    site_position: np.ndarray
    site_axes: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    bias: np.ndarray


def view_of(model: mujoco.MjModel, data: mujoco.MjData, site: int, body: int) -> ModelView:
    """A model with its data, for kernels."""
    return ModelView(functions(), np.array([address(model), address(data), site, body]),
                     data.site_xpos[site], data.site_xmat[site], data.qpos, data.qvel,
                     data.qfrc_bias)


class TouchedBody(NamedTuple):
    """
    A body on which a wrench acts, in the data of a simulation, for kernels.

    :ivar place: of the point at which it acts, as ``center``, that of the body
    :ivar applied: what MuJoCo applies at the centre
    """

    place: np.ndarray
    center: np.ndarray
    applied: np.ndarray


@kernel
def push(touched, wrench):
    """Apply a wrench from now on (base frame) [N, Nm]."""
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        touched.applied[i] = wrench[i]
        touched.applied[3 + i] = (wrench[3 + i]
                                  + (touched.place[j] - touched.center[j]) * wrench[k]
                                  - (touched.place[k] - touched.center[k]) * wrench[j])


@kernel
def look(view):
    """Compute all that does not depend on torques, in the state of the data."""
    call_c(view.functions[_POSITION], (view.places[0], view.places[1]))
    call_c(view.functions[_VELOCITY], (view.places[0], view.places[1]))


@kernel
def full_inertia(view, inertia):
    """Write the inertia of all joints in the present state, shape (n, n)."""
    call_c(view.functions[_INERTIA], (view.places[0], view.places[1], inertia))


@kernel
def measure(view, velocity, measured_pose, jacobian, inertia, measured_bias, acceleration):
    """
    Write what a controller needs to know in the present state.

    :param velocity: of the joints [rad/s]
    :param measured_pose: written, of the tool (x, y, z, qw, qx, qy, qz)
    :param jacobian: written, linear over angular, shape (6, n)
    :param inertia: written, shape (n, n)
    :param measured_bias: written
    :param acceleration: written, J̇ q̇, shape (6,)
    """
    n, called, place = velocity.size, view.functions, view.site_position
    model, data = view.places[0], view.places[1]
    site, body = np.int32(view.places[2]), np.int32(view.places[3])
    rate, turn = local_matrix(6, n), measured_pose[3:]
    call_c(called[_JACOBIAN], (model, data, jacobian[:3], jacobian[3:], site))
    call_c(called[_RATE], (model, data, rate[:3], rate[3:], place, body))
    call_c(called[_INERTIA], (model, data, inertia))
    call_c(called[_ENERGY], (model, data))
    call_c(called[_QUATERNION], (turn, view.site_axes))
    for i in range(3):
        measured_pose[i] = place[i]
    for i in range(n):
        measured_bias[i] = view.bias[i]
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
