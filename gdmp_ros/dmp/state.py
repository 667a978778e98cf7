"""One moment of a motion, as `gdmp_ros.dmp.Rollout.advance` returns it."""
from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gdmp_ros.manifolds import Manifold

# Looked up once: states are made a thousand times a second.
_new = object.__new__


class State:
    """
    One moment of a motion; its parts are views of one array, cut when they are asked for.

    :ivar time: since the roll-out began [s]
    :ivar phase: x, from 1 towards 0
    :ivar point: shape ``point_shape``
    :ivar velocity: tangent at the point [1/s], shape ``(tangent_size,)``
    :ivar acceleration: covariant, at the point [1/s²], shape ``(tangent_size,)``
    """

    __slots__ = ('_numbers', '_manifold')

    #: Time, phase, point, velocity and acceleration one after another.
    _numbers: np.ndarray
    _manifold: Manifold

    @classmethod
    def of(cls, numbers: np.ndarray, manifold: Manifold) -> State:
        """Make a state of its numbers, without copying them."""
        state = _new(cls)
        state._numbers, state._manifold = numbers, manifold
        return state

    @property
    def time(self) -> float:
        return float(self._numbers[0])

    @property
    def phase(self) -> float:
        return float(self._numbers[1])

    @property
    def point(self) -> np.ndarray:
        size, shape = self._manifold.point_size, self._manifold.point_shape
        return self._numbers[2:2 + size].reshape(shape)

    @property
    def velocity(self) -> np.ndarray:
        first = 2 + self._manifold.point_size
        return self._numbers[first:first + self._manifold.tangent_size]

    @property
    def acceleration(self) -> np.ndarray:
        return self._numbers[2 + self._manifold.point_size + self._manifold.tangent_size:]

    def __iter__(self) -> Iterator[float | np.ndarray]:
        """Time, phase, point, velocity, acceleration."""
        return iter((self.time, self.phase, self.point, self.velocity, self.acceleration))

    def __repr__(self) -> str:
        return (f'State(time={self.time!r}, phase={self.phase!r}, point={self.point!r}, '
                f'velocity={self.velocity!r}, acceleration={self.acceleration!r})')
