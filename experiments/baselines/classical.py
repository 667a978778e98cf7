"""The classical primitive: every number separately; its output is projected to the space."""
from __future__ import annotations

import numpy as np

from experiments.baselines.baseline import accelerate, ALPHA_G, Baseline, H
from gdmp_ros.kernels.cache import kernel


@kernel
def _step(functions, weights, numbers, error, offset, scale, velocity, force, point, goal,
          new_goal):
    h = numbers[H]
    for i in range(point.size):
        error[i] = goal[i] - point[i]
    accelerate(functions, weights, numbers, error, offset, scale, velocity, force)
    for i in range(point.size):
        point[i] += h * velocity[i]
        goal[i] += h * numbers[ALPHA_G] * (new_goal[i] - goal[i])


class Classical(Baseline):
    """
    ``τ ż = α_z (β_z (g - y - (g - y_0) x + F) - z)`` for each number of a point.

    On a curved space its output leaves the space. It is projected back before use, as [GDMP]
    does for unit quaternions.
    """

    name = '[4] classical, renormalised'
    source = 'Ijspeert et al. 2013, in the form of Pastor et al. 2009'
    spaces = ('euclidean', 'sphere', 'quaternion', 'rotation', 'spd', 'product')

    def errors(self) -> np.ndarray:
        """Differences of the numbers."""
        return np.asarray(self._shown[-1] - self._shown)

    def rates(self) -> np.ndarray:
        """Differences of the numbers."""
        return np.asarray(np.diff(self._shown, axis=0) / self.dt)

    def start_error(self) -> np.ndarray:
        """Differences of the numbers."""
        return np.asarray(self._goal - self._start)

    def _step(self) -> None:
        _step(*self._cycle(), self._point, self._goal, self._new_goal)

    def output(self, raw: np.ndarray) -> np.ndarray:
        """Nearest point of the space: unit norm, orthonormal, positive definite."""
        manifold = self.manifold
        return np.asarray(manifold.project(raw.reshape(manifold.point_shape))).reshape(-1)
