"""Points as arrays: shapes, names, validation."""
from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
import math
from typing import Any, ClassVar, final

import numpy as np

from gdmp_ros.errors import InvalidPointError, ManifoldError

#: Largest size parameter: above it the frames do not fit into memory.
MAX_SIZE = 1000
_NOT_FINITE = 'an entry is NaN or infinite'


def kernel_array(array: np.ndarray) -> np.ndarray:
    """Contiguous, writable float64, as kernels are compiled for; copied only if needed."""
    made = np.asarray(array, dtype=np.float64, order='C')
    return made if made.flags.writeable else made.copy()


def first_of(wrong: np.ndarray, reason: Callable[[int], str]) -> tuple[int, str] | None:
    """
    First of several arrays that is wrong, and why.

    :param wrong: which of them are, shape ``(count,)``
    :param reason: says it of one
    """
    at = int(np.argmax(wrong))
    return (at, reason(at)) if wrong[at] else None


def earliest(*found: tuple[int, str] | None) -> tuple[int, str] | None:
    """The first in a sequence of several findings; of equal ones, the first that is given."""
    return min((one for one in found if one is not None), default=None, key=lambda one: one[0])


class PointSpace(ABC):
    """
    A set of points, each a float64 array of one shape, with flat vectors as tangents.

    :ivar size: size parameter
    :ivar dim: dimension
    :ivar point_shape: shape of a point
    :ivar point_size: numbers in a point
    :ivar tangent_size: numbers in a tangent
    :ivar frame_size: numbers in a frame (`gdmp_ros.manifolds.factors`)
    """

    #: Name in files and parameters.
    kind: ClassVar[str]
    #: Unit of points and tangents, for files and pictures.
    unit: ClassVar[str]
    #: `check_point` accepts a deviation up to this.
    tolerance: ClassVar[float] = 1e-6

    def __init__(self, size: int, *, dim: int, point_shape: tuple[int, ...], tangent_size: int,
                 frame_size: int):
        self.size = size
        self.dim = dim
        self.point_shape = point_shape
        self.point_size = math.prod(point_shape)
        self.tangent_size = tangent_size
        self.frame_size = frame_size

    @abstractmethod
    def nearest_point(self, array: np.ndarray) -> np.ndarray:
        """Nearest point to a finite array of the right shape."""

    @abstractmethod
    def first_invalid(self, points: np.ndarray) -> tuple[int, str] | None:
        """
        First of several arrays that is not a point, and why; None if all are points.

        :param points: finite, shape ``(count, *point_shape)``; at least one
        """

    @abstractmethod
    def random_point(self, rng: np.random.Generator) -> np.ndarray:
        """Draw a point."""

    def align(self, point: np.ndarray, reference: np.ndarray) -> np.ndarray:
        """Of all points with the same meaning, return the one nearest to ``reference``."""
        return point

    def continuous(self, points: np.ndarray) -> np.ndarray:
        """
        Each point as the one of the same meaning that is nearest to the point before it.

        :param points: shape ``(count, *point_shape)``
        """
        made = points.copy()
        for i in range(1, len(made)):
            made[i] = self.align(made[i], made[i - 1])
        return made

    @property
    def components(self) -> list[tuple[str, int]]:
        """Name and index in a flat point of each number worth plotting."""
        names = 'xyz' if self.point_size <= 3 else [str(i + 1) for i in range(self.point_size)]
        return [(name, i) for i, name in zip(range(self.point_size), names)]

    def spec(self) -> dict[str, object]:
        """Describe the manifold for files and parameters (`gdmp_ros.manifolds.from_spec`)."""
        return {'kind': self.kind, 'm': self.size}

    @final
    def project(self, array: np.ndarray) -> np.ndarray:
        """
        Nearest point to an array of shape `point_shape`.

        :raises ManifoldError: if there is none (the zero vector, a NaN)
        """
        return self.nearest_point(self._finite(array))

    @final
    def check_point(self, array: np.ndarray) -> np.ndarray:
        """
        Return ``array`` as a float64 point of shape `point_shape`.

        :raises ManifoldError: if it is not a point within `tolerance`; the message says why
        """
        point = self.flat(array).reshape(self.point_shape)
        self.check_points(point[None])
        return point

    @final
    def check_points(self, points: np.ndarray) -> None:
        """
        Check several points.

        :param points: shape ``(count, *point_shape)``
        :raises InvalidPointError: if one is not a point within `tolerance`; says which, and why
        """
        finite = np.isfinite(points.reshape(len(points), -1)).all(axis=1)
        count = len(points) if finite.all() else int(np.argmin(finite))
        found = self.first_invalid(points[:count]) if count else None
        if found is None and count < len(points):
            found = count, _NOT_FINITE
        if found is not None:
            raise InvalidPointError(f'{self!r}: {found[1]}', found[0])

    @final
    def flat(self, point: np.ndarray) -> np.ndarray:
        """
        A point as a flat float64 vector for kernels.

        :raises ManifoldError: if the shape is wrong
        """
        array = kernel_array(point)
        if array.shape != self.point_shape:
            raise self.error(f'shape is {array.shape}, expected {self.point_shape}')
        return array.reshape(-1)

    @final
    def vector(self, tangent: np.ndarray) -> np.ndarray:
        """
        A tangent as a float64 vector for kernels.

        :raises ManifoldError: if the shape is wrong
        """
        array = kernel_array(tangent)
        if array.shape != (self.tangent_size,):
            raise self.error(f'tangent shape is {array.shape}, expected {(self.tangent_size,)}')
        return array

    def error(self, reason: str) -> ManifoldError:
        """Error that names this manifold."""
        return ManifoldError(f'{self!r}: {reason}')

    def _finite(self, array: np.ndarray) -> np.ndarray:
        point = self.flat(array).reshape(self.point_shape)
        if not np.isfinite(point).all():
            raise self.error(_NOT_FINITE)
        return point

    def _first_not_of_unit_norm(self, points: np.ndarray, name: str) -> tuple[int, str] | None:
        norms = np.linalg.norm(points, axis=1)
        return first_of(~(np.abs(norms - 1.0) <= self.tolerance), lambda i:
                        f'{name} is {norms[i]:.9g}, expected 1 within {self.tolerance:g}')

    @classmethod
    def _check_size(cls, size: Any, least: int) -> int:
        if (not isinstance(size, (int, np.integer)) or isinstance(size, bool)
                or not least <= size <= MAX_SIZE):
            raise ManifoldError(f'{cls.__name__}: m must be an integer from {least} to '
                                f'{MAX_SIZE}, got {size!r}')
        return int(size)

    def __repr__(self) -> str:
        return f'{type(self).__name__}({self.size})'

    def __eq__(self, other: object) -> bool:
        return isinstance(other, PointSpace) and self.spec() == other.spec()

    def __hash__(self) -> int:
        return hash(repr(self.spec()))
