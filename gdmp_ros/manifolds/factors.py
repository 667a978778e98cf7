"""
Manifolds as compiled code sees them: a table with one record per factor of a product.

A *frame* at a point is an isometry from coordinates in Rⁿ to the tangent space, stored together
with the point. Transporting it along a geodesic moves the point and carries the isometry parallel,
so vectors stored as coordinates need no transport of their own.

Each manifold file provides one kernel for each operation of `Kernels`. A kernel is compiled once,
by itself, and called by its address: what calls it need not be compiled again when it changes.
"""
from __future__ import annotations

from collections.abc import Callable, Sequence
import functools
from typing import Any, NamedTuple

import numpy as np

from gdmp_ros.kernels import always_inline, call_kernel, kernel, measure_with_kernel, numbers_at
from gdmp_ros.kernels.intrinsics import kernel_signature
from gdmp_ros.manifolds.linalg import copy_numbers, norm

#: Within this distance [rad] of the cut locus the shortest geodesic counts as not unique.
CUT_LOCUS_LIMIT = 1e-6
#: Points and frames are renormalized after this many steps along a path.
RENORMALIZE_EVERY = 32
#: How many arrays each kernel takes, ``work`` included.
_ARRAYS = {'exp': 4, 'log': 4, 'frame': 3, 'frame_point': 3, 'transport_frame': 3,
           'log_in_frame': 4, 'from_frame': 4, 'to_frame': 4, 'renormalize_frame': 2,
           'renormalize': 2, 'project_tangent': 4}


class Kernels(NamedTuple):
    """
    The compiled operations of a manifold, on flat float64 arrays.

    Every kernel takes ``size`` (the manifold's size parameter), the arrays below and, last,
    ``work``: scratch memory of `work_size` numbers. Kernels do not allocate.

    ================= ============================= =============================================
    kernel            arrays before ``work``        result
    ================= ============================= =============================================
    exp               base, tangent, *point*        point reached in unit time
    log               base, point, *tangent*        inverse of ``exp``; returns the distance of
                                                    ``point`` from the cut locus of ``base``
    frame             point, *frame*                canonical frame at a point
    frame_point       frame, *point*                point of a frame
    transport_frame   *frame*, coordinates          moves the frame along the geodesic
    log_in_frame      frame, point, *coordinates*   ``log`` in coordinates; returns as ``log``
    from_frame        frame, coordinates, *tangent* tangent of coordinates
    to_frame          frame, tangent, *coordinates* inverse of ``from_frame``
    renormalize_frame *frame*                       removes rounding errors of many transports
    renormalize       *point*                       the same for a point
    project_tangent   point, vector, *tangent*      orthogonal projection to the tangent space
    ================= ============================= =============================================

    Arrays in italics are written. On the cut locus the logarithms return one of the shortest
    tangents. ``exp`` and ``frame`` write NaN where their first argument is not a point.
    """

    exp: Callable[..., None]
    log: Callable[..., float]
    frame: Callable[..., None]
    frame_point: Callable[..., None]
    transport_frame: Callable[..., None]
    log_in_frame: Callable[..., float]
    from_frame: Callable[..., None]
    to_frame: Callable[..., None]
    renormalize_frame: Callable[..., None]
    renormalize: Callable[..., None]
    project_tangent: Callable[..., None]


#: One factor: size, scratch numbers, where its parts lie in a product, addresses of kernels.
FACTOR = np.dtype([(name, np.int64) for name in (
    'size', 'work', 'point', 'point_end', 'tangent', 'tangent_end', 'frame_start', 'frame_end',
    *Kernels._fields)])


def work_size(size: int) -> int:
    """Numbers of scratch memory that any kernel needs at most at a size."""
    return 8 * (size + 1) ** 2


@functools.cache
def _addresses(kernels: Kernels) -> tuple[int, ...]:
    """Addresses of compiled kernels; compiles them, or loads them from the cache."""
    result = []
    for name, function in zip(Kernels._fields, kernels):
        signature = kernel_signature(_ARRAYS[name])
        dispatcher: Any = function
        dispatcher.compile(signature)
        compiled = dispatcher.overloads[signature]
        result.append(compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name))
    return tuple(result)


