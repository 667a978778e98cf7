"""
Stiffness from the variance over demonstrations: stiff where they agree, compliant where they
differ.

Source: [GDMP] section 5.1 (covariance profiles by GMM and GMR).
"""
from __future__ import annotations

from collections.abc import Sequence

from gmr import GMM
import numpy as np
from sklearn.mixture import GaussianMixture

from gdmp_ros.dmp import Demonstration
from gdmp_ros.errors import DataError, ParameterError
from gdmp_ros.manifolds import SymmetricPositiveDefinite

#: A profile is computed at so many places of the motion.
_PROFILE = 200


class Mixture:
    """A Gaussian mixture over (time, position), conditioned on time."""

    def __init__(self, paths: Sequence[np.ndarray], n_components: int = 8, floor: float = 1e-6):
        """
        Fit the mixture by expectation maximisation, from a fixed seed.

        :param paths: one position trajectory per demonstration, shape ``(T, d)``, time-aligned:
            equally spaced over the same normalised time
        :param floor: added to every variance [unit of the positions squared]
        :raises DataError: with fewer than two demonstrations
        """
        if len(paths) < 2:
            raise DataError(f'variance needs at least 2 demonstrations, got {len(paths)}')
        samples = np.vstack([np.column_stack([np.linspace(0.0, 1.0, len(path)), path])
                             for path in paths])
        # Time and space to the same scale, or the initial clusters would ignore one of them.
        self._scale = np.append(1.0, samples[:, 1:].std())
        self._width = samples.shape[1] - 1
        scaled = samples / np.append(self._scale[0], np.full(self._width, self._scale[1]))
        fitted = GaussianMixture(n_components, reg_covar=floor / self._scale[1] ** 2,
                                 random_state=0).fit(scaled)
        self._mixture = GMM(n_components, priors=fitted.weights_, means=fitted.means_,
                            covariances=fitted.covariances_)

    def covariances(self, times: np.ndarray) -> np.ndarray:
        """
        Covariance of the position at normalised ``times``, by Gaussian mixture regression.

        :returns: shape ``(len(times), d, d)``
        """
        out = np.empty((len(times), self._width, self._width))
        for i, time in enumerate(times):
            out[i] = self._mixture.condition([0], np.array([time])).to_mvn().covariance
        return np.asarray(out * self._scale[1] ** 2)


def check_bounds(k_min: float, k_max: float) -> None:
    """:raises ParameterError: unless ``0 < k_min < k_max``"""
    if not 0.0 < k_min < k_max < np.inf:
        raise ParameterError(f'stiffness bounds are {k_min!r} and {k_max!r} N/m, expected '
                             '0 < k_min < k_max')


def bounded_stiffness(covariances: np.ndarray, k_min: float = 200.0,
                      k_max: float = 800.0) -> np.ndarray:
    """
    Stiffness ``K ∝ Σ^-γ`` whose eigenvalues over the whole profile span at most k_min … k_max.

    γ is 1 (inverse covariance) where the precisions span no more than ``k_max / k_min``, otherwise
    the largest power that fits; the profile is then centred (geometrically) between the bounds.

    :param covariances: shape ``(T, d, d)``
    :returns: shape ``(T, d, d)`` [N/m]
    :raises ParameterError: unless ``0 < k_min < k_max``
    """
    check_bounds(k_min, k_max)
    values, vectors = np.linalg.eigh(covariances)
    precision = -np.log(values)
    span = np.ptp(precision)
    power = min(1.0, np.log(k_max / k_min) / span) if span > 0.0 else 1.0
    centred = power * (precision - 0.5 * (precision.max() + precision.min()))
    stiffness = np.exp(centred) * np.sqrt(k_min * k_max)
    result = np.einsum('tij,tj,tkj->tik', vectors, stiffness, vectors)
    return np.asarray(0.5 * (result + result.transpose(0, 2, 1)))


def stiffness_along(paths: Sequence[np.ndarray], times: Sequence[np.ndarray],
                    k_min: float = 200.0, k_max: float = 800.0) -> list[np.ndarray]:
    """
    Stiffness from the variance over demonstrations, at every sample of each of them.

    :param paths: positions of each demonstration [m], shape ``(T, d)``
    :param times: of their samples [s]; they are compared in parts of their durations
    :returns: for each demonstration, shape ``(T, d, d)`` [N/m]
    """
    normalised = np.linspace(0.0, 1.0, _PROFILE)
    even = [evenly(path, each, len(each)) for path, each in zip(paths, times)]
    profile = variance_stiffness(even, normalised, k_min, k_max)
    stiffness = Demonstration(normalised, profile,
                              SymmetricPositiveDefinite(paths[0].shape[1]))
    return [stiffness.at((each - each[0]) / (each[-1] - each[0])) for each in times]


def evenly(path: np.ndarray, times: np.ndarray, count: int) -> np.ndarray:
    """``count`` samples of a path at evenly spaced times, shape ``(count, d)``."""
    at = np.linspace(times[0], times[-1], count)
    return np.column_stack([np.interp(at, times, column) for column in path.T])


def variance_stiffness(paths: Sequence[np.ndarray], times: np.ndarray, k_min: float = 200.0,
                       k_max: float = 800.0) -> np.ndarray:
    """
    Stiffness profile of several demonstrations at normalised ``times``.

    :param paths: positions of each demonstration [m], shape ``(T, d)``
    :returns: shape ``(len(times), d, d)`` [N/m]
    """
    return bounded_stiffness(Mixture(paths).covariances(times), k_min, k_max)
