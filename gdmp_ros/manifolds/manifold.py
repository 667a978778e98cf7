"""The interface every manifold offers, and all that can be derived from its kernel."""
from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
import math
from typing import ClassVar, final

import numpy as np

from gdmp_ros.errors import CutLocusError, GdmpError, ManifoldError
from gdmp_ros.manifolds import operations as ops

#: Larger ones are mistakes: nobody has the memory for their frames.
LARGEST_M = 1000
_NOTHING = np.empty(0)


def _for_kernel(array: np.ndarray) -> np.ndarray:
    """Contiguous, writable float64, as the kernels are compiled for; copied only if needed."""
    return np.require(array, dtype=np.float64, requirements=['C', 'W'])


class Manifold(ABC):
    """
    A Riemannian manifold: stateless; points are float64 arrays, tangents flat vectors.

    Laws, stated once in ``test/manifolds/test_laws.py`` for every manifold:

    * ``log(a, exp(a, v)) == v`` for v shorter than the distance to the cut locus;
    * ``exp(a, log(a, b)) == b`` away from the cut locus, and ``norm(a, log(a, b)) == distance(a,
      b)``;
    * ``transport`` keeps inner products, and carries ``log(a, b)`` to ``-log(b, a)``;
    * ``geodesic(a, b, t)`` has constant speed; the gradient of the squared distances vanishes at
      ``mean``.

    A new manifold gives a kernel (`gdmp_ros.manifolds.operations`), `_project`, `_defect` and
    `random_point`; everything else is derived here.

    :ivar m: size parameter
    :ivar dim: dimension of the manifold
    :ivar point_shape: shape of a point
    :ivar tangent_size: numbers in a tangent
    :ivar frame_size: numbers in a frame (`gdmp_ros.manifolds.operations`)
    """

    #: Name in files and parameters.
    kind: ClassVar[str]
    #: The compiled ``apply(op, m, a, b, out)``.
    kernel: ClassVar[Callable[..., float]]
    #: `check_point` accepts a deviation up to this.
    tolerance: ClassVar[float] = 1e-6

    def __init__(self, m: int, *, dim: int, point_shape: tuple[int, ...], tangent_size: int,
                 frame_size: int):
        self.m = m
        self.dim = dim
        self.point_shape = point_shape
        self.tangent_size = tangent_size
        self.frame_size = frame_size
        self.point_size = math.prod(point_shape)

    # What a manifold must give.

    @abstractmethod
    def _project(self, array: np.ndarray) -> np.ndarray:
        """Return the nearest point to a finite array of the right shape."""

    @abstractmethod
    def _defect(self, point: np.ndarray) -> str | None:
        """Say why a finite array of the right shape is no point, None where it is one."""

    @abstractmethod
    def random_point(self, rng: np.random.Generator) -> np.ndarray:
        """Draw a point."""

    def align(self, point: np.ndarray, reference: np.ndarray) -> np.ndarray:
        """Choose, among the points that mean the same, the one nearest to ``reference``."""
        return point

    # What follows from it.

    @property
    def factors(self) -> tuple[Manifold, ...]:
        """The manifolds this one is the product of: itself, unless it is a `Product`."""
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

    def spec(self) -> dict[str, object]:
        """Describe the manifold for files and parameters (`gdmp_ros.manifolds.from_spec`)."""
        return {'kind': self.kind, 'm': self.m}

    def _apply(self, op: int, a: np.ndarray, b: np.ndarray, out: np.ndarray) -> float:
        work = np.empty(ops.work_size(self.m))
        return type(self).kernel(op, self.m, a, b, out, work)

    @final
    def exp(self, base: np.ndarray, tangent: np.ndarray) -> np.ndarray:
        """
        Point reached from ``base`` along the geodesic with velocity ``tangent`` in unit time.

        :param base: point, shape `point_shape`
        :param tangent: tangent at ``base``, shape ``(tangent_size,)``
        :raises ManifoldError: if a shape is wrong
        """
        out = np.empty(self.point_size)
        self._apply(ops.EXP, self._flat(base), self._vector(tangent), out)
        return out.reshape(self.point_shape)

    @final
    def log(self, base: np.ndarray, point: np.ndarray) -> np.ndarray:
        """
        Tangent at ``base`` whose geodesic reaches ``point`` in unit time, shape
        ``(tangent_size,)``.

        :raises CutLocusError: within 1e-6 rad of the cut locus: the geodesic is not unique
        :raises ManifoldError: if a shape is wrong
        """
        out = np.empty(self.tangent_size)
        gap = self._apply(ops.LOG, self._flat(base), self._flat(point), out)
        self._check_gap(gap)
        return out

    @final
    def transport(self, source: np.ndarray, target: np.ndarray, tangent: np.ndarray) -> np.ndarray:
        """
        Carry ``tangent`` parallel along the geodesic from ``source`` to ``target``: an isometry.

        :raises CutLocusError: if the geodesic is not unique
        """
        frame, step = self.frame(source), np.empty(self.tangent_size)
        coordinates, out = np.empty(self.tangent_size), np.empty(self.tangent_size)
        self._check_gap(self._apply(ops.FRAME_LOG, frame, self._flat(target), step))
        self._apply(ops.COORDS, frame, self._vector(tangent), coordinates)
        self._apply(ops.MOVE, frame, step, _NOTHING)
        self._apply(ops.VECTOR, frame, coordinates, out)
        return out

    @final
    def inner(self, base: np.ndarray, u: np.ndarray, v: np.ndarray) -> float:
        """Riemannian inner product of two tangents at ``base``."""
        frame = self.frame(base)
        first, second = np.empty(self.tangent_size), np.empty(self.tangent_size)
        self._apply(ops.COORDS, frame, self._vector(u), first)
        self._apply(ops.COORDS, frame, self._vector(v), second)
        return float(first @ second)

    @final
    def norm(self, base: np.ndarray, v: np.ndarray) -> float:
        """Length of a tangent at ``base``."""
        return math.sqrt(self.inner(base, v, v))

    @final
    def distance(self, a: np.ndarray, b: np.ndarray) -> float:
        """Geodesic distance; defined on the cut locus too."""
        step = np.empty(self.tangent_size)
        self._apply(ops.FRAME_LOG, self.frame(a), self._flat(b), step)
        return float(np.linalg.norm(step))

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

        :param weights: one per point, not negative; equal by default
        :param tolerance: on the norm of the mean tangent, relative to the spread of the points
        :param step: fraction of the mean tangent taken per iteration
        :raises CutLocusError: if a logarithm is not unique
        :raises GdmpError: if the iteration cap is reached
        """
        points = [self._flat(p).reshape(self.point_shape) for p in points]
        shares = self._shares(len(points), weights)
        estimate = points[int(np.argmax(shares))]
        spread = max(1.0, max(self.distance(estimate, p) for p in points))
        length = math.inf
        for _ in range(iterations):
            tangents = np.array([self.log(estimate, p) for p in points])
            tangent = shares @ tangents
            previous, length = length, self.norm(estimate, tangent)
            estimate = self.exp(estimate, step * tangent)
            # Rounding ends the descent: below 1e-9 a step that no longer shrinks is the last.
            if length <= tolerance * spread or (length < 1e-9 * spread and length >= previous):
                return estimate
        raise GdmpError(f'{self!r}: the mean of {len(points)} points did not settle in '
                        f'{iterations} iterations: gradient {length:.3g}, expected at most '
                        f'{tolerance * spread:.3g}')

    @final
    def random_tangent(self, base: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Draw a tangent at ``base``, standard normal in an orthonormal frame."""
        drawn, out = np.empty(self.tangent_size), np.empty(self.tangent_size)
        self._apply(ops.VECTOR, self.frame(base), rng.standard_normal(self.tangent_size), drawn)
        self._apply(ops.TANGENT, self._flat(base), drawn, out)
        return out

    @final
    def frame(self, point: np.ndarray) -> np.ndarray:
        """Build the canonical frame at ``point`` (`gdmp_ros.manifolds.operations`)."""
        out = np.empty(self.frame_size)
        self._apply(ops.FRAME, self._flat(point), _NOTHING, out)
        return out

    @final
    def project(self, array: np.ndarray) -> np.ndarray:
        """
        Nearest point to an array of shape `point_shape`.

        :raises ManifoldError: if there is none (the zero vector, a NaN)
        """
        return self._project(self._finite(array))

    @final
    def check_point(self, array: np.ndarray) -> np.ndarray:
        """
        Return ``array`` as a float64 point of shape `point_shape`.

        :raises ManifoldError: if it is not a point within `tolerance`; the message says why
        """
        point = self._finite(array)
        defect = self._defect(point)
        if defect is not None:
            raise self._no_point(defect)
        return point

    def _finite(self, array: np.ndarray) -> np.ndarray:
        point = self._flat(array).reshape(self.point_shape)
        if not np.isfinite(point).all():
            raise self._no_point('an entry is NaN or infinite')
        return point

    def _flat(self, point: np.ndarray) -> np.ndarray:
        array = _for_kernel(point)
        if array.shape != self.point_shape:
            raise self._no_point(f'shape is {array.shape}, expected {self.point_shape}')
        return array.reshape(-1)

    def _vector(self, tangent: np.ndarray) -> np.ndarray:
        array = _for_kernel(tangent)
        if array.shape != (self.tangent_size,):
            raise ManifoldError(f'{self!r}: tangent shape is {array.shape}, '
                                f'expected {(self.tangent_size,)}')
        return array

    def _shares(self, count: int, weights: np.ndarray | None) -> np.ndarray:
        if count == 0:
            raise ManifoldError(f'{self!r}: the mean of no points is undefined')
        shares = np.ones(count) if weights is None else np.asarray(weights, dtype=np.float64)
        valid = shares.shape == (count,) and (shares >= 0.0).all()
        if not valid or not 0.0 < shares.sum() < np.inf:
            raise ManifoldError(f'{self!r}: weights must be {count} numbers >= 0 with a positive '
                                f'sum, got {shares!r}')
        return np.asarray(shares / shares.sum())

    def _check_gap(self, gap: float) -> None:
        if gap < ops.CUT_LOCUS_LIMIT:
            raise CutLocusError(
                f'{self!r}: the points are {gap:.2g} rad from the cut locus, where the shortest '
                f'geodesic is not unique; expected at least {ops.CUT_LOCUS_LIMIT:g}', gap)

    def _no_point(self, reason: str) -> ManifoldError:
        return ManifoldError(f'{self!r}: {reason}')

    def _unit_defect(self, point: np.ndarray, name: str) -> str | None:
        norm = float(np.linalg.norm(point))
        if abs(norm - 1.0) <= self.tolerance:
            return None
        return f'{name} is {norm:.9g}, expected 1 within {self.tolerance:g}'

    @classmethod
    def _size(cls, m: int, least: int) -> int:
        if (not isinstance(m, (int, np.integer)) or isinstance(m, bool)
                or not least <= m <= LARGEST_M):
            raise ManifoldError(f'{cls.__name__}: m must be an integer from {least} to '
                                f'{LARGEST_M}, got {m!r}')
        return int(m)

    def __repr__(self) -> str:
        return f'{type(self).__name__}({self.m})'

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Manifold) and self.spec() == other.spec()

    def __hash__(self) -> int:
        return hash(repr(self.spec()))
