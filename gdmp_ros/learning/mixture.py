"""Gaussian mixture over time and position of several demonstrations."""
from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gdmp_ros.errors import DataError


class Mixture:
    """Gaussian mixture over (time, position), conditioned on time (mixture regression)."""

    def __init__(self, paths: Sequence[np.ndarray], n_components: int = 8, floor: float = 1e-6):
        """
        Fit the mixture by expectation maximisation, from a fixed seed.

        :param paths: positions of each demonstration, shape ``(T, d)``, equally spaced over the
            same normalised time
        :param floor: added to every variance [unit of the positions squared]
        :raises DataError: with fewer than two demonstrations
        """
        from gmr import GMM
        from sklearn.mixture import GaussianMixture
        if len(paths) < 2:
            raise DataError(f'variance needs at least 2 demonstrations, got {len(paths)}')
        samples = np.vstack([np.column_stack([np.linspace(0.0, 1.0, len(path)), path])
                             for path in paths])
        # Time and position get the same scale; otherwise k-means would ignore one of them.
        self._scale = samples[:, 1:].std()
        self._width = samples.shape[1] - 1
        scaled = samples / np.append(1.0, np.full(self._width, self._scale))
        fitted = GaussianMixture(n_components, reg_covar=floor / self._scale ** 2,
                                 random_state=0).fit(scaled)
        self._mixture = GMM(n_components, priors=fitted.weights_, means=fitted.means_,
                            covariances=fitted.covariances_)

    def covariances(self, times: np.ndarray) -> np.ndarray:
        """
        Covariance of the position at normalised ``times``.

        :returns: shape ``(len(times), d, d)``
        """
        out = np.empty((len(times), self._width, self._width))
        for i, time in enumerate(times):
            out[i] = self._mixture.condition([0], np.array([time])).to_mvn().covariance
        return np.asarray(out * self._scale ** 2)
