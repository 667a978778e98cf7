"""G-DMP, advanced cycle by cycle like the other methods."""
from __future__ import annotations

import numpy as np

from experiments.baselines.baseline import Baseline
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.rollout import Rollout
from gdmp_ros.dmp.skill import Skill


class Ours(Baseline):
    """G-DMP with parallel frames."""

    name = 'G-DMP parallel'
    source = 'this package'
    spaces = ('euclidean', 'sphere', 'quaternion', 'rotation', 'spd', 'product')
    connection = 'parallel'

    def learn(self) -> None:
        """Learn a skill."""
        shown = Demonstration(self.dt * np.arange(len(self._shown)), self._shown.reshape(
            -1, *self.manifold.point_shape), self.manifold)
        alpha_z, alpha_x, alpha_g = self._gains
        self.skill = Skill.learn(shown, self._functions.shape[1], alpha_z, alpha_x,
                                 self.connection, alpha_g=alpha_g, fit='forcing', end='moving')

    def reset(self, dt: float | None = None) -> None:
        """Restart at the first sample."""
        self._rollout, self._cycle_time = Rollout(self.skill), dt or self.dt

    def step(self) -> np.ndarray:
        """Advance by one cycle."""
        return self._rollout.advance(self._cycle_time).point.reshape(-1)

    def retarget(self, goal: np.ndarray) -> None:
        """Switch to a new goal."""
        self._rollout.retarget(goal)


class Published(Ours):
    """G-DMP as published: derivatives without transport."""

    name = 'G-DMP published'
    connection = 'published'
