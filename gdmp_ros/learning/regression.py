"""
Linear regressions with a penalty on the third derivative, and those of the forcing term.

The strength of a penalty is chosen by generalised cross-validation.
"""
from __future__ import annotations

from dataclasses import dataclass
import functools
import math
from typing import NamedTuple

import numpy as np
from scipy.linalg import (
    cho_factor,
    cho_solve,
    cholesky,
    eigh,
    LinAlgError,
    lstsq,
    qr,
    solve_triangular,
    svd,
)

from gdmp_ros.dmp.forcing import design_matrix
from gdmp_ros.dmp.primitive import Gains
from gdmp_ros.dmp.response import LAST, responses, third_derivatives

#: Weight of the samples at the goal after the end, relative to those of the demonstration: letters
#: that end at speed pass their goal by at most 0.5 % of the span.
HOLD_WEIGHT = 6.5
#: Degrees of freedom count this many times in the cross-validation: against too little smoothing.
INFLATION = 1.4
#: Strengths of the penalty that are tried, relative to the largest singular value squared.
STRENGTHS = np.logspace(-22.0, 2.0, 73)
#: Strengths of the penalty that are tried, relative to that of the first harmonic.
FOURIER_STRENGTHS = np.logspace(-24.0, 1.0, 101)


def scaled_design_matrix(functions: np.ndarray, alpha_x: float,
                         s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """
    Design matrix with columns of unit length, and their original lengths.

    Without scaling, the pivots of the normal equations would span two decades, as the phase does.
    """
    matrix = np.empty((s.size, functions.shape[1]))
    design_matrix(functions, alpha_x, s, matrix)
    lengths = np.sqrt(np.einsum('ij,ij->j', matrix, matrix))
    lengths[lengths == 0.0] = 1.0
    matrix /= lengths
    return matrix, lengths


def regress(functions: np.ndarray, alpha_x: float, s: np.ndarray, target: np.ndarray,
            ridge: float = 0.0) -> np.ndarray:
    """
    Least-squares weights of all outputs at once, shape ``(functions, outputs)``.

    If every basis function covers samples, the normal equations are well conditioned (about 400
    for 60 functions); otherwise an orthogonal factorisation gives the shortest weights.

    :param s: sample times in durations, shape ``(samples,)``
    :param target: forcing to reproduce, shape ``(samples, outputs)``
    :param ridge: added to the diagonal of the normal equations, whose entries are 1
    """
    matrix, lengths = scaled_design_matrix(functions, alpha_x, s)
    normal = matrix.T @ matrix
    normal[np.diag_indices_from(normal)] += ridge
    try:
        factor = cho_factor(normal, check_finite=False)
        pivots = np.diag(factor[0])
        if pivots.min() > 1e-5 * pivots.max():
            solved = cho_solve(factor, matrix.T @ target, check_finite=False)
            return np.ascontiguousarray(solved / lengths[:, None])
    except LinAlgError:
        pass
    solved = lstsq(matrix, target, check_finite=False)[0]
    return np.ascontiguousarray(solved / lengths[:, None])


@dataclass(frozen=True)
class Rows:
    """
    Which rows the regression has.

    :ivar progress: of the samples of each demonstration
    :ivar weights: of the demonstrations, 1 on average
    :ivar rests: whether samples at the goal follow
    """

    progress: tuple[tuple[float, ...], ...]
    weights: tuple[float, ...]
    rests: bool

    @functools.cached_property
    def _arrays(self) -> list[np.ndarray]:
        return [np.array(progress) for progress in self.progress]

    def of(self, number: int) -> np.ndarray:
        """Progress of the rows of one demonstration."""
        demo = self._arrays[number]
        if not self.rests:
            return demo
        return np.concatenate([demo, np.linspace(1.0, LAST, self.holds(number) + 1)[1:]])

    def holds(self, number: int) -> int:
        """Number of samples at the goal after the end."""
        return math.ceil((LAST - 1.0) * len(self.progress[number])) if self.rests else 0

    def scale(self, number: int) -> np.ndarray:
        """Square root of the weight of each row: the number of samples does not count."""
        mean = sum(map(len, self.progress)) / len(self.progress)
        own = len(self.progress[number])
        weights = np.ones(own + self.holds(number))
        weights[own:] = HOLD_WEIGHT
        return np.sqrt(self.weights[number] * mean / own * weights)


class Regression(NamedTuple):
    """
    Ridge regression in the basis in which matrix and penalty are diagonal.

    :ivar basis: orthonormal, shape ``(rows, columns)``
    :ivar singular: singular values of the matrix relative to the penalty
    :ivar back: coordinates in the basis to solution
    :ivar matrix: shape ``(rows, columns)``
    :ivar smoothest: solution of the smoothest motion to a goal at distance 1
    """

    basis: np.ndarray
    singular: np.ndarray
    back: np.ndarray
    matrix: np.ndarray
    smoothest: np.ndarray


@functools.lru_cache(maxsize=8)
def regression(count: int, gains: Gains, rows: Rows, moving: bool) -> Regression:
    """:param moving: whether the start velocity is a column too"""
    response = responses(count, gains)
    columns = slice(0 if moving else 1, None)
    matrix = np.vstack([rows.scale(k)[:, None] * response.at(rows.of(k))[1][:, columns]
                        for k in range(len(rows.progress))])
    nodes = response.progress <= (LAST if rows.rests else 1.0)
    rough = third_derivatives(response.motion[nodes][:, columns])
    scale = np.sqrt((rough ** 2).sum() / rough.shape[1])
    rough /= scale
    root = cholesky(rough.T @ rough + 1e-10 * np.eye(rough.shape[1]), lower=True)
    smoothest = -cho_solve((root, True), rough.T @ third_derivatives(response.goal[nodes]) / scale)
    orthonormal, triangle = qr(matrix, mode='economic')
    whitened = solve_triangular(root, triangle.T, lower=True).T
    left, singular, right = svd(whitened)
    return Regression(orthonormal @ left[:, :len(singular)], singular,
                      solve_triangular(root, right[:len(singular)].T, lower=True, trans='T'),
                      matrix, smoothest)


class Ridge(NamedTuple):
    """A solution and its score in generalised cross-validation."""

    solution: np.ndarray
    score: float


def solve(regression: Regression, target: np.ndarray, goal: np.ndarray) -> Ridge:
    """
    Choose the strength of the penalty by generalised cross-validation.

    :param target: what the responses have to add up to, shape ``(rows, n)``
    :param goal: coordinates from the start, shape ``(n,)``; the motion to it is to be smooth
    """
    smoothest = regression.smoothest[:, None] * goal
    target = target - regression.matrix @ smoothest
    coordinates = regression.basis.T @ target
    # Computed directly: the difference of two sums of squares has no digits left on clean data.
    outside = float(((target - regression.basis @ coordinates) ** 2).sum())
    strengths = regression.singular[0] ** 2 * STRENGTHS
    kept = regression.singular ** 2 / (regression.singular ** 2 + strengths[:, None])
    best, score = _cross_validated(kept, coordinates, outside, len(target))
    gains = regression.singular / (regression.singular ** 2 + strengths[best])
    return Ridge(smoothest + regression.back @ (gains[:, None] * coordinates), score)


def _cross_validated(kept: np.ndarray, coordinates: np.ndarray, outside: float, rows: int
                     ) -> tuple[int, float]:
    """
    Strength of a penalty with the best score in generalised cross-validation, and this score.

    :param kept: part of each coordinate that is kept at each strength, shape ``(strengths, n)``
    :param coordinates: of what is fitted, shape ``(n, outputs)``
    :param outside: sum of the squares that no strength explains
    :param rows: number of samples
    """
    residual = outside + (1.0 - kept) ** 2 @ (coordinates ** 2).sum(axis=1)
    freedom = 1.0 - INFLATION * kept.sum(axis=1) / rows
    scores = np.where(freedom > 0.0, residual / rows / np.maximum(freedom, 1e-9) ** 2, np.inf)
    best = int(np.argmin(scores))
    return best, float(scores[best])


class Smoother(NamedTuple):
    """
    Linear maps between weights and the motion that they add.

    :ivar motion: from weights to deviations, shape ``(samples, n_basis)``
    :ivar weights: from deviations to weights, shape ``(n_basis, samples)``
    """

    motion: np.ndarray
    weights: np.ndarray


def smoother(count: int, gains: Gains, progress: np.ndarray, wavelength: float) -> Smoother:
    """
    Compute the maps; after the end there is no deviation.

    :param count: of the basis functions
    :param progress: of the samples, equally spaced from 0 to 1
    :param wavelength: shortest of a deviation, in durations
    """
    response = responses(count, gains)
    spacing = progress[1]
    held = np.arange(1.0 + spacing, LAST, spacing)
    matrix = response.at(np.concatenate([progress, held]))[1][:, 1:]
    rough = third_derivatives(response.motion[:, 1:])
    normal = spacing * matrix.T @ matrix + (wavelength / (2.0 * np.pi)) ** 6 * rough.T @ rough
    normal[np.diag_indices(count)] += 1e-12 * np.trace(normal) / count
    motion = matrix[:len(progress)]
    return Smoother(motion, np.linalg.solve(normal, spacing * motion.T))


def fourier_columns(progress: np.ndarray, harmonics: int) -> np.ndarray:
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
        return np.asarray(fourier_columns(progress, self.harmonics) @ self.coefficients)

    def slope(self, progress: np.ndarray) -> np.ndarray:
        """Derivative by progress, shape ``(len(progress), n)``."""
        turned = np.zeros_like(self.coefficients)
        order = 2.0 * np.pi * np.arange(1, self.harmonics + 1)[:, None]
        turned[1::2] = order * self.coefficients[2::2]
        turned[2::2] = -order * self.coefficients[1::2]
        return np.asarray(fourier_columns(progress, self.harmonics) @ turned)

    @property
    def harmonics(self) -> int:
        """Number of harmonics."""
        return len(self.coefficients) // 2


class FourierRegression:
    """Regression on a Fourier series, with a penalty on the third derivative."""

    def __init__(self, matrix: np.ndarray, harmonics: int):
        self._matrix = matrix
        penalty = np.repeat(np.arange(1.0, harmonics + 1.0) ** 6, 2)
        gram = matrix.T @ matrix
        gram[np.diag_indices_from(gram)] *= 1.0 + 1e-13
        self._penalties, self._basis = eigh(np.diag([0.0, *penalty]), gram)
        self._penalties = np.maximum(self._penalties, 0.0) * len(matrix)

    def fitted(self, target: np.ndarray) -> np.ndarray:
        """Coefficients, with the strength of the penalty that cross-validation chooses."""
        coordinates = self._basis.T @ (self._matrix.T @ target)
        outside = float(((target - self._matrix @ (self._basis @ coordinates)) ** 2).sum())
        kept = 1.0 / (1.0 + FOURIER_STRENGTHS[:, None] * self._penalties)
        best, _ = _cross_validated(kept, coordinates, outside, len(target))
        return np.asarray(self._basis @ (kept[best][:, None] * coordinates))
