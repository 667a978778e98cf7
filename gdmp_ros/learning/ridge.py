"""Regression on the responses of the system, with a penalty on the third derivative."""
from __future__ import annotations

from dataclasses import dataclass
import functools
import math
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_solve, cholesky, qr, solve_triangular, svd

from gdmp_ros.dmp.primitive import Gains
from gdmp_ros.dmp.response import LAST, responses, third_derivatives

#: Weight of the samples at the goal after the end, relative to those of the demonstration: letters
#: that end at speed pass their goal by at most 0.5 % of the span.
HOLD_WEIGHT = 6.5
#: Degrees of freedom count this many times in the cross-validation: against too little smoothing.
INFLATION = 1.4
#: Strengths of the penalty that are tried, relative to the largest singular value squared.
STRENGTHS = np.logspace(-22.0, 2.0, 73)


@dataclass(frozen=True)
class Rows:
    """
    Which rows the regression has.

    :ivar progress: of the samples of each demonstration: first, last, how many
    :ivar weights: of the demonstrations, 1 on average
    :ivar rests: whether samples at the goal follow
    """

    progress: tuple[tuple[float, float, int], ...]
    weights: tuple[float, ...]
    rests: bool

    def of(self, number: int) -> np.ndarray:
        """Progress of the rows of one demonstration."""
        first, last, count = self.progress[number]
        shown = np.linspace(first, last, count)
        if not self.rests:
            return shown
        return np.concatenate([shown, np.linspace(1.0, LAST, self.holds(number) + 1)[1:]])

    def holds(self, number: int) -> int:
        """Number of samples at the goal after the end."""
        return math.ceil((LAST - 1.0) * self.progress[number][2]) if self.rests else 0

    def scale(self, number: int) -> np.ndarray:
        """Square root of the weight of each row: the number of samples does not count."""
        mean = sum(count for _, _, count in self.progress) / len(self.progress)
        own = self.progress[number][2]
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


def solve(regression: Regression, wanted: np.ndarray, goal: np.ndarray) -> Ridge:
    """
    Choose the strength of the penalty by generalised cross-validation.

    :param wanted: what the responses have to add up to, shape ``(rows, n)``
    :param goal: coordinates from the start, shape ``(n,)``; the motion to it is to be smooth
    """
    smoothest = regression.smoothest[:, None] * goal
    wanted = wanted - regression.matrix @ smoothest
    found = regression.basis.T @ wanted
    # Computed directly: the difference of two sums of squares has no digits left on clean data.
    outside = float(((wanted - regression.basis @ found) ** 2).sum())
    squares, rows = (found ** 2).sum(axis=1), len(wanted)
    strengths = regression.singular[0] ** 2 * STRENGTHS
    kept = regression.singular ** 2 / (regression.singular ** 2 + strengths[:, None])
    residual = outside + (1.0 - kept) ** 2 @ squares
    freedom = 1.0 - INFLATION * kept.sum(axis=1) / rows
    scores = np.where(freedom > 0.0, residual / rows / np.maximum(freedom, 1e-9) ** 2, np.inf)
    best = int(np.argmin(scores))
    gains = regression.singular / (regression.singular ** 2 + strengths[best])
    return Ridge(smoothest + regression.back @ (gains[:, None] * found), float(scores[best]))
