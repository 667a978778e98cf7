"""The libraries that are measured beside ours; they come with the extra ``bench``."""
from __future__ import annotations

import importlib
from typing import Any

import numpy as np

from gdmp_ros.dmp import Demonstration
from gdmp_ros.errors import DataError


def _module(name: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise DataError(f'the peer {name.partition(".")[0]} cannot be loaded ({error}): '
                        "pip install 'gdmp_ros[bench]'") from None


def spd_manifold(size: int) -> Any:
    """pymanopt's manifold of positive definite matrices."""
    return _module('pymanopt.manifolds').SymmetricPositiveDefinite(size)


class CartesianPeer:
    """movement_primitives' `CartesianDMP` (DFKI), used as its documentation shows."""

    def __init__(self, shown: Demonstration, n_basis: int, dt: float = 1e-3):
        """:param shown: on R³ × S³"""
        self._times = shown.times - shown.times[0]
        self._poses = np.array(shown.points)
        self.dmp = _module('movement_primitives.dmp').CartesianDMP(
            execution_time=shown.duration, dt=dt, n_weights_per_dim=n_basis)

    def learn(self) -> None:
        """Imitate the demonstration."""
        self.dmp.imitate(self._times, self._poses)

    def begin(self) -> None:
        """Go to the start of the demonstration."""
        self.dmp.reset()
        self.dmp.configure(start_y=self._poses[0].copy(), goal_y=self._poses[-1].copy())
        self.pose, self.velocity = self._poses[0].copy(), np.zeros(6)

    def step(self) -> np.ndarray:
        """Advance by dt; the pose (x, y, z, qw, qx, qy, qz)."""
        self.pose, self.velocity = self.dmp.step(self.pose, self.velocity)
        return np.asarray(self.pose)
