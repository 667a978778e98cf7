"""
Stiffness from several takes: high where they agree, low where they differ.

The inverse of the covariance between the time-aligned takes, as they are: not moved to a common
start or goal, because then all would agree there. Along the path a deviation cannot be told from
a difference in timing, which the alignment removes: the takes are not taken to agree better there
than across the path. With few takes a sample covariance has long and short axes by chance; it is
shrunk towards equal axes (oracle approximating shrinkage).

Source: Chen, Wiesel, Eldar, Hero 2010, eq. (23) for the shrinkage.
"""
from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import gaussian_filter1d

from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.errors import DataError
from gdmp_ros.learning.alignment import align, Aligned, SAMPLES
from gdmp_ros.learning.variance_stiffness import check_stiffness_bounds
from gdmp_ros.manifolds import Manifold
from gdmp_ros.manifolds.spd import SymmetricPositiveDefinite

#: Takes that agree within this standard deviation agree [m]: no arm follows more closely.
AGREEMENT = 0.0005
#: Standard deviation of the smoothing of covariances, in durations.
SMOOTHING = 0.02
#: A position moves if it is faster than this part of the largest speed.
MOVING = 0.02
#: Fewest takes that determine a covariance.
LEAST_TAKES = 2


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
    found, size = _aligned_takes(demonstrations)
    return found.progress, _stiffness(covariances(found, size), least, most)


def stiffness_of_each(demonstrations: Sequence[Demonstration], least: float = 200.0,
                      most: float = 800.0) -> list[np.ndarray]:
    """
    `stiffness_from_takes` at every sample of each take.

    :returns: for each demonstration, shape ``(T, d, d)`` [N/m]
    """
    check_stiffness_bounds(least, most)
    found, size = _aligned_takes(demonstrations)
    matrices = _stiffness(covariances(found, size), least, most)
    profile = Demonstration(found.progress, matrices, SymmetricPositiveDefinite(size))
    result = []
    for take, warp in zip(demonstrations, found.warps):
        own = (take.times - take.times[0]) / take.duration
        result.append(profile.at(np.interp(own, warp, found.progress)))
    return result


def covariances_of_takes(demonstrations: Sequence[Demonstration]) -> np.ndarray:
    """
    Covariance of the position between the aligned takes, shrunk, shape ``(T, d, d)`` [m²].

    :raises DataError: with fewer than two takes, or without a position
    """
    return covariances(*_aligned_takes(demonstrations))


def covariances(found: Aligned, size: int) -> np.ndarray:
    """:param size: of the position, the first numbers of each point"""
    positions = found.points[:, :, :size]
    away = positions - positions.mean(axis=0)
    freedom = len(positions) - 1
    raw = np.einsum('kti,ktj->tij', away, away) / freedom
    smooth = gaussian_filter1d(raw, SMOOTHING * (SAMPLES - 1), axis=0, mode='nearest')
    along = _directions(found.mean[:, :size])
    return np.array([_shrunk(_at_least_along(one, direction), freedom)
                     for one, direction in zip(smooth, along)])


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


def _stiffness(found: np.ndarray, least: float, most: float) -> np.ndarray:
    values, vectors = np.linalg.eigh(found)
    values = np.maximum(values, 0.0) + AGREEMENT ** 2
    span = np.log(values.max() / values.min())
    power = min(1.0, np.log(most / least) / span) if span > 0.0 else 1.0
    stiffness = most * (values.min() / values) ** power
    result = np.einsum('tij,tj,tkj->tik', vectors, stiffness, vectors)
    return np.asarray(0.5 * (result + result.transpose(0, 2, 1)))
