"""The smallest error that a number of basis functions can reach on a curve."""
from __future__ import annotations

import functools

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import lsim

from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.development import Development
from gdmp_ros.dmp.forcing import basis, design_matrix
from gdmp_ros.dmp.primitive import Gains

#: Samples of the curve.
SAMPLES = 4001


def best_error(shown: Demonstration, n_basis: int = 60) -> float:
    """
    Mean error / span of the best weights for a demonstration.

    The curve is unrolled to Rⁿ. There the path of a primitive is linear in its weights: the
    response of the spring to the start, to the goal and to each basis function. Least squares of
    the positions give the best weights.
    """
    manifold = shown.manifold
    unrolled = Development(manifold, shown.flat_points, manifold.frame(shown.points[0])).unrolled
    curve = CubicSpline((shown.times - shown.times[0]) / shown.duration, unrolled)
    responses = _responses(n_basis, Gains())
    path = curve(np.linspace(0.0, 1.0, SAMPLES))
    # Without weights: from the start with its velocity, towards the goal.
    unforced = (path[0] + np.outer(responses.goal, path[-1] - path[0])
                + np.outer(responses.velocity, curve(0.0, 1)))
    weights = np.linalg.lstsq(responses.functions, path - unforced, rcond=None)[0]
    error = unforced + responses.functions @ weights - path
    return float(np.linalg.norm(error, axis=1).mean() / shown.span())


class _Responses:
    """
    Paths of the spring, at equally spaced times of one duration.

    :ivar functions: to each basis function, shape ``(SAMPLES, functions)``
    :ivar goal: to a goal at 1, with the start term
    :ivar velocity: to a start velocity of 1
    """

    def __init__(self, n_basis: int, gains: Gains):
        s = np.linspace(0.0, 1.0, SAMPLES)
        matrix = np.empty((SAMPLES, n_basis))
        design_matrix(basis(n_basis, gains.alpha_x), gains.alpha_x, s, matrix)
        stiffness = gains.alpha_z * gains.beta_z
        spring = (np.array([[0.0, 1.0], [-stiffness, -gains.alpha_z]]),
                  np.array([[0.0], [stiffness]]), np.array([[1.0, 0.0]]), 0.0)
        self.functions = np.array([lsim(spring, column, s)[1] for column in matrix.T]).T
        self.goal = lsim(spring, 1.0 - np.exp(-gains.alpha_x * s), s)[1]
        self.velocity = lsim(spring, np.zeros(SAMPLES), s, X0=[0.0, 1.0])[1]


@functools.cache
def _responses(n_basis: int, gains: Gains) -> _Responses:
    return _Responses(n_basis, gains)
