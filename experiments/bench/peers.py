"""Libraries that are measured for comparison; they come with the extra ``bench``."""
from __future__ import annotations

from typing import Any

import numpy as np

from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.util.optional_imports import extra, optional_import


def spd_manifold(size: int) -> Any:
    """pymanopt's manifold of positive definite matrices."""
    with optional_import(extra('bench')):
        from pymanopt.manifolds import SymmetricPositiveDefinite
    return SymmetricPositiveDefinite(size)


class CartesianPeer:
    """`CartesianDMP` of movement_primitives (DFKI), used as its documentation shows."""

    def __init__(self, shown: Demonstration, n_basis: int, dt: float = 1e-3,
                 smooth_scaling: bool = False):
        """
        Prepare with the defaults of the peer.

        :param shown: on R³ × S³
        :param smooth_scaling: its option for smaller accelerations at a new goal
        """
        with optional_import(extra('bench')):
            from movement_primitives.dmp import CartesianDMP
        self._times = shown.times - shown.times[0]
        self._poses = np.array(shown.points)
        self.dmp: Any = CartesianDMP(execution_time=shown.duration, dt=dt,
                                     n_weights_per_dim=n_basis, smooth_scaling=smooth_scaling)

    def learn(self) -> None:
        """Imitate the demonstration."""
        self.dmp.imitate(self._times, self._poses)

    def begin(self) -> None:
        """Begin at the start of the demonstration."""
        self.dmp.reset()
        self.dmp.configure(start_y=self._poses[0].copy(), goal_y=self._poses[-1].copy())
        self.pose, self.velocity = self._poses[0].copy(), np.zeros(6)

    def step(self) -> np.ndarray:
        """Advance by dt, and return the pose (x, y, z, qw, qx, qy, qz)."""
        self.pose, self.velocity = self.dmp.step(self.pose, self.velocity)
        return np.asarray(self.pose)
