"""The interface of every manifold, and everything that follows from its kernels."""
from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
import math
from typing import Any, ClassVar, final

import numpy as np

from gdmp_ros.errors import CutLocusError, GdmpError
from gdmp_ros.manifolds import rows
from gdmp_ros.manifolds.factors import CUT_LOCUS_LIMIT, factor_table, Kernels, work_array
from gdmp_ros.manifolds.point_space import kernel_array, PointSpace


class Manifold(PointSpace):
    """
    A Riemannian manifold: a `PointSpace` with geodesics, distances and parallel transport.

    Laws, stated once in ``test/manifolds/test_laws.py`` for every manifold:

    * ``log(a, exp(a, v)) == v`` for v shorter than the distance to the cut locus;
    * ``exp(a, log(a, b)) == b`` away from the cut locus, and
      ``norm(a, log(a, b)) == distance(a, b)``;
    * ``transport`` keeps inner products, and carries ``log(a, b)`` to ``-log(b, a)``;
    * ``geodesic(a, b, t)`` has constant speed; at ``mean`` the gradient of the sum of squared
      distances is zero.

    A new manifold is one file that provides the class attributes here and in `PointSpace`,
    `nearest_point`, `first_invalid` and `random_point` (``docs/own_manifold.md``).
    """

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

    @classmethod
    def of_size(cls, size: Any) -> Manifold:
        """
        Manifold of this kind with a size parameter, as a file gives it.

        :raises ManifoldError: if it is not a valid size
        """
        return cls(size)

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
    def _work(self) -> np.ndarray:
        return work_array(self.factor_table)

    @final
    def exp(self, base: np.ndarray, tangent: np.ndarray) -> np.ndarray:
        """
        Point reached from ``base`` along the geodesic with velocity ``tangent`` in unit time.

        :param base: point, shape `point_shape`
        :param tangent: tangent at ``base``, shape ``(tangent_size,)``
        :raises ManifoldError: if a shape is wrong
        """
        out = np.empty((1, self.point_size))
        rows.exp_rows(self.factor_table, self.flat(base)[None], self.vector(tangent)[None],
                      out, self._scratch())
        return out.reshape(self.point_shape)

    @final
    def log(self, base: np.ndarray, point: np.ndarray) -> np.ndarray:
        """
        Tangent at ``base`` whose geodesic reaches ``point`` in unit time.

        :returns: shape ``(tangent_size,)``
        :raises CutLocusError: within 1e-6 rad of the cut locus: the geodesic is not unique
        :raises ManifoldError: if a shape is wrong
        """
        tangent, distance = self.log_anyway(base, point)
        self._check_cut_locus(distance)
        return tangent

    @final
    def log_anyway(self, base: np.ndarray, point: np.ndarray) -> tuple[np.ndarray, float]:
        """
        `log`, on the cut locus one of the shortest tangents.

        :returns: the tangent, and the distance of ``point`` from the cut locus of ``base`` [rad]
        """
        out, distance = np.empty((1, self.tangent_size)), np.empty(1)
        rows.log_rows(self.factor_table, self.flat(base)[None], self.flat(point)[None], out,
                      distance, self._scratch())
        return out[0], float(distance[0])

    @final
    def transport(self, source: np.ndarray, target: np.ndarray, tangent: np.ndarray) -> np.ndarray:
        """
        Carry ``tangent`` parallel along the geodesic from ``source`` to ``target``: an isometry.

        :raises CutLocusError: if the geodesic is not unique
        """
        frame = self.frame(source)
        step, distance = self.log_in_frame(frame, target)
        self._check_cut_locus(distance)
        return self.from_frame(self.transport_frame(frame, step), self.to_frame(frame, tangent))

    @final
    def inner(self, base: np.ndarray, u: np.ndarray, v: np.ndarray) -> float:
        """Riemannian inner product of two tangents at ``base``."""
        frame = self.frame(base)
        return float(self.to_frame(frame, u) @ self.to_frame(frame, v))

    @final
    def norm(self, base: np.ndarray, v: np.ndarray) -> float:
        """Length of a tangent at ``base``."""
        return math.sqrt(self.inner(base, v, v))

    @final
    def distance(self, a: np.ndarray, b: np.ndarray) -> float:
        """Geodesic distance; defined on the cut locus too."""
        return float(np.linalg.norm(self.log_in_frame(self.frame(a), b)[0]))

    @final
    def factor_distances(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """
        Geodesic distance in each factor between points of two sequences.

        :param a: flat points, shape ``(count, point_size)``
        :param b: the same
        :returns: shape ``(count, factors)``; the distance in the product is their Euclidean norm
        """
        out = np.empty((len(a), len(self.factors)))
        rows.distance_rows(self.factor_table, kernel_array(a), kernel_array(b), out,
                           np.empty(self.frame_size), np.empty(self.tangent_size),
                           self._scratch())
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

        :param weights: one per point, not negative; equal by default
        :param tolerance: on the norm of the mean tangent, relative to the spread of the points
        :param step: fraction of the mean tangent taken per iteration
        :raises CutLocusError: if a logarithm is not unique
        :raises GdmpError: if the iteration cap is reached
        """
        points = [self.flat(p).reshape(self.point_shape) for p in points]
        shares = self._normalised(len(points), weights)
        estimate = points[int(np.argmax(shares))]
        spread = max(1.0, max(self.distance(estimate, p) for p in points))
        length = math.inf
        for _ in range(iterations):
            tangents = np.array([self.log(estimate, p) for p in points])
            tangent = shares @ tangents
            previous, length = length, self.norm(estimate, tangent)
            estimate = self.exp(estimate, step * tangent)
            # Below 1e-9 rounding dominates: a step that no longer shrinks is the last one.
            if length <= tolerance * spread or (length < 1e-9 * spread and length >= previous):
                return estimate
        raise GdmpError(f'{self!r}: the mean of {len(points)} points did not converge in '
                        f'{iterations} iterations: gradient {length:.3g}, expected at most '
                        f'{tolerance * spread:.3g}')

    @final
    def random_tangent(self, base: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Draw a tangent at ``base``, standard normal in an orthonormal frame."""
        drawn = self.from_frame(self.frame(base), rng.standard_normal(self.tangent_size))
        out = np.empty((1, self.tangent_size))
        rows.project_tangent_rows(self.factor_table, self.flat(base)[None], drawn[None], out,
                                  self._scratch())
        return out[0]

    # Frames: tangents as coordinates that need no transport of their own.

    @final
    def frame(self, point: np.ndarray) -> np.ndarray:
        """Canonical frame at ``point``, shape ``(frame_size,)``."""
        out = np.empty((1, self.frame_size))
        rows.frame_rows(self.factor_table, self.flat(point)[None], out, self._scratch())
        return out[0]

    @final
    def transport_frame(self, frame: np.ndarray, coordinates: np.ndarray) -> np.ndarray:
        """Frame after parallel transport along the geodesic with these coordinates."""
        out = np.array(frame)[None]
        rows.transport_frame_rows(self.factor_table, out, self.vector(coordinates)[None],
                                  self._scratch())
        return out[0]

    @final
    def log_in_frame(self, frame: np.ndarray, point: np.ndarray) -> tuple[np.ndarray, float]:
        """
        `log` in coordinates, on the cut locus one of the shortest tangents.

        :returns: coordinates, and the distance of ``point`` from the cut locus [rad]
        """
        out, distance = np.empty((1, self.tangent_size)), np.empty(1)
        rows.log_in_frame_rows(self.factor_table, kernel_array(frame)[None],
                               self.flat(point)[None], out, distance, self._scratch())
        return out[0], float(distance[0])

    @final
    def from_frame(self, frame: np.ndarray, coordinates: np.ndarray) -> np.ndarray:
        """Tangent with these coordinates, shape ``(tangent_size,)``."""
        out = np.empty((1, self.tangent_size))
        rows.from_frame_rows(self.factor_table, kernel_array(frame)[None],
                             self.vector(coordinates)[None], out, self._scratch())
        return out[0]

    @final
    def to_frame(self, frame: np.ndarray, tangent: np.ndarray) -> np.ndarray:
        """Coordinates of a tangent, shape ``(tangent_size,)``."""
        out = np.empty((1, self.tangent_size))
        rows.to_frame_rows(self.factor_table, kernel_array(frame)[None],
                           self.vector(tangent)[None], out, self._scratch())
        return out[0]

    def _scratch(self) -> np.ndarray:
        # Not shared: two threads may use one manifold.
        return np.empty_like(self._work)

    def _normalised(self, count: int, weights: np.ndarray | None) -> np.ndarray:
        if count == 0:
            raise self.error('the mean of no points is undefined')
        shares = np.ones(count) if weights is None else np.asarray(weights, dtype=np.float64)
        valid = shares.shape == (count,) and (shares >= 0.0).all()
        if not valid or not 0.0 < shares.sum() < np.inf:
            raise self.error(f'weights must be {count} numbers >= 0 with a positive sum, '
                             f'got {shares!r}')
        return np.asarray(shares / shares.sum())

    def _check_cut_locus(self, distance: float) -> None:
        if distance < CUT_LOCUS_LIMIT:
            of = f' (one of {", ".join(self.names)})' if len(self.names) > 1 else ''
            raise CutLocusError(
                f'{self!r}: the points are {distance:.2g} rad from the cut locus, where the '
                f'shortest geodesic is not unique; expected at least {CUT_LOCUS_LIMIT:g}{of}',
                distance)

    def __getstate__(self) -> dict[str, Any]:
        # Addresses of kernels are valid in this process only.
        return {name: value for name, value in self.__dict__.items()
                if name not in ('factor_table', '_work')}
