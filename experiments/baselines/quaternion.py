"""Unit quaternions with the logarithm of the rotation to the goal."""
from __future__ import annotations

import numpy as np

from experiments.baselines.baseline import accelerate, ALPHA_G, Baseline, H
from gdmp_ros.kernels import kernel
from gdmp_ros.manifolds.quaternion import exp, log, UnitQuaternion

S3 = UnitQuaternion()


@kernel
def _step(functions, weights, numbers, error, offset, scale, velocity, force, point, goal,
          new_goal, work):
    """``τ η̇ = α_z (β_z 2 Log(g * q̄) - η) + f``, ``τ q̇ = ½ η * q``."""
    h = numbers[H]
    log(3, point, goal, error, work)
    for i in range(3):
        error[i] *= 2.0
    accelerate(functions, weights, numbers, error, offset, scale, velocity, force)
    for i in range(3):
        force[i] = 0.5 * h * velocity[i]
    exp(3, point, force, point, work)
    log(3, goal, new_goal, force, work)
    for i in range(3):
        force[i] *= h * numbers[ALPHA_G]
    exp(3, goal, force, goal, work)


class UdeQuaternion(Baseline):
    """The quaternion primitive of Ude et al.; η is τ times the angular velocity."""

    name = '[8] quaternion'
    source = 'Ude, Nemec, Petrič, Morimoto 2014, quaternion form'
    spaces = ('quaternion',)
    start_term = False

    def errors(self) -> np.ndarray:
        """Rotation vectors to the goal [rad]."""
        return np.array([2.0 * S3.log(q, self._shown[-1]) for q in self._shown])

    def rates(self) -> np.ndarray:
        """Angular velocities [rad/s]."""
        return np.array([2.0 * S3.log(q, after) for q, after
                         in zip(self._shown, self._shown[1:])]) / self.dt

    def start_error(self) -> np.ndarray:
        """Rotation vector from start to goal [rad]."""
        return np.asarray(2.0 * S3.log(self._start, self._goal))

    def _step(self) -> None:
        _step(*self._cycle(), self._point, self._goal, self._new_goal, self._work)


class AbuDakkaQuaternion(UdeQuaternion):
    """The same system with the forcing term scaled by the rotation from start to goal."""

    name = '[17] quaternion, scaled'
    source = 'Abu-Dakka, Nemec, Jørgensen, Savarimuthu, Krüger, Ude 2015'
    scaled = True
