"""Friction of the joints: what is compensated, and what is there for certain."""
from __future__ import annotations

import math

import numpy as np

from gdmp_ros.control.settings import FrictionSettings
from gdmp_ros.errors import ParameterError
from gdmp_ros.kernels import kernel

#: Delay that a spring must bear which is helped over the dry friction [s]: that of a cycle and of
#: a measured velocity, twice.
REST_DELAY_S = 0.004
#: Smallest torque of the spring at which three quarters of the share at rest act, as a share of
#: the dry friction: below is noise.
LEAST_SCALE = 0.02


def friction_of(settings: FrictionSettings, model: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """
    Friction that is compensated, shape (2, n), and that which is there for certain, shape (4, n).

    Viscous [Nm s/rad] and dry [Nm]; certain at every motion, and at that of the reference.

    :param model: viscous friction of the model's joints [Nm s/rad], shape (n,)
    :raises ParameterError: unless there is one number for all joints, or one for each
    """
    count = len(model)

    def of_joints(name: str) -> np.ndarray:
        given = np.array(getattr(settings, name), dtype=float)
        if given.shape not in ((1,), (count,)):
            raise ParameterError(f'friction, {name}: {given.size} numbers, expected 1 or {count}, '
                                 'one for each joint')
        return np.asarray(np.broadcast_to(given, count).copy())
    viscous = model if settings.viscous == (0.0,) else of_joints('viscous')
    compensated = np.array([viscous, of_joints('dry')])
    certain = np.array([of_joints('credit_viscous'), of_joints('credit_dry')])
    return compensated, np.vstack([certain, settings.credit * compensated])


@kernel
def rest_scale(dry, at_rest, stiffness, inertia, damping_ratio):
    """
    Torque of the spring at which three quarters of the share at rest act [Nm].

    The help makes the spring stiffer by ``1 + at_rest dry / scale``, and damps it no more. With a
    delay it oscillates unless damping > delay × stiffness: the factor is at most
    ``2 ζ √(m / k) / delay``.

    :param dry: friction of the joint [Nm]
    :param stiffness: of the spring at the joint [Nm/rad]
    :param inertia: of the joint [kg m²]
    """
    most = 2.0 * damping_ratio * math.sqrt(inertia / max(stiffness, 1e-9)) / REST_DELAY_S - 1.0
    return max(at_rest * dry / max(most, 1e-9), LEAST_SCALE * dry)


@kernel
def friction_torque(viscous, dry, speed, spring, smoothing, at_rest, scale):
    """
    Torque that compensates the friction of a joint [Nm].

    It is compensated at the velocity of the reference, not at the measured one, so that no energy
    is added to a motion that an external force causes. While the reference rests, the spring is
    helped over a share of the dry friction.

    :param speed: of the joint, by the reference [rad/s]
    :param spring: torque of the spring on the joint [Nm]
    :param smoothing: speed at which three quarters of the dry friction are compensated [rad/s]
    :param at_rest: share of the dry friction that is compensated at rest
    :param scale: see `rest_scale`
    """
    moving = math.tanh(speed / smoothing)
    torque = viscous * speed + dry * moving
    if at_rest > 0.0 and dry > 0.0:
        torque += at_rest * (1.0 - abs(moving)) * dry * math.tanh(spring / scale)
    return torque


@kernel
def without_friction(external, velocity, dry, smoothing, result):
    """
    Write the external joint torque without the dry friction that is known [Nm].

    At rest friction and what holds against it cannot be told apart.

    :param dry: that is known [Nm], shape (n,)
    :param smoothing: speed at which three quarters of the dry friction act [rad/s]
    """
    for i in range(external.size):
        result[i] = external[i]
        if dry[i] != 0.0:
            result[i] += dry[i] * math.tanh(velocity[i] / smoothing)
