"""
The motion of the dynamical system as a linear function of its weights.

On a flat space the motion is the sum of the responses to the goal, to the start velocity and to
each basis function. The roll-out of a primitive on Rⁿ computes them: what is fitted with them is
what a roll-out does.
"""
from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np

from gdmp_ros.dmp.primitive import Gains, MIN_STEPS, Primitive
from gdmp_ros.dmp.rollout import Rollout
from gdmp_ros.manifolds.euclidean import Euclidean

#: Progress up to which responses are computed: the time after the end is data too.
LAST = 1.3


class Responses(NamedTuple):
    """
    Positions at equally spaced progress, from 0 to `LAST`.

    :ivar progress: shape ``(nodes,)``
    :ivar goal: response to a goal at distance 1, shape ``(nodes,)``
    :ivar motion: responses to a start velocity of 1 (column 0) and to a weight of 1 of each basis
        function, shape ``(nodes, 1 + functions)``
    """

    progress: np.ndarray
    goal: np.ndarray
    motion: np.ndarray

    def at(self, progress: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """``goal`` and ``motion``, interpolated."""
        place = np.asarray(progress) * MIN_STEPS
        node = np.minimum(place.astype(np.int64), len(self.progress) - 2)
        share = place - node
        goal = (1.0 - share) * self.goal[node] + share * self.goal[node + 1]
        motion = self.motion[node]
        motion += share[:, None] * (self.motion[node + 1] - motion)
        return goal, motion


@functools.lru_cache(maxsize=8)
def responses(count: int, gains: Gains) -> Responses:
    """Responses of the system with ``count`` basis functions."""
    manifold, outputs = Euclidean(count + 2), count + 2
    start, goal, velocity = (np.zeros(outputs) for _ in range(3))
    goal[0], velocity[1] = 1.0, 1.0
    weights = np.zeros((count, outputs))
    weights[:, 2:] = np.eye(count)
    primitive = Primitive(manifold, 'parallel', gains, start, goal, manifold.frame(start), 1.0,
                          velocity, weights, MIN_STEPS)
    progress = np.arange(round(LAST * MIN_STEPS) + 1) / MIN_STEPS
    points = Rollout(primitive).sample(progress).points
    return Responses(progress, points[:, 0].copy(), points[:, 1:].copy())


def response_to(target: np.ndarray, gains: Gains) -> np.ndarray:
    """
    Response to a target that moves, from rest at 0.

    The system is critically damped: two equal lags, each ``2 / alpha_z``.

    :param target: at the nodes of `Responses`, shape ``(nodes, n)``
    """
    ratio = 0.25 * gains.alpha_z / MIN_STEPS
    before, after = [ratio / (1.0 + ratio)] * 2, [1.0, (ratio - 1.0) / (1.0 + ratio)]
    from scipy.signal import lfilter  # slow to import
    once = lfilter(before, after, target, axis=0)
    return np.asarray(lfilter(before, after, once, axis=0))


def third_derivatives(response: np.ndarray) -> np.ndarray:
    """
    Third derivatives by progress; the sum of their squares is the integral of the square.

    :param response: at the nodes of `Responses`, shape ``(nodes, …)``
    """
    every = 4
    spacing = every / MIN_STEPS
    return np.asarray(np.diff(response[::every], n=3, axis=0) / spacing ** 2.5)
