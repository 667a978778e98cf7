"""The scheme of [GDMP] eqs. (17) to (22), literally: no transport, Euler's method."""
from __future__ import annotations

import numpy as np

from experiments.baselines.baseline import accelerate, Baseline, H
from experiments.baselines.transported import filter_goal, move
from gdmp_ros.kernels import kernel
from gdmp_ros.manifolds.spd import SymmetricPositiveDefinite

log = SymmetricPositiveDefinite.kernels.log


@kernel
def _step(m, functions, weights, numbers, error, offset, scale, velocity, force, point, goal,
          new_goal, work):
    """Eqs. (17) and (22): tangents of different points are added as they are stored."""
    log(m, point, goal, error, work)
    accelerate(functions, weights, numbers, error, offset, scale, velocity, force)
    move(m, point, velocity, numbers[H], work)
    filter_goal(m, numbers, goal, new_goal, force, work)


class LiteralScheme(Baseline):
    """
    G-DMP with the differences of eq. (20) and the Euler-Riemann step of eq. (22).

    Our `published` has the same equations, but second-order derivatives and integration.
    """

    name = 'G-DMP, literal scheme'
    source = '[GDMP] eqs. (17) to (22)'
    spaces = ('spd',)

    @property
    def _matrices(self) -> np.ndarray:
        return self._shown.reshape(-1, *self.manifold.point_shape)

    def errors(self) -> np.ndarray:
        """Tangents at each sample to the goal."""
        matrices = self._matrices
        return np.array([self.manifold.log(a, matrices[-1]) for a in matrices])

    def rates(self) -> np.ndarray:
        """Tangents at each sample to the next one [1/s], eq. (20)."""
        matrices = self._matrices
        return np.array([self.manifold.log(a, b)
                         for a, b in zip(matrices, matrices[1:])]) / self.dt

    def start_error(self) -> np.ndarray:
        """Tangent at the start to the goal."""
        shape = self.manifold.point_shape
        return self.manifold.log(self._start.reshape(shape), self._goal.reshape(shape))

    def _step(self) -> None:
        _step(self.manifold.size, *self._cycle(), self._point, self._goal, self._new_goal,
              self._work)
