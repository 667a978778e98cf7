"""The interface of every manifold, and everything that follows from its kernels."""
from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from functools import cached_property
import math
from typing import Any, ClassVar, final

import numpy as np

from gdmp_ros.errors import CutLocusError, GdmpError, InvalidPointError, ManifoldError
from gdmp_ros.manifolds.factors import (
    CUT_LOCUS_LIMIT,
    distance_rows,
    exp_rows,
    factor_table,
    frame_point_rows,
    frame_rows,
    from_frame_rows,
    Kernels,
    log_in_frame_rows,
    log_rows,
    project_tangent_rows,
    to_frame_rows,
    transport_frame_rows,
)
from gdmp_ros.util.numeric import numbers

#: Largest size parameter: above it the frames do not fit into memory.
MAX_SIZE = 1000
#: Errors of rounding in a mean, relative to the numbers of its points.
ROUNDING = 1e-14
_NOT_FINITE = 'an entry is NaN or infinite'


def kernel_array(array: np.ndarray) -> np.ndarray:
    """Contiguous, writable float64, as kernels are compiled for; copied only if needed."""
    result = np.asarray(numbers('point or tangent', array, ManifoldError), order='C')
    return result if result.flags.writeable else result.copy()


def first_of(wrong: np.ndarray, reason: Callable[[int], str]) -> tuple[int, str] | None:
    """
    First of several arrays that is wrong, and why.

    :param wrong: which of them are, shape ``(count,)``
    :param reason: says it of one
    """
    at = int(np.argmax(wrong))
    return (at, reason(at)) if wrong[at] else None


def earliest(*invalid: tuple[int, str] | None) -> tuple[int, str] | None:
    """Of several results of `first_of`, that with the smallest index; the first one of equals."""
    return min((each for each in invalid if each is not None), default=None,
               key=lambda each: each[0])


