"""
Stiffness that demonstrations show: by their variance, by their agreement, or by sensed forces.

Source of the variance-based profiles: [GDMP] section 5.
"""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.special import softmax

from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.errors import DataError, ParameterError
from gdmp_ros.learning.alignment import align, Aligned, SAMPLES
from gdmp_ros.learning.cleaning import noise_level
from gdmp_ros.manifolds import Manifold
from gdmp_ros.manifolds.spd import SymmetricPositiveDefinite

#: Samples of a stiffness profile.
_SAMPLES = 200
#: Takes that agree within this standard deviation agree [m]: no arm follows more closely.
AGREEMENT = 0.0005
#: Standard deviation of the smoothing of covariances, in durations.
SMOOTHING = 0.02
#: A position moves if it is faster than this part of the largest speed.
MOVING = 0.02
#: Fewest takes that determine a covariance.
LEAST_TAKES = 2
#: The stiffness in a direction is known if its standard error is at most this part of the range.
KNOWN = 0.2
#: Smallest excitation of a direction, as a part of that of all together.
_LEAST_EXCITATION = 1e-6


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
        offset = np.asarray(times)[:, None] - means[:, 0]
        variances, slopes = covariances[:, 0, 0], covariances[:, 1:, 0]
        exponents = -0.5 * (offset ** 2 / variances + np.log(variances))
        shares = softmax(np.log(self._fitted.weights_) + exponents, axis=1)
        # Of each component, given the time: mean, and covariance, which is the same at all times.
        given = means[:, 1:] + (offset / variances)[:, :, None] * slopes
        within = covariances[:, 1:, 1:] - np.einsum('ki,kj->kij', slopes,
                                                    slopes / variances[:, None])
        given -= np.einsum('tk,tki->ti', shares, given)[:, None]
        between = np.einsum('tk,tki,tkj->tij', shares, given, given)
        return np.asarray((np.einsum('tk,kij->tij', shares, within) + between) * self._scale ** 2)


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
    return _of_covariances(covariances, k_min, k_max, centred=True)


def _of_covariances(covariances: np.ndarray, least: float, most: float, centred: bool,
                    floor: float = 0.0) -> np.ndarray:
    """
    ``K ∝ (Σ + floor I)^-γ`` with γ as large as the bounds allow, and at most 1.

    :param centred: geometrically between the bounds; otherwise the largest eigenvalue is ``most``
    """
    values, vectors = np.linalg.eigh(covariances)
    logarithm = np.log(np.maximum(values, 0.0) + floor)
    span, room = np.ptp(logarithm), np.log(most / least)
    power = min(1.0, room / span) if span > 0.0 else 1.0
    largest = np.log(most) - (0.5 * (room - power * span) if centred else 0.0)
    stiffness = np.exp(largest - power * (logarithm - logarithm.min()))
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


def stiffness_from_takes(demonstrations: Sequence[Demonstration], least: float = 200.0,
                         most: float = 800.0) -> tuple[np.ndarray, np.ndarray]:
    """
    Stiffness profile along the mean progress of several takes.

    ``K ∝ Σ^-γ``: ``most`` where and in the direction in which the takes agree best. γ is 1 if the
    precisions span no more than ``most / least``, otherwise the largest power that fits.

    :param demonstrations: their manifold is R², R³ or begins with one of them, a position [m]
    :param least: smallest eigenvalue [N/m]
    :param most: largest eigenvalue [N/m]
    :returns: progress s, shape ``(T,)``, and stiffness [N/m], shape ``(T, d, d)``
    :raises DataError: with fewer than two takes, or without a position
    :raises ParameterError: unless ``0 < least < most``
    """
    check_stiffness_bounds(least, most)
    result, size = _aligned_takes(demonstrations)
    return result.progress, _stiffness(covariances(result, size), least, most)


def stiffness_of_each(demonstrations: Sequence[Demonstration], least: float = 200.0,
                      most: float = 800.0) -> list[np.ndarray]:
    """
    `stiffness_from_takes` at every sample of each take.

    :returns: for each demonstration, shape ``(T, d, d)`` [N/m]
    """
    check_stiffness_bounds(least, most)
    aligned, size = _aligned_takes(demonstrations)
    matrices = _stiffness(covariances(aligned, size), least, most)
    profile = Demonstration(aligned.progress, matrices, SymmetricPositiveDefinite(size))
    result = []
    for take, warp in zip(demonstrations, aligned.warps):
        own = (take.times - take.times[0]) / take.duration
        result.append(profile.at(np.interp(own, warp, aligned.progress)))
    return result


def covariances_of_takes(demonstrations: Sequence[Demonstration]) -> np.ndarray:
    """
    Covariance of the position between the aligned takes, shrunk, shape ``(T, d, d)`` [m²].

    :raises DataError: with fewer than two takes, or without a position
    """
    return covariances(*_aligned_takes(demonstrations))


