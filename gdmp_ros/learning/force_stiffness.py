"""
Stiffness from sensed forces: how strongly a demonstrator corrects deviations from a path.

The hand that guides a tool of mass M along its path x̂ acts as a spring and a damper, and the robot
loads the tool with the force f that the wrist senses: ``M ẍ = K (x̂ - x) - D ẋ + f``. The intended
path is not known. The mean over several demonstrations is therefore subtracted: x̂ is the mean
path, and f the deviation from the mean force.

Source: Abu-Dakka, Rozo, Caldwell 2018, as [GDMP] section 5.6.1 uses it.
"""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_continuous_lyapunov

from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.errors import DataError, ParameterError
from gdmp_ros.learning.variance_stiffness import check_stiffness_bounds
from gdmp_ros.manifolds.spd import SymmetricPositiveDefinite


@dataclass(frozen=True)
class ForceRecords:
    """
    Several demonstrations on the same normalised time.

    :ivar times: shape ``(T,)`` [s], equally spaced
    :ivar positions: of the tool, shape ``(count, T, d)`` [m]
    :ivar velocities: [m/s]
    :ivar accelerations: [m/s²]
    :ivar forces: of the robot on the tool without the tool's weight [N]
    """

    times: np.ndarray
    positions: np.ndarray
    velocities: np.ndarray
    accelerations: np.ndarray
    forces: np.ndarray

    def __post_init__(self) -> None:
        shape = self.positions.shape
        if len(shape) != 3 or shape[0] < 2 or shape[1] != len(self.times):
            raise DataError(f'force records: positions have shape {shape}, expected at least 2 '
                            f'demonstrations of {len(self.times)} samples')
        for name in ('velocities', 'accelerations', 'forces'):
            if getattr(self, name).shape != shape:
                raise DataError(f'force records: {name} have shape {getattr(self, name).shape}, '
                                f'expected {shape} as the positions')
        for name in ('positions', 'velocities', 'accelerations', 'forces'):
            if not np.isfinite(getattr(self, name)).all():
                raise DataError(f'force records: {name} have NaN or infinite numbers (was there a '
                                'force sensor?)')
        if not _deviation(self.positions).any(axis=(0, 2)).all():
            raise DataError('force records: the demonstrations do not differ: their forces do not '
                            'determine a stiffness')


def force_stiffness(records: ForceRecords, mass: float, damping: float, window: float = 0.8,
                    k_min: float = 200.0, k_max: float = 800.0,
                    smoothing: float = 1.0) -> np.ndarray:
    """
    Stiffness profile that explains the forces best.

    In a sliding window the symmetric K of least squares is found. Its eigenvalues are clipped to
    the bounds, so that it is positive definite, and the profile is smoothed on SPD.

    :param mass: M of the tool [kg]
    :param damping: D of the hand [N s/m]
    :param window: length of the window [s]
    :param k_min: smallest eigenvalue [N/m]
    :param k_max: largest eigenvalue [N/m]
    :param smoothing: cut-off of the smoothing [Hz]
    :returns: shape ``(T, d, d)`` [N/m]
    :raises ParameterError: if a number is out of range
    """
    check_stiffness_bounds(k_min, k_max)
    if not (mass >= 0.0 and damping >= 0.0 and window > 0.0):
        raise ParameterError(f'mass {mass!r} kg and damping {damping!r} N s/m must not be '
                             f'negative, window {window!r} s must be positive')
    offset = _deviation(records.positions)
    force = (_deviation(records.forces) - mass * _deviation(records.accelerations)
             - damping * _deviation(records.velocities))
    size = offset.shape[2]
    # Sums of products over all demonstrations at each sample, then over each window.
    spread = _windowed(np.einsum('nti,ntj->tij', offset, offset), records.times, window)
    work = _windowed(np.einsum('nti,ntj->tij', force, offset), records.times, window)
    result = np.empty((len(records.times), size, size))
    for i in range(len(records.times)):
        # K symmetric with least Σ ‖K δx - f‖²: K A + A K = B + Bᵀ.
        ridge = 1e-6 * np.trace(spread[i]) * np.eye(size)
        found = solve_continuous_lyapunov(spread[i] + ridge, work[i] + work[i].T)
        values, vectors = np.linalg.eigh(0.5 * (found + found.T))
        result[i] = (vectors * np.clip(values, k_min, k_max)) @ vectors.T
    profile = Demonstration(records.times, result, SymmetricPositiveDefinite(size))
    return np.array(profile.smoothed(smoothing).points)


def _deviation(values: np.ndarray) -> np.ndarray:
    return np.asarray(values - values.mean(axis=0))


def _windowed(values: np.ndarray, times: np.ndarray, window: float) -> np.ndarray:
    """Sum over a window around each time, shorter at the ends."""
    total = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
    first = np.searchsorted(times, times - 0.5 * window)
    last = np.searchsorted(times, times + 0.5 * window, side='right')
    return np.asarray(total[last] - total[first])
