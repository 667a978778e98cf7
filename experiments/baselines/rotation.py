"""Rotation matrices with the logarithm of the rotation to the goal."""
from __future__ import annotations

import numpy as np

from experiments.baselines.baseline import accelerate, ALPHA_G, Baseline, H
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.kernels import kernel
from gdmp_ros.manifolds.linalg import copy_into
from gdmp_ros.manifolds.rotation import SpecialOrthogonal

SO3 = SpecialOrthogonal(3)
exp, log = SO3.kernels.exp, SO3.kernels.log


@kernel
def _step(functions, weights, numbers, error, offset, scale, velocity, force, point, goal,
          new_goal, work):
    """``τ η̇ = α_z (β_z log(R_g Rᵀ) - η) + f``, ``τ Ṙ = [η] R``."""
    h, moved, rest = numbers[H], work[:9], work[9:]
    log(3, point, goal, error, rest)
    accelerate(functions, weights, numbers, error, offset, scale, velocity, force)
    for i in range(3):
        force[i] = h * velocity[i]
    exp(3, point, force, moved, rest)
    copy_into(moved, point)
    log(3, goal, new_goal, force, rest)
    for i in range(3):
        force[i] *= h * numbers[ALPHA_G]
    exp(3, goal, force, moved, rest)
    copy_into(moved, goal)


class UdeRotation(Baseline):
    """The rotation-matrix primitive of Ude et al."""

    name = '[8] rotation matrix'
    source = 'Ude, Nemec, Petrič, Morimoto 2014, rotation-matrix form'
    spaces = ('rotation',)
    start_term = False

    @classmethod
    def handles(cls, shown: Demonstration) -> bool:
        """Whether the space is SO(3)."""
        return shown.manifold == SO3

    def errors(self) -> np.ndarray:
        """Rotation vectors to the goal [rad]."""
        matrices = self._shown.reshape(-1, 3, 3)
        return np.array([SO3.log(r, matrices[-1]) for r in matrices])

    def rates(self) -> np.ndarray:
        """Angular velocities [rad/s]."""
        matrices = self._shown.reshape(-1, 3, 3)
        return np.array([SO3.log(r, after) for r, after in zip(matrices, matrices[1:])]) / self.dt

    def start_error(self) -> np.ndarray:
        """Rotation vector from start to goal [rad]."""
        return SO3.log(self._start.reshape(3, 3), self._goal.reshape(3, 3))

    def _step(self) -> None:
        _step(*self._cycle(), self._point, self._goal, self._new_goal, self._work)
