"""Fourier series in a tangent space, and their smooth fit."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import eigh

from gdmp_ros.learning.ridge import INFLATION

#: Strengths of the penalty that are tried, relative to that of the first harmonic.
STRENGTHS = np.logspace(-24.0, 1.0, 101)


def columns(progress: np.ndarray, harmonics: int) -> np.ndarray:
    """Constant, then cosine and sine of each harmonic, at each progress [cycles]."""
    angle = 2.0 * np.pi * np.outer(progress, np.arange(1, harmonics + 1))
    result = np.ones((len(progress), 1 + 2 * harmonics))
    result[:, 1::2], result[:, 2::2] = np.cos(angle), np.sin(angle)
    return result


class Series(NamedTuple):
    """
    A Fourier series in the tangent space of a centre.

    :ivar coefficients: constant; then cosine and sine of each harmonic, shape ``(1 + 2 K, n)``
    """

    coefficients: np.ndarray

    def at(self, progress: np.ndarray) -> np.ndarray:
        """Coordinates, shape ``(len(progress), n)``."""
        return np.asarray(columns(progress, self.harmonics) @ self.coefficients)

    def slope(self, progress: np.ndarray) -> np.ndarray:
        """Derivative by progress, shape ``(len(progress), n)``."""
        turned = np.zeros_like(self.coefficients)
        order = 2.0 * np.pi * np.arange(1, self.harmonics + 1)[:, None]
        turned[1::2] = order * self.coefficients[2::2]
        turned[2::2] = -order * self.coefficients[1::2]
        return np.asarray(columns(progress, self.harmonics) @ turned)

    @property
    def harmonics(self) -> int:
        """Number of harmonics."""
        return len(self.coefficients) // 2


class Smoother:
    """Regression on a Fourier series, with a penalty on the third derivative."""

    def __init__(self, matrix: np.ndarray, harmonics: int):
        self._matrix = matrix
        penalty = np.repeat(np.arange(1.0, harmonics + 1.0) ** 6, 2)
        gram = matrix.T @ matrix
        gram[np.diag_indices_from(gram)] *= 1.0 + 1e-13
        self._penalties, self._basis = eigh(np.diag([0.0, *penalty]), gram)
        self._penalties = np.maximum(self._penalties, 0.0) * len(matrix)

    def fitted(self, wanted: np.ndarray) -> np.ndarray:
        """Coefficients, with the strength of the penalty that cross-validation chooses."""
        found = self._basis.T @ (self._matrix.T @ wanted)
        outside = float(((wanted - self._matrix @ (self._basis @ found)) ** 2).sum())
        kept = 1.0 / (1.0 + STRENGTHS[:, None] * self._penalties)
        residual = outside + (1.0 - kept) ** 2 @ (found ** 2).sum(axis=1)
        freedom = 1.0 - INFLATION * kept.sum(axis=1) / len(wanted)
        scores = np.where(freedom > 0.0, residual / np.maximum(freedom, 1e-9) ** 2, np.inf)
        return np.asarray(self._basis @ (kept[int(np.argmin(scores))][:, None] * found))
