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
from typing import NamedTuple

import numpy as np

from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.errors import DataError, ParameterError
from gdmp_ros.learning.endpoints import noise_level
from gdmp_ros.learning.variance_stiffness import check_stiffness_bounds
from gdmp_ros.manifolds.spd import SymmetricPositiveDefinite

#: The stiffness in a direction is known if its standard error is at most this part of the range.
KNOWN = 0.2
#: Smallest excitation of a direction, as a part of that of all together.
_LEAST_EXCITATION = 1e-6


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


class ForceStiffness(NamedTuple):
    """
    A stiffness profile, and how well the demonstrations determine it.

    Little is known of directions in which the demonstrations hardly differ.

    :ivar matrices: shape ``(T, d, d)`` [N/m]
    :ivar directions: orthonormal columns, those in which the demonstrations differ least first,
        shape ``(T, d, d)``
    :ivar errors: standard error of the stiffness in each direction, before it is clipped and
        smoothed, shape ``(T, d)`` [N/m]
    :ivar known: whether it is at most `KNOWN` of the range of the stiffness, shape ``(T, d)``
    """

    matrices: np.ndarray
    directions: np.ndarray
    errors: np.ndarray
    known: np.ndarray


def force_stiffness(records: ForceRecords, mass: float, damping: float, window: float = 0.8,
                    k_min: float = 200.0, k_max: float = 800.0,
                    smoothing: float = 1.0, position_noise: float | None = None
                    ) -> ForceStiffness:
    """
    Stiffness profile that explains the forces best.

    In a sliding window the symmetric K of least squares is found. Noise of the positions would
    make it too soft: what it adds to their products is subtracted. The eigenvalues are clipped to
    the bounds, so that K is positive definite, and the profile is smoothed on SPD. A direction
    without excitation has the smallest stiffness.

    :param mass: M of the tool [kg]
    :param damping: D of the hand [N s/m]
    :param window: length of the window [s]
    :param k_min: smallest eigenvalue [N/m]
    :param k_max: largest eigenvalue [N/m]
    :param smoothing: cut-off of the smoothing [Hz]
    :param position_noise: standard deviation of a coordinate [m]; by default estimated from third
        differences, which takes it as independent from sample to sample
    :raises ParameterError: if a number is out of range
    """
    check_stiffness_bounds(k_min, k_max)
    if not (mass >= 0.0 and damping >= 0.0 and window > 0.0):
        raise ParameterError(f'mass {mass!r} kg and damping {damping!r} N s/m must not be '
                             f'negative, window {window!r} s must be positive')
    if position_noise is not None and not 0.0 <= position_noise < np.inf:
        raise ParameterError(f'position_noise is {position_noise!r} m, expected a number >= 0')
    offset = _deviation(records.positions)
    force = (_deviation(records.forces) - mass * _deviation(records.accelerations)
             - damping * _deviation(records.velocities))
    count, samples, size = offset.shape
    # Sums of products over all demonstrations at each sample, then over each window.
    spread = _windowed(np.einsum('nti,ntj->tij', offset, offset), records.times, window)
    work = _windowed(np.einsum('nti,ntj->tij', force, offset), records.times, window)
    if position_noise is None:
        position_noise = float(np.sqrt(np.mean([noise_level(p) ** 2 for p in records.positions])))
    used = _windowed(np.ones(samples), records.times, window)
    # The deviations from the mean contain count - 1 parts of count.
    excited, directions = np.linalg.eigh(
        spread - ((count - 1.0) * position_noise ** 2 * used)[:, None, None] * np.eye(size))
    least = _LEAST_EXCITATION * np.einsum('tii->t', spread)[:, None]
    floored = np.maximum(excited, least)
    found = np.array([_symmetric(vectors, values, one) for vectors, values, one
                      in zip(directions, floored, work)])
    errors = np.where(excited > least, _errors(offset, force, found, directions, records.times,
                                               window) / floored, np.inf)
    values, vectors = np.linalg.eigh(found)
    clipped = np.einsum('tij,tj,tkj->tik', vectors, np.clip(values, k_min, k_max), vectors)
    profile = Demonstration(records.times, clipped, SymmetricPositiveDefinite(size))
    return ForceStiffness(np.array(profile.smoothed(smoothing).points), directions, errors,
                          errors <= KNOWN * (k_max - k_min))


def _symmetric(vectors: np.ndarray, values: np.ndarray, work: np.ndarray) -> np.ndarray:
    """Symmetric K with least ``Σ ‖K δx - f‖²``: ``K A + A K = B + Bᵀ``, A by eigenvectors."""
    both = vectors.T @ (work + work.T) @ vectors
    return np.asarray(vectors @ (both / np.add.outer(values, values)) @ vectors.T)


def _errors(offset: np.ndarray, force: np.ndarray, found: np.ndarray, directions: np.ndarray,
            times: np.ndarray, window: float) -> np.ndarray:
    """
    Standard error of ``K A u`` in each direction u.

    From the differences between demonstrations, so that noise of one of them may be correlated in
    time.
    """
    count = len(offset)
    rest = force - np.einsum('tij,ntj->nti', found, offset)
    along = np.einsum('nti,tij->ntj', offset, directions)
    scores = np.array([_windowed(np.einsum('ti,tj->tij', one, other), times, window)
                       for one, other in zip(rest, along)])
    return np.asarray(np.sqrt(count / (count - 1.0) * (scores ** 2).sum(axis=(0, 2))))


def _deviation(values: np.ndarray) -> np.ndarray:
    return np.asarray(values - values.mean(axis=0))


def _windowed(values: np.ndarray, times: np.ndarray, window: float) -> np.ndarray:
    """Sum over a window around each time, shorter at the ends."""
    total = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
    first = np.searchsorted(times, times - 0.5 * window)
    last = np.searchsorted(times, times + 0.5 * window, side='right')
    return np.asarray(total[last] - total[first])