class Manifold(ABC):
    """
    A Riemannian manifold: points, each a float64 array of one shape, and flat vectors as tangents.

    Every operation also accepts arrays with further axes in front, and then acts on each point:
    ``exp(bases, tangents)`` with shapes ``(k, *point_shape)`` and ``(k, tangent_size)``. The axes
    in front are broadcast as NumPy does.

    Laws, stated once in ``test/manifolds/test_laws.py`` for every manifold:

    * ``log(a, exp(a, v)) == v`` for v shorter than the distance to the cut locus;
    * ``exp(a, log(a, b)) == b`` away from the cut locus, and
      ``norm(a, log(a, b)) == distance(a, b)``;
    * ``transport`` keeps inner products, and carries ``log(a, b)`` to ``-log(b, a)``;
    * ``geodesic(a, b, t)`` has constant speed; at ``mean`` the gradient of the sum of squared
      distances is zero.

    A new manifold is one file that provides the class attributes, `nearest_point`,
    `first_invalid` and `random_point` (``docs/own_manifold.md``).

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
    #: The compiled operations.
    kernels: ClassVar[Kernels]
    #: Distance at which a goal counts as reached [unit of `distance`].
    goal_tolerance: ClassVar[float]
    #: Whether some pairs of points have several shortest geodesics.
    has_cut_locus: ClassVar[bool] = True
    #: A demonstration that comes this near the cut locus of its goal is split [rad].
    split_margin: ClassVar[float] = 0.0
    #: Whether the frame is the point itself and all tangent spaces are the same.
    is_flat: ClassVar[bool] = False

    def __init__(self, size: int, *, dim: int, point_shape: tuple[int, ...], tangent_size: int,
                 frame_size: int):
        self.size = size
        self.dim = dim
        self.point_shape = point_shape
        self.point_size = math.prod(point_shape)
        self.tangent_size = tangent_size
        self.frame_size = frame_size

    # What a manifold provides

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
        result = points.copy()
        for i in range(1, len(result)):
            result[i] = self.align(result[i], result[i - 1])
        return result

    @classmethod
    def of_size(cls, size: Any) -> Manifold:
        """
        Manifold of this kind with a size parameter, as a file gives it.

        :raises ManifoldError: if it is not a valid size
        """
        return cls(size)

    @property
    def components(self) -> list[tuple[str, int]]:
        """Name and index in a flat point of each number worth plotting."""
        names = 'xyz' if self.point_size <= 3 else [str(i + 1) for i in range(self.point_size)]
        return [(name, i) for i, name in zip(range(self.point_size), names)]

    def spec(self) -> dict[str, object]:
        """Describe the manifold for files and parameters (`gdmp_ros.manifolds.from_spec`)."""
        return {'kind': self.kind, 'm': self.size}

    @property
    def factors(self) -> tuple[Manifold, ...]:
        """The manifolds that this one is the product of: itself, unless it is a `Product`."""
        return (self,)

    @property
    def names(self) -> tuple[str, ...]:
        """One name for each factor."""
        return (self.kind,)

    @property
    def tangent_slices(self) -> list[slice]:
        """Where each factor's tangent lies in a tangent."""
        ends = np.cumsum([factor.tangent_size for factor in self.factors]).tolist()
        return [slice(begin, end) for begin, end in zip([0, *ends], ends)]

    @cached_property
    def point_slices(self) -> list[slice]:
        """Where each factor's point lies in a flat point."""
        ends = np.cumsum([factor.point_size for factor in self.factors]).tolist()
        return [slice(begin, end) for begin, end in zip([0, *ends], ends)]

    @cached_property
    def factor_table(self) -> np.ndarray:
        """The factors as compiled code sees them (`gdmp_ros.manifolds.factors`)."""
        return factor_table(self.factors)

    @cached_property
    def _work_size(self) -> int:
        return int(self.factor_table['work'].max())

    # Geodesics

    @final
    def exp(self, base: np.ndarray, tangent: np.ndarray) -> np.ndarray:
        """
        Point reached from ``base`` along the geodesic with velocity ``tangent`` in unit time.

        :param base: point, shape ``(..., *point_shape)``
        :param tangent: tangent at ``base``, shape ``(..., tangent_size)``
        :returns: shape ``(..., *point_shape)``
        :raises ManifoldError: if a shape is wrong
        """
        return self.unflat(self._rows(exp_rows, self.point_size, self.flat(base),
                                      self.vector(tangent)))

    @final
    def log(self, base: np.ndarray, point: np.ndarray) -> np.ndarray:
        """
        Tangent at ``base`` whose geodesic reaches ``point`` in unit time.

        :param base: point, shape ``(..., *point_shape)``
        :param point: the same
        :returns: shape ``(..., tangent_size)``
        :raises CutLocusError: within 1e-6 rad of the cut locus: the geodesic is not unique
        :raises ManifoldError: if a shape is wrong
        """
        tangent, distance = self.log_anyway(base, point)
        self._check_cut_locus(distance)
        return tangent

    @final
    def log_anyway(self, base: np.ndarray, point: np.ndarray) -> tuple[np.ndarray, Any]:
        """
        `log`, on the cut locus one of the shortest tangents.

        :returns: tangents, shape ``(..., tangent_size)``, and the distance of ``point`` from the
            cut locus of ``base`` [rad], shape ``(...)``
        """
        return self._log_rows(log_rows, self.flat(base), self.flat(point))

    @final
    def transport(self, source: np.ndarray, target: np.ndarray, tangent: np.ndarray) -> np.ndarray:
        """
        Carry ``tangent`` parallel along the geodesic from ``source`` to ``target``: an isometry.

        :param source: point, shape ``(..., *point_shape)``
        :param target: the same
        :param tangent: at ``source``, shape ``(..., tangent_size)``
        :returns: tangent at ``target``, shape ``(..., tangent_size)``
        :raises CutLocusError: if the geodesic is not unique
        """
        frame = self.frame(source)
        step, distance = self.log_in_frame(frame, target)
        self._check_cut_locus(distance)
        return self.from_frame(self.transport_frame(frame, step), self.to_frame(frame, tangent))

    @final
    def inner(self, base: np.ndarray, u: np.ndarray, v: np.ndarray) -> Any:
        """Riemannian inner product of two tangents at ``base``, shape ``(...)``."""
        frame = self.frame(base)
        return np.einsum('...i,...i', self.to_frame(frame, u), self.to_frame(frame, v))

    @final
    def norm(self, base: np.ndarray, v: np.ndarray) -> Any:
        """Length of a tangent at ``base``, shape ``(...)``."""
        return np.sqrt(self.inner(base, v, v))

    @final
    def distance(self, a: np.ndarray, b: np.ndarray) -> Any:
        """
        Geodesic distance in `unit`, shape ``(...)``; defined on the cut locus too.

        m on R³; rad on S^m and SO(m); half the angle of rotation [rad] between unit quaternions;
        the norm of logarithms of eigenvalues of SPD matrices. Of a product the root of the sum of
        their squares.
        """
        coordinates, _ = self.log_in_frame(self.frame(a), b)
        return np.sqrt(np.einsum('...i,...i', coordinates, coordinates))

    @final
    def factor_distances(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """
        Geodesic distance in each factor between points of two sequences, each in its `unit`.

        :param a: flat points, shape ``(count, point_size)``
        :param b: the same
        :returns: shape ``(count, factors)``; the distance in the product is their Euclidean norm
        """
        out = np.empty((len(a), len(self.factors)))
        distance_rows(self.factor_table, kernel_array(a), kernel_array(b), out,
                      np.empty(self.frame_size), np.empty(self.tangent_size), self.scratch())
        return out

    @final
    def geodesic(self, a: np.ndarray, b: np.ndarray, t: float) -> np.ndarray:
        """
        Point at fraction ``t`` of the geodesic from ``a`` (t = 0) to ``b`` (t = 1).

        :raises CutLocusError: if the geodesic is not unique
        """
        return self.exp(a, t * self.log(a, b))

    @final
    def mean(self, points: Sequence[np.ndarray] | np.ndarray, weights: np.ndarray | None = None, *,
             tolerance: float = 1e-12, iterations: int = 200, step: float = 1.0) -> np.ndarray:
        """
        Fréchet mean of points, [GDMP] Algorithm 1 (loop while the gradient is *above* tolerance).

        :param points: shape ``(count, *point_shape)``
        :param weights: one per point, not negative; equal by default
        :param tolerance: on the norm of the mean tangent, relative to the spread of the points
        :param step: fraction of the mean tangent taken per iteration
        :raises CutLocusError: if a logarithm is not unique
        :raises GdmpError: if the iteration cap is reached
        """
        points = np.array([self._single(point) for point in points])
        shares = self._normalised(len(points), weights)
        estimate = points[int(np.argmax(shares))]
        spread = float(self.distance(estimate, points).max())
        # The numbers of the points have no more digits.
        enough = max(tolerance * spread, ROUNDING * float(np.abs(points).max()))
        length = math.inf
        for _ in range(iterations):
            tangent = shares @ self.log(estimate, points)
            previous, length = length, self.norm(estimate, tangent)
            estimate = self.exp(estimate, step * tangent)
            # Below 1e-9 rounding dominates: a step that no longer shrinks is the last one.
            if length <= enough or (length < 1e-9 * spread and length >= previous):
                return estimate
        raise GdmpError(f'{self!r}: the mean of {len(points)} points did not converge in '
                        f'{iterations} iterations: gradient {length:.3g}, expected at most '
                        f'{enough:.3g}')

    @final
    def random_tangent(self, base: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Draw a tangent at ``base``, standard normal in an orthonormal frame."""
        frame = self.frame(base)
        return self.project_tangent(base, self.from_frame(
            frame, rng.standard_normal((*frame.shape[:-1], self.tangent_size))))

    @final
    def project_tangent(self, base: np.ndarray, vector: np.ndarray) -> np.ndarray:
        """Orthogonal projection of vectors of shape ``(..., tangent_size)`` to tangents."""
        return self._rows(project_tangent_rows, self.tangent_size, self.flat(base),
                          self.vector(vector))

    # Frames: tangents as coordinates that need no transport of their own.

    @final
    def frame(self, point: np.ndarray) -> np.ndarray:
        """Canonical frame at ``point``, shape ``(..., frame_size)``."""
        return self._rows(frame_rows, self.frame_size, self.flat(point))

    @final
    def frame_point(self, frame: np.ndarray) -> np.ndarray:
        """Point of a frame, shape ``(..., *point_shape)``."""
        return self.unflat(self._rows(frame_point_rows, self.point_size, kernel_array(frame)))

    @final
    def transport_frame(self, frame: np.ndarray, coordinates: np.ndarray) -> np.ndarray:
        """
        Frame after parallel transport along the geodesic with these coordinates.

        :param frame: shape ``(..., frame_size)``
        :param coordinates: shape ``(..., tangent_size)``
        :returns: shape ``(..., frame_size)``
        """
        return self._rows(transport_frame_rows, self.frame_size, kernel_array(frame),
                          self.vector(coordinates))

    @final
    def log_in_frame(self, frame: np.ndarray, point: np.ndarray) -> tuple[np.ndarray, Any]:
        """
        `log` in coordinates, on the cut locus one of the shortest tangents.

        :param frame: shape ``(..., frame_size)``
        :param point: shape ``(..., *point_shape)``
        :returns: coordinates, shape ``(..., tangent_size)``, and the distance of ``point`` from
            the cut locus [rad], shape ``(...)``
        """
        return self._log_rows(log_in_frame_rows, kernel_array(frame), self.flat(point))

    @final
    def from_frame(self, frame: np.ndarray, coordinates: np.ndarray) -> np.ndarray:
        """Tangent with these coordinates, shape ``(..., tangent_size)``."""
        return self._rows(from_frame_rows, self.tangent_size, kernel_array(frame),
                          self.vector(coordinates))

    @final
    def to_frame(self, frame: np.ndarray, tangent: np.ndarray) -> np.ndarray:
        """Coordinates of a tangent, shape ``(..., tangent_size)``."""
        return self._rows(to_frame_rows, self.tangent_size, kernel_array(frame),
                          self.vector(tangent))

    # Arrays

    @final
    def project(self, array: np.ndarray) -> np.ndarray:
        """
        Nearest point to an array of shape `point_shape`.

        :raises ManifoldError: if there is none (the zero vector, a NaN)
        """
        point = self._single(array)
        if not np.isfinite(point).all():
            raise self.error(_NOT_FINITE)
        return self.nearest_point(point)

    @final
    def check_point(self, array: np.ndarray) -> np.ndarray:
        """
        Return ``array`` as a float64 point of shape `point_shape`.

        :raises ManifoldError: if it is not a point within `tolerance`; the message says why
        """
        point = self._single(array)
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
        invalid = self.first_invalid(points[:count]) if count else None
        if invalid is None and count < len(points):
            invalid = count, _NOT_FINITE
        if invalid is not None:
            raise InvalidPointError(f'{self!r}: {invalid[1]}', invalid[0])

    @final
    def flat(self, point: np.ndarray) -> np.ndarray:
        """
        Points as flat float64 vectors for kernels, shape ``(..., point_size)``.

        :param point: shape ``(..., *point_shape)``
        :raises ManifoldError: if the shape is wrong
        """
        array = kernel_array(point)
        axes = array.ndim - len(self.point_shape)
        if axes < 0 or array.shape[axes:] != self.point_shape:
            raise self.error(f'shape is {array.shape}, expected {self.point_shape}')
        return array.reshape(*array.shape[:axes], self.point_size)

    @final
    def unflat(self, points: np.ndarray) -> np.ndarray:
        """
        Points of flat vectors, the inverse of `flat`.

        :param points: shape ``(..., point_size)``
        :returns: shape ``(..., *point_shape)``
        """
        return points.reshape(*points.shape[:-1], *self.point_shape)

    @final
    def vector(self, tangent: np.ndarray) -> np.ndarray:
        """
        Tangents as float64 vectors for kernels.

        :param tangent: shape ``(..., tangent_size)``
        :raises ManifoldError: if the shape is wrong
        """
        array = kernel_array(tangent)
        if array.shape[-1:] != (self.tangent_size,):
            raise self.error(f'tangent shape is {array.shape}, expected {(self.tangent_size,)}')
        return array

    @final
    def scratch(self) -> np.ndarray:
        """Scratch memory for kernels, not shared: two threads may use one manifold."""
        return np.empty(self._work_size)

    def error(self, reason: str) -> ManifoldError:
        """Error that names this manifold."""
        return ManifoldError(f'{self!r}: {reason}')

    def _single(self, array: np.ndarray) -> np.ndarray:
        point = kernel_array(array)
        if point.shape != self.point_shape:
            raise self.error(f'shape is {point.shape}, expected {self.point_shape}')
        return point

    def _rows(self, operation: Callable[..., None], width: int, *arrays: np.ndarray) -> np.ndarray:
        """Call a compiled operation of one result with each row of arrays."""
        axes, rows = self._broadcast(arrays)
        out = np.empty((*axes, width))
        operation(self.factor_table, *rows, out.reshape(-1, width), self.scratch())
        return out

    def _log_rows(self, operation: Callable[..., None], *arrays: np.ndarray
                  ) -> tuple[np.ndarray, Any]:
        """Call a compiled logarithm with each row of arrays."""
        axes, rows = self._broadcast(arrays)
        out, distances = np.empty((*axes, self.tangent_size)), np.empty(axes)
        operation(self.factor_table, *rows, out.reshape(-1, self.tangent_size),
                  distances.reshape(-1), self.scratch())
        return out, distances[()]

    def _broadcast(self, arrays: Sequence[np.ndarray]) -> tuple[tuple[int, ...], list[np.ndarray]]:
        """Axes in front of several arrays, and their rows."""
        axes = arrays[0].shape[:-1]
        for array in arrays[1:]:
            if array.shape[:-1] != axes:
                axes, arrays = self._broadcast_to_each_other(arrays)
                break
        return axes, [array.reshape(-1, array.shape[-1]) for array in arrays]

    def _broadcast_to_each_other(self, arrays: Sequence[np.ndarray]
                                 ) -> tuple[tuple[int, ...], list[np.ndarray]]:
        shapes = [array.shape[:-1] for array in arrays]
        try:
            axes = np.broadcast_shapes(*shapes)
        except ValueError:
            raise self.error(f'the axes in front are {" and ".join(map(str, shapes))}, '
                             'expected the same') from None
        return axes, [kernel_array(np.broadcast_to(array, (*axes, array.shape[-1])))
                      for array in arrays]

    def _first_not_of_unit_norm(self, points: np.ndarray, name: str) -> tuple[int, str] | None:
        norms = np.linalg.norm(points, axis=1)
        return first_of(~(np.abs(norms - 1.0) <= self.tolerance), lambda i:
                        f'{name} is {norms[i]:.9g}, expected 1 within {self.tolerance:g}')

    def _normalised(self, count: int, weights: np.ndarray | None) -> np.ndarray:
        if count == 0:
            raise self.error('the mean of no points is undefined')
        shares = np.ones(count) if weights is None else np.asarray(weights, dtype=np.float64)
        valid = shares.shape == (count,) and (shares >= 0.0).all()
        if not valid or not 0.0 < shares.sum() < np.inf:
            raise self.error(f'weights must be {count} numbers >= 0 with a positive sum, '
                             f'got {shares!r}')
        return np.asarray(shares / shares.sum())

    def _check_cut_locus(self, distances: Any) -> None:
        distance = (distances if isinstance(distances, float)
                    else float(distances.min(initial=np.inf)))
        if distance < CUT_LOCUS_LIMIT:
            of = f' (one of {", ".join(self.names)})' if len(self.names) > 1 else ''
            raise CutLocusError(
                f'{self!r}: the points are {distance:.2g} rad from the cut locus, where the '
                f'shortest geodesic is not unique; expected at least {CUT_LOCUS_LIMIT:g}{of}',
                distance)

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
        return isinstance(other, Manifold) and self.spec() == other.spec()

    def __hash__(self) -> int:
        return hash(repr(self.spec()))

    def __getstate__(self) -> dict[str, Any]:
        # Addresses of kernels are valid in this process only.
        return {name: value for name, value in self.__dict__.items() if name != 'factor_table'}