def covariances(takes: Aligned, size: int) -> np.ndarray:
    """:param size: of the position, the first numbers of each point"""
    positions = takes.points[:, :, :size]
    offset = positions - positions.mean(axis=0)
    freedom = len(positions) - 1
    raw = np.einsum('kti,ktj->tij', offset, offset) / freedom
    smooth = gaussian_filter1d(raw, SMOOTHING * (SAMPLES - 1), axis=0, mode='nearest')
    along = _directions(takes.mean[:, :size])
    return np.array([_shrunk(_at_least_along(item, direction), freedom)
                     for item, direction in zip(smooth, along)])


def _directions(path: np.ndarray) -> np.ndarray:
    """Direction of motion at each sample; 0 at rest."""
    velocity = np.gradient(path, axis=0)
    speed = np.linalg.norm(velocity, axis=1)
    moving = speed > MOVING * speed.max()
    return np.where(moving[:, None], velocity / np.where(moving, speed, 1.0)[:, None], 0.0)


def _at_least_along(covariance: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """The covariance with a variance along the path at least as large as the least across it."""
    if not direction.any():
        return covariance
    across = np.eye(len(direction)) - np.outer(direction, direction)
    # The smallest value belongs to the direction itself.
    least = np.linalg.eigvalsh(across @ covariance @ across)[1]
    missing = max(0.0, least - direction @ covariance @ direction)
    return np.asarray(covariance + missing * np.outer(direction, direction))


def _aligned_takes(demonstrations: Sequence[Demonstration]) -> tuple[Aligned, int]:
    if len(demonstrations) < LEAST_TAKES:
        raise DataError(f'stiffness from takes needs at least {LEAST_TAKES} takes, '
                        f'got {len(demonstrations)}')
    return align(demonstrations, moved=False), _position_size(demonstrations[0].manifold)


def _position_size(manifold: Manifold) -> int:
    first = manifold.factors[0]
    if not first.is_flat or first.size not in (2, 3):
        raise DataError(f'stiffness from takes: {manifold!r} does not begin with a position, '
                        'R² or R³')
    return int(first.size)


def _shrunk(covariance: np.ndarray, freedom: int) -> np.ndarray:
    """Covariance nearer to equal axes, the more so the fewer takes there are."""
    size = len(covariance)
    trace, squares = float(np.trace(covariance)), float((covariance ** 2).sum())
    spread = (freedom + 1.0 - 2.0 / size) * (squares - trace ** 2 / size)
    signal = (1.0 - 2.0 / size) * squares + trace ** 2
    share = min(1.0, signal / spread) if spread > 0.0 else 1.0
    return np.asarray((1.0 - share) * covariance + share * trace / size * np.eye(size))


def _stiffness(covariances: np.ndarray, least: float, most: float) -> np.ndarray:
    return _of_covariances(covariances, least, most, centred=False, floor=AGREEMENT ** 2)


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
    result = np.array([_symmetric(vectors, values, item) for vectors, values, item
                       in zip(directions, floored, work)])
    errors = np.where(excited > least, _errors(offset, force, result, directions, records.times,
                                               window) / floored, np.inf)
    values, vectors = np.linalg.eigh(result)
    clipped = np.einsum('tij,tj,tkj->tik', vectors, np.clip(values, k_min, k_max), vectors)
    profile = Demonstration(records.times, clipped, SymmetricPositiveDefinite(size))
    return ForceStiffness(np.array(profile.smoothed(smoothing).points), directions, errors,
                          errors <= KNOWN * (k_max - k_min))


def _symmetric(vectors: np.ndarray, values: np.ndarray, work: np.ndarray) -> np.ndarray:
    """Symmetric K with least ``Σ ‖K δx - f‖²``: ``K A + A K = B + Bᵀ``, A by eigenvectors."""
    both = vectors.T @ (work + work.T) @ vectors
    return np.asarray(vectors @ (both / np.add.outer(values, values)) @ vectors.T)


def _errors(offset: np.ndarray, force: np.ndarray, stiffness: np.ndarray, directions: np.ndarray,
            times: np.ndarray, window: float) -> np.ndarray:
    """
    Standard error of ``K A u`` in each direction u.

    From the differences between demonstrations, so that noise of one of them may be correlated in
    time.
    """
    count = len(offset)
    rest = force - np.einsum('tij,ntj->nti', stiffness, offset)
    along = np.einsum('nti,tij->ntj', offset, directions)
    scores = np.array([_windowed(np.einsum('ti,tj->tij', item, other), times, window)
                       for item, other in zip(rest, along)])
    return np.asarray(np.sqrt(count / (count - 1.0) * (scores ** 2).sum(axis=(0, 2))))


def _deviation(values: np.ndarray) -> np.ndarray:
    return np.asarray(values - values.mean(axis=0))


def _windowed(values: np.ndarray, times: np.ndarray, window: float) -> np.ndarray:
    """Sum over a window around each time, shorter at the ends."""
    total = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
    first = np.searchsorted(times, times - 0.5 * window)
    last = np.searchsorted(times, times + 0.5 * window, side='right')
    return np.asarray(total[last] - total[first])
