"""One moment of a motion, as `gdmp_ros.dmp.Rollout.advance` returns it."""
from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gdmp_ros.manifolds import Manifold


class State:
    """
    One moment of a motion; its parts are views of one array, cut when they are asked for.

    :ivar time: since the roll-out began [s]
    :ivar phase: x, from 1 towards 0; of a rhythmic motion φ, 0 to 2π
    :ivar point: shape ``point_shape``
    :ivar velocity: tangent at the point [1/s], shape ``(tangent_size,)``
    :ivar acceleration: covariant, at the point [1/s²], shape ``(tangent_size,)``
    """

    __slots__ = ('numbers', 'manifold')

    def __init__(self, numbers: np.ndarray, manifold: Manifold):
        """:param numbers: time, phase, point, velocity, acceleration; not copied"""
        self.numbers = numbers
        self.manifold = manifold

    @property
    def time(self) -> float:
        return float(self.numbers[0])

    @property
    def phase(self) -> float:
        return float(self.numbers[1])

    @property
    def point(self) -> np.ndarray:
        size, shape = self.manifold.point_size, self.manifold.point_shape
        return self.numbers[2:2 + size].reshape(shape)

    @property
    def velocity(self) -> np.ndarray:
        first = 2 + self.manifold.point_size
        return self.numbers[first:first + self.manifold.tangent_size]

    @property
    def acceleration(self) -> np.ndarray:
        return self.numbers[2 + self.manifold.point_size + self.manifold.tangent_size:]

    def __iter__(self) -> Iterator[float | np.ndarray]:
        """Time, phase, point, velocity, acceleration."""
        return iter((self.time, self.phase, self.point, self.velocity, self.acceleration))

    def __repr__(self) -> str:
        return (f'State(time={self.time!r}, phase={self.phase!r}, point={self.point!r}, '
                f'velocity={self.velocity!r}, acceleration={self.acceleration!r})')
