"""A skill turned as a whole about its start, a rhythmic one about its centre."""
from __future__ import annotations

from dataclasses import replace

import numpy as np

from gdmp_ros.dmp.ends import moved_cycle
from gdmp_ros.dmp.primitive import Primitive
from gdmp_ros.errors import ParameterError

#: Largest deviation of a turn from an orthogonal matrix.
_TOLERANCE = 1e-6


def turned(primitive: Primitive, turn: np.ndarray) -> Primitive:
    """
    Return the primitive with its frame turned: every coordinate c becomes ``R c``.

    The path is turned exactly where R belongs to an isometry that keeps the start: every rotation
    of R^m, S^m and S³, of SO(m) that of a conjugation, of SPD matrices that of a congruence.

    :param turn: R, orthogonal, shape ``(n, n)``; on S^m it keeps the direction of the start, of a
        cycle that of its centre
    :raises ParameterError: if it is not orthogonal, or turns tangents out of the tangent space;
        for a skill with couplings
    """
    if primitive.couplings:
        raise ParameterError('frame: a skill with couplings cannot be turned about its start: '
                             'each side would turn about its own')
    manifold, size = primitive.manifold, primitive.manifold.tangent_size
    origin = primitive.goal if primitive.rhythmic else primitive.start
    frame = manifold.frame(primitive.goal) if primitive.rhythmic else primitive.frame
    matrix = np.asarray(turn, dtype=np.float64)
    if (matrix.shape != (size, size) or not np.isfinite(matrix).all()
            or np.abs(matrix @ matrix.T - np.eye(size)).max() > _TOLERANCE):
        raise ParameterError(f'frame: expected an orthogonal matrix of shape {(size, size)}')

    def coordinates(vector: np.ndarray) -> np.ndarray:
        tangent = manifold.from_frame(frame, matrix @ vector)
        inside = manifold.to_frame(frame, tangent)
        if np.abs(inside - matrix @ vector).max() > 1e-9 + _TOLERANCE * np.abs(vector).max():
            raise ParameterError('frame: it turns tangents out of the tangent space')
        return inside

    def point(given: np.ndarray) -> np.ndarray:
        away, _ = manifold.log_in_frame(frame, given)
        return manifold.exp(origin, manifold.from_frame(frame, coordinates(away)))
    if primitive.rhythmic:
        return moved_cycle(primitive, primitive.goal, frame, coordinates)
    shape = manifold.point_shape
    waypoints = [point(row.reshape(shape)).reshape(-1) for row in primitive.segments.waypoints]
    segments = primitive.segments
    if waypoints:
        segments = replace(segments, waypoints=np.array(waypoints))
    return replace(primitive, goal=point(primitive.goal), velocity=coordinates(primitive.velocity),
                   weights=primitive.weights @ matrix.T,
                   segments=segments, variation=None)