def factor_table(factors: Sequence[Any]) -> np.ndarray:
    """
    Table of the factors of a product, dtype `FACTOR`, shape ``(factors,)``.

    :param factors: `gdmp_ros.manifolds.manifold.Manifold`, which is above this file
    """
    table = np.zeros(len(factors), dtype=FACTOR)
    table['size'] = [factor.size for factor in factors]
    table['work'] = [work_size(factor.size) for factor in factors]
    for first, last, sizes in (
            ('point', 'point_end', [factor.point_size for factor in factors]),
            ('tangent', 'tangent_end', [factor.tangent_size for factor in factors]),
            ('frame_start', 'frame_end', [factor.frame_size for factor in factors])):
        table[last] = np.cumsum(sizes)
        table[first] = table[last] - sizes
    for row, factor in zip(table, factors):
        for name, address in zip(Kernels._fields, _addresses(factor.kernels)):
            row[name] = address
    return table


# Each operation on one factor. Points, tangents and frames are those of the whole product.

@always_inline
def factor_exp(factor, base, tangent, point, work):
    """`Kernels.exp` of one factor."""
    call_kernel(factor.exp, factor.size, (
        base, factor.point, factor.point_end, tangent, factor.tangent, factor.tangent_end,
        point, factor.point, factor.point_end, work, 0, factor.work))


@always_inline
def factor_log(factor, base, point, tangent, work):
    """`Kernels.log` of one factor."""
    return measure_with_kernel(factor.log, factor.size, (
        base, factor.point, factor.point_end, point, factor.point, factor.point_end,
        tangent, factor.tangent, factor.tangent_end, work, 0, factor.work))


@always_inline
def factor_log_in_frame(factor, frame, point, coordinates, work):
    """`Kernels.log_in_frame` of one factor."""
    return measure_with_kernel(factor.log_in_frame, factor.size, (
        frame, factor.frame_start, factor.frame_end, point, factor.point, factor.point_end,
        coordinates, factor.tangent, factor.tangent_end, work, 0, factor.work))


@always_inline
def factor_from_frame(factor, frame, coordinates, tangent, work):
    """`Kernels.from_frame` of one factor."""
    call_kernel(factor.from_frame, factor.size, (
        frame, factor.frame_start, factor.frame_end, coordinates, factor.tangent,
        factor.tangent_end, tangent, factor.tangent, factor.tangent_end, work, 0, factor.work))


@always_inline
def factor_to_frame(factor, frame, tangent, coordinates, work):
    """`Kernels.to_frame` of one factor."""
    call_kernel(factor.to_frame, factor.size, (
        frame, factor.frame_start, factor.frame_end, tangent, factor.tangent, factor.tangent_end,
        coordinates, factor.tangent, factor.tangent_end, work, 0, factor.work))


# Each operation on all factors; the logarithms return the smallest distance from a cut locus.

@always_inline
def exp(factors, base, tangent, point, work):
    """`Kernels.exp`, factor by factor."""
    for i in range(factors.size):
        factor_exp(factors[i], base, tangent, point, work)


@always_inline
def log(factors, base, point, tangent, work):
    """`Kernels.log`, factor by factor."""
    least = np.inf
    for i in range(factors.size):
        least = min(least, factor_log(factors[i], base, point, tangent, work))
    return least


@always_inline
def frame_at(factors, point, frame, work):
    """`Kernels.frame`, factor by factor."""
    for i in range(factors.size):
        f = factors[i]
        call_kernel(f.frame, f.size, (point, f.point, f.point_end, frame, f.frame_start,
                                      f.frame_end, work, 0, f.work))


@always_inline
def frame_point(factors, frame, point, work):
    """`Kernels.frame_point`, factor by factor."""
    for i in range(factors.size):
        f = factors[i]
        call_kernel(f.frame_point, f.size, (frame, f.frame_start, f.frame_end, point, f.point,
                                            f.point_end, work, 0, f.work))


@always_inline
def transport_frame(factors, frame, coordinates, work):
    """`Kernels.transport_frame`, factor by factor."""
    for i in range(factors.size):
        f = factors[i]
        call_kernel(f.transport_frame, f.size, (
            frame, f.frame_start, f.frame_end, coordinates, f.tangent, f.tangent_end,
            work, 0, f.work))


@always_inline
def log_in_frame(factors, frame, point, coordinates, work):
    """`Kernels.log_in_frame`, factor by factor."""
    least = np.inf
    for i in range(factors.size):
        least = min(least, factor_log_in_frame(factors[i], frame, point, coordinates, work))
    return least


