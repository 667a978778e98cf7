"""Stability of a stiffness profile by itself, whatever moves the arm."""
from __future__ import annotations

import numpy as np


def growth_margin(times: np.ndarray, stiffness: np.ndarray, damping: np.ndarray,
                  inertia: np.ndarray) -> tuple[float, float]:
    """
    Test the sufficient condition of Kronander and Billard, IEEE T-RO 2016.

    ``H ẍ + D ẋ + K x = 0`` with varying K and D is stable if for some α both ``α H - D`` and
    ``K̇ + α Ḋ - 2 α K`` are negative semidefinite.

    :param times: of the samples [s], shape ``(T,)``
    :param stiffness: shape ``(T, m, m)``
    :param damping: shape ``(T, m, m)``
    :param inertia: H, shape ``(m, m)``
    :returns: the best α [1/s], and the largest eigenvalue of the second matrix over the profile:
        stable if it is not positive
    """
    factor = np.linalg.inv(np.linalg.cholesky(inertia))
    most = float(np.linalg.eigvalsh(factor @ damping @ factor.T).min())
    growth, change = np.gradient(stiffness, times, axis=0), np.gradient(damping, times, axis=0)

    def worst(alpha: float) -> float:
        condition = growth + alpha * change - 2.0 * alpha * stiffness
        return float(np.linalg.eigvalsh(condition).max())

    alphas = np.geomspace(1e-3 * max(most, 1e-9), max(most, 1e-9), 200)
    values = [worst(alpha) for alpha in alphas]
    best = int(np.argmin(values))
    return float(alphas[best]), values[best]
