"""
What the model of an arm lacks of its weight: a moment of each link, which slow motions show.

The moment γ_k of link k is mass times centre of mass times the acceleration of gravity, in the
frame of the joint that moves it. The potential energy that is lacking is Σ (R_k γ_k)_z, and the
torque its gradient: it is conservative however wrong the moments are. Gravity acts along -z of the
base.
"""
from __future__ import annotations

import numpy as np

from gdmp_ros.control.kinematics import Chain, place_links
from gdmp_ros.errors import ParameterError
from gdmp_ros.kernels import kernel, local_matrix, local_zeros, noinline
from gdmp_ros.manifolds.quaternion import rotate

#: [m/s²].
GRAVITY = 9.81
#: Time constant with which other moments are taken over [s].
CHANGE_S = 0.2


@kernel
def add_weight(frames, axes, position, moments, torque):
    """
    Add the torque that holds moments of weight.

    :param frames: of the joints (`gdmp_ros.control.kinematics.Chain`), as ``axes``
    :param position: of the joints [rad], shape (n,)
    :param moments: of the links [Nm], shape (n, 3)
    :param torque: changed [Nm], shape (n,)
    :returns: their potential energy [J]
    """
    noinline()
    n, energy = position.size, 0.0
    links, turns = local_matrix(n + 1, 7), local_matrix(n, 3)
    total, moment = local_zeros(3), local_zeros(3)
    place_links(frames, axes, position, links, turns)
    for back in range(n):
        k = n - 1 - back
        rotate(links[k + 1, 3:], moments[k], moment)
        for i in range(3):
            total[i] += moment[i]
        torque[k] += turns[k, 0] * total[1] - turns[k, 1] * total[0]
        energy += moment[2]
    return energy


@kernel
def is_weightless(moments):
    """Whether all moments are zero."""
    for k in range(moments.shape[0]):
        for i in range(3):
            if moments[k, i] != 0.0:
                return False
    return True


@kernel
def change_weight(moments, wanted, dt):
    """Let moments approach others."""
    share = min(dt / CHANGE_S, 1.0)
    for k in range(moments.shape[0]):
        for i in range(3):
            moments[k, i] += share * (wanted[k, i] - moments[k, i])


def moments_of(given: tuple[float, ...], joints: int) -> np.ndarray:
    """
    Moments of the links, shape (n, 3) [Nm].

    :param given: a single 0, or three numbers for each joint
    :raises ParameterError: if there are more or fewer
    """
    if given == (0.0,):
        return np.zeros((joints, 3))
    if len(given) != 3 * joints:
        raise ParameterError(f'weight_moments: {len(given)} numbers, expected {3 * joints}, three '
                             'for each joint')
    return np.array(given).reshape(joints, 3)


def weight_rows(chain: Chain, position: np.ndarray) -> np.ndarray:
    """
    Torque of each joint for a unit of each moment, shape (n, 3 n).

    :param position: of the joints [rad]
    """
    n = len(position)
    rows, unit = np.zeros((3 * n, n)), np.eye(3 * n).reshape(3 * n, n, 3)
    for row, moments in zip(rows, unit):
        add_weight(*chain, position, moments, row)
    return rows.T
