"""Start and goal of a demonstration: local fits, because a single sample has all of its noise."""
from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gdmp_ros.dmp.demonstration import Demonstration

#: Largest part of a demonstration that an end is estimated from, and fewest samples.
SHARE, LEAST = 0.05, 5
#: Ratio of one window to the next smaller one.
_GROWTH = 1.4
#: Estimates from two windows are consistent within this many standard errors.
_CONSISTENT = 2.0


class Endpoint(NamedTuple):
    """
    An end of a demonstration.

    :ivar point: shape ``point_shape``
    :ivar velocity: by progress, coordinates in the canonical frame of the first (last) sample,
        shape ``(tangent_size,)``
    :ivar velocity_error: standard error of each coordinate of ``velocity``
    :ivar noise: standard deviation of a sample, for each factor
    """

    point: np.ndarray
    velocity: np.ndarray
    velocity_error: np.ndarray
    noise: tuple[float, ...]


def start_of(demonstration: Demonstration) -> Endpoint:
    """Estimate the start of a uniform demonstration."""
    return _endpoint(demonstration, demonstration.points, 1.0)


def goal_of(demonstration: Demonstration) -> Endpoint:
    """Estimate the goal of a uniform demonstration."""
    return _endpoint(demonstration, demonstration.points[::-1], -1.0)


def _endpoint(demonstration: Demonstration, points: np.ndarray, direction: float) -> Endpoint:
    """:param points: samples, beginning at the end that is wanted"""
    manifold, count = demonstration.manifold, len(points)
    used = points[:max(LEAST, math.ceil(SHARE * count))]
    frame = manifold.frame(used[0])
    local = np.array([manifold.log_in_frame(frame, point)[0] for point in used])
    value, velocity, error = (np.zeros(manifold.tangent_size) for _ in range(3))
    noise = []
    for columns in manifold.tangent_slices:
        sd = noise_level(local[:, columns])
        noise.append(sd)
        value[columns], slope, slope_error = _local_fit(local[:, columns], sd)
        velocity[columns] = direction * slope * (count - 1)
        error[columns] = slope_error * (count - 1)
    point = manifold.exp(used[0], manifold.from_frame(frame, value))
    return Endpoint(point, velocity, error, tuple(noise))


def noise_level(samples: np.ndarray) -> float:
    """
    Standard deviation of the noise of a coordinate, from third differences.

    :param samples: equally spaced in time, shape ``(samples, n)``
    """
    differences = np.diff(samples, n=3, axis=0)
    # The variance of a third difference is 1 + 9 + 9 + 1 times that of a sample.
    return math.sqrt(float((differences ** 2).mean()) / 20.0)


def _local_fit(samples: np.ndarray, noise: float) -> tuple[np.ndarray, np.ndarray, float]:
    """
    Quadratic fit to the largest window that is consistent with all smaller ones (Lepski's method).

    :returns: value, slope per sample, and standard error of a coordinate of the slope
    """
    fits: list[tuple[np.ndarray, float]] = []
    best: tuple[np.ndarray, np.ndarray, float] | None = None
    for size in _windows(len(samples)):
        powers = np.vander(np.arange(size) / (size - 1.0), 3, increasing=True)
        covariance = np.linalg.inv(powers.T @ powers)
        value, slope, _ = covariance @ (powers.T @ samples[:size])
        error = noise * math.sqrt(covariance[0, 0] * samples.shape[1])
        if best is not None and any(
                np.linalg.norm(value - other) > _CONSISTENT * their_error
                for other, their_error in fits):
            return best
        fits.append((value, error))
        best = (value, slope / (size - 1.0),
                noise * math.sqrt(covariance[1, 1]) / (size - 1.0))
    if best is None:
        raise ValueError(f'{len(samples)} samples, expected at least {LEAST}')
    return best


def _windows(most: int) -> list[int]:
    sizes, size = [], LEAST
    while size < most:
        sizes.append(size)
        size = math.ceil(_GROWTH * size)
    return [*sizes, most]
