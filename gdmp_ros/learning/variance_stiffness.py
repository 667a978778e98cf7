"""
Stiffness from the variance over demonstrations: high where they agree, low where they differ.

Source: [GDMP] section 5.1 (covariance profiles by GMM and GMR).
"""
from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.errors import ParameterError
from gdmp_ros.learning.mixture import Mixture
from gdmp_ros.manifolds.spd import SymmetricPositiveDefinite

#: Samples of a stiffness profile.
_SAMPLES = 200


def check_stiffness_bounds(k_min: float, k_max: float) -> None:
    """:raises ParameterError: unless ``0 < k_min < k_max``"""
    if not 0.0 < k_min < k_max < np.inf:
        raise ParameterError(f'stiffness bounds are {k_min!r} and {k_max!r} N/m, expected '
                             '0 < k_min < k_max')


def bounded_stiffness(covariances: np.ndarray, k_min: float = 200.0,
                      k_max: float = 800.0) -> np.ndarray:
    """
    Stiffness ``K ∝ Σ^-γ`` whose eigenvalues over the whole profile span at most k_min … k_max.

    γ is 1 (inverse covariance) if the precisions span no more than ``k_max / k_min``, otherwise
    the largest power that fits. The profile is then centred (geometrically) between the bounds.

    :param covariances: shape ``(T, d, d)``
    :returns: shape ``(T, d, d)`` [N/m]
    :raises ParameterError: unless ``0 < k_min < k_max``
    """
    check_stiffness_bounds(k_min, k_max)
    values, vectors = np.linalg.eigh(covariances)
    precision = -np.log(values)
    span = np.ptp(precision)
    power = min(1.0, np.log(k_max / k_min) / span) if span > 0.0 else 1.0
    centred = power * (precision - 0.5 * (precision.max() + precision.min()))
    stiffness = np.exp(centred) * np.sqrt(k_min * k_max)
    result = np.einsum('tij,tj,tkj->tik', vectors, stiffness, vectors)
    return np.asarray(0.5 * (result + result.transpose(0, 2, 1)))


def variance_stiffness(paths: Sequence[np.ndarray], times: np.ndarray, k_min: float = 200.0,
                       k_max: float = 800.0) -> np.ndarray:
    """
    Stiffness profile of several demonstrations at normalised ``times``.

    :param paths: positions of each demonstration [m], shape ``(T, d)``
    :returns: shape ``(len(times), d, d)`` [N/m]
    """
    return bounded_stiffness(Mixture(paths).covariances(times), k_min, k_max)


def stiffness_at_samples(paths: Sequence[np.ndarray], times: Sequence[np.ndarray],
                         k_min: float = 200.0, k_max: float = 800.0) -> list[np.ndarray]:
    """
    Stiffness from the variance over demonstrations, at every sample of each of them.

    :param paths: positions of each demonstration [m], shape ``(T, d)``
    :param times: of their samples [s]; each is normalised by its duration
    :returns: for each demonstration, shape ``(T, d, d)`` [N/m]
    """
    normalised = np.linspace(0.0, 1.0, _SAMPLES)
    uniform = [resampled(path, each, len(each)) for path, each in zip(paths, times)]
    profile = variance_stiffness(uniform, normalised, k_min, k_max)
    stiffness = Demonstration(normalised, profile, SymmetricPositiveDefinite(paths[0].shape[1]))
    return [stiffness.at((each - each[0]) / (each[-1] - each[0])) for each in times]


def resampled(path: np.ndarray, times: np.ndarray, count: int) -> np.ndarray:
    """``count`` samples of a path at equally spaced times, shape ``(count, d)``."""
    at = np.linspace(times[0], times[-1], count)
    return np.column_stack([np.interp(at, times, column) for column in path.T])