@always_inline
def from_frame(factors, frame, coordinates, tangent, work):
    """`Kernels.from_frame`, factor by factor."""
    for i in range(factors.size):
        factor_from_frame(factors[i], frame, coordinates, tangent, work)


@always_inline
def to_frame(factors, frame, tangent, coordinates, work):
    """`Kernels.to_frame`, factor by factor."""
    for i in range(factors.size):
        factor_to_frame(factors[i], frame, tangent, coordinates, work)


@always_inline
def renormalize_frame(factors, frame, work):
    """`Kernels.renormalize_frame`, factor by factor."""
    for i in range(factors.size):
        f = factors[i]
        call_kernel(f.renormalize_frame, f.size, (frame, f.frame_start, f.frame_end,
                                                  work, 0, f.work))


@always_inline
def renormalize(factors, point, work):
    """`Kernels.renormalize`, factor by factor."""
    for i in range(factors.size):
        f = factors[i]
        call_kernel(f.renormalize, f.size, (point, f.point, f.point_end, work, 0, f.work))


@always_inline
def project_tangent(factors, point, vector, tangent, work):
    """`Kernels.project_tangent`, factor by factor."""
    for i in range(factors.size):
        f = factors[i]
        call_kernel(f.project_tangent, f.size, (
            point, f.point, f.point_end, vector, f.tangent, f.tangent_end,
            tangent, f.tangent, f.tangent_end, work, 0, f.work))


# Each operation on every row of matrices, called from Python.

@always_inline
def _row(matrix, i):
    return numbers_at(matrix, i * matrix.shape[1], matrix.shape[1])


@kernel
def exp_rows(factors, bases, tangents, points, work):
    """`exp` of each row."""
    for i in range(len(bases)):
        exp(factors, _row(bases, i), _row(tangents, i), _row(points, i), work)


@kernel
def log_rows(factors, bases, points, tangents, distances, work):
    """`log` of each row; ``distances`` are what it returns."""
    for i in range(distances.size):
        distances[i] = log(factors, _row(bases, i), _row(points, i), _row(tangents, i), work)


@kernel
def frame_rows(factors, points, frames, work):
    """`frame_at` of each row."""
    for i in range(len(points)):
        frame_at(factors, _row(points, i), _row(frames, i), work)


@kernel
def frame_point_rows(factors, frames, points, work):
    """`frame_point` of each row."""
    for i in range(len(points)):
        frame_point(factors, _row(frames, i), _row(points, i), work)


@kernel
def transport_frame_rows(factors, frames, coordinates, moved, work):
    """`transport_frame` of each row, to ``moved``."""
    for i in range(len(frames)):
        copy_numbers(frames.shape[1], _row(frames, i), _row(moved, i))
        transport_frame(factors, _row(moved, i), _row(coordinates, i), work)


@kernel
def log_in_frame_rows(factors, frames, points, coordinates, distances, work):
    """`log_in_frame` of each row; ``distances`` are what it returns."""
    for i in range(distances.size):
        distances[i] = log_in_frame(factors, _row(frames, i), _row(points, i),
                                    _row(coordinates, i), work)


@kernel
def distance_rows(factors, a, b, distances, frame, coordinates, work):
    """Length of the geodesic in each factor, for each row of points."""
    for i in range(len(distances)):
        frame_at(factors, _row(a, i), frame, work)
        log_in_frame(factors, frame, _row(b, i), coordinates, work)
        for j in range(factors.size):
            first, end = factors[j].tangent, factors[j].tangent_end
            distances[i, j] = norm(end - first, numbers_at(coordinates, first, end - first))


@kernel
def from_frame_rows(factors, frames, coordinates, tangents, work):
    """`from_frame` of each row."""
    for i in range(len(frames)):
        from_frame(factors, _row(frames, i), _row(coordinates, i), _row(tangents, i), work)


@kernel
def to_frame_rows(factors, frames, tangents, coordinates, work):
    """`to_frame` of each row."""
    for i in range(len(frames)):
        to_frame(factors, _row(frames, i), _row(tangents, i), _row(coordinates, i), work)


@kernel
def project_tangent_rows(factors, points, vectors, tangents, work):
    """`project_tangent` of each row."""
    for i in range(len(points)):
        project_tangent(factors, _row(points, i), _row(vectors, i), _row(tangents, i), work)
