"""Gaussian mixture over time and position of several demonstrations."""
from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import softmax

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
        from sklearn.mixture import GaussianMixture
        if len(paths) < 2:
            raise DataError(f'variance needs at least 2 demonstrations, got {len(paths)}')
        samples = np.vstack([np.column_stack([np.linspace(0.0, 1.0, len(path)), path])
                             for path in paths])
        # Time and position get the same scale; otherwise k-means would ignore one of them.
        self._scale = samples[:, 1:].std()
        self._width = samples.shape[1] - 1
        scaled = samples / np.append(1.0, np.full(self._width, self._scale))
        self._fitted = GaussianMixture(n_components, reg_covar=floor / self._scale ** 2,
                                       random_state=0).fit(scaled)

    def covariances(self, times: np.ndarray) -> np.ndarray:
        """
        Covariance of the position at normalised ``times``.

        :returns: shape ``(len(times), d, d)``
        """
        means, covariances = self._fitted.means_, self._fitted.covariances_
        away = np.asarray(times)[:, None] - means[:, 0]
        variances, slopes = covariances[:, 0, 0], covariances[:, 1:, 0]
        exponents = -0.5 * (away ** 2 / variances + np.log(variances))
        shares = softmax(np.log(self._fitted.weights_) + exponents, axis=1)
        # Of each component, given the time: mean, and covariance, which is the same at all times.
        given = means[:, 1:] + (away / variances)[:, :, None] * slopes
        within = covariances[:, 1:, 1:] - np.einsum('ki,kj->kij', slopes,
                                                    slopes / variances[:, None])
        given -= np.einsum('tk,tki->ti', shares, given)[:, None]
        between = np.einsum('tk,tki,tkj->tij', shares, given, given)
        return np.asarray((np.einsum('tk,kij->tij', shares, within) + between) * self._scale ** 2)
