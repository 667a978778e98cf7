"""The operations of `gdmp_ros.manifolds.factors` on every row of matrices, called from Python."""
from __future__ import annotations

from gdmp_ros.kernels import always_inline, kernel, numbers_at
from gdmp_ros.manifolds.factors import (
    exp,
    frame_at,
    frame_point,
    from_frame,
    log,
    log_in_frame,
    project_tangent,
    to_frame,
    transport_frame,
)
from gdmp_ros.manifolds.linalg import norm


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
def transport_frame_rows(factors, frames, coordinates, work):
    """`transport_frame` of each row."""
    for i in range(len(frames)):
        transport_frame(factors, _row(frames, i), _row(coordinates, i), work)


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
