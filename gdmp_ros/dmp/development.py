"""
A curve on a manifold unrolled into Rⁿ, and its derivatives.

A frame is carried parallel along the samples. The step from one sample to the next has coordinates
in it; their running sum is the curve's *development*, an ordinary curve in Rⁿ: its derivatives are
the covariant derivatives of the curve, and it can be interpolated like any other.
"""
from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline, make_smoothing_spline

from gdmp_ros.compilation import compiled
from gdmp_ros.errors import CutLocusError
from gdmp_ros.manifolds import Manifold
from gdmp_ros.manifolds import operations as ops
from gdmp_ros.manifolds.registry import (
    apply_factors,
    factor_table,
    map_factors,
    work_array,
)

#: Frames are re-orthonormalised after this many moves.
MEND_EVERY = 32


@compiled
def _develop(table, frame, points, goals, frames, steps, to_goal, gaps, work):
    """Carry ``frame`` along; rows of ``gaps``: from the cut locus of neighbour and goal."""
    none = np.empty(0)
    for i in range(points.shape[0]):
        frames[i] = frame
        gaps[1, i] = apply_factors(table, ops.FRAME_LOG, frame, goals[i], to_goal[i], work)
        if i + 1 < points.shape[0]:
            gaps[0, i] = apply_factors(table, ops.FRAME_LOG, frame, points[i + 1], steps[i], work)
            apply_factors(table, ops.MOVE, frame, steps[i], none, work)
            if i % MEND_EVERY == MEND_EVERY - 1:
                apply_factors(table, ops.MEND, frame, none, none, work)


def _rowwise(table: np.ndarray, op: int, a: np.ndarray, b: np.ndarray,
             width: int) -> tuple[np.ndarray, np.ndarray]:
    """Apply an operation to each row: results of ``width`` numbers, and the kernels' answers."""
    out, answers = np.empty((len(a), width)), np.empty(len(a))
    first, second = (np.require(x, requirements=['C', 'W']) for x in (a, b))
    map_factors(table, op, first, second, out, answers, work_array(table))
    return out, answers


def _check_steps(manifold: Manifold, gaps: np.ndarray) -> None:
    at = int(np.argmin(gaps))
    if gaps[at] < ops.CUT_LOCUS_LIMIT:
        raise CutLocusError(f'{manifold!r}: samples {at} and {at + 1} are {gaps[at]:.2g} rad from '
                            f'the cut locus of each other: sampled too coarsely', float(gaps[at]))


def _check_goal(manifold: Manifold, gaps: np.ndarray) -> None:
    at = int(np.argmin(gaps))
    if gaps[at] < ops.CUT_LOCUS_LIMIT:
        raise CutLocusError(f'{manifold!r}: sample {at} is {gaps[at]:.2g} rad from the cut locus '
                            f'of the goal, expected at least {ops.CUT_LOCUS_LIMIT:g}',
                            float(gaps[at]))


class Development:
    """Samples of a curve with their frames, steps and logarithms to a target."""

    def __init__(self, manifold: Manifold, points: np.ndarray, frame: np.ndarray,
                 targets: np.ndarray | None = None):
        """
        Unroll a curve.

        :param points: samples, flat, shape ``(samples, point_size)``
        :param frame: frame at the first sample
        :param targets: a flat point for each sample; the last sample by default
        :raises CutLocusError: if neighbours, or a sample and its target, lie on each other's cut
            locus
        """
        count, size = len(points), manifold.tangent_size
        self.manifold = manifold
        self.table = factor_table(manifold.factors)
        self.points = np.require(points, requirements=['C', 'W'])
        self.frames = np.empty((count, manifold.frame_size))
        self.steps = np.empty((count - 1, size))
        self.to_goal = np.empty((count, size))
        gaps = np.full((2, count), np.inf)
        ends = np.broadcast_to(self.points[-1], points.shape) if targets is None else targets
        _develop(self.table, frame.copy(), self.points,
                 np.require(ends, requirements=['C', 'W']), self.frames, self.steps, self.to_goal,
                 gaps, work_array(self.table))
        _check_steps(manifold, gaps[0])
        if targets is not None:
            _check_goal(manifold, gaps[1])

    @property
    def unrolled(self) -> np.ndarray:
        """The development: the samples as a curve in Rⁿ, shape ``(samples, n)``."""
        return np.vstack([np.zeros(self.steps.shape[1]), np.cumsum(self.steps, axis=0)])

    def interpolate(self, times: np.ndarray, at: np.ndarray) -> np.ndarray:
        """
        Points of a twice differentiable curve through the samples (a cubic spline, unrolled).

        :param times: of the samples, increasing, shape ``(samples,)``
        :param at: times wanted, within those of the samples
        :returns: flat points, shape ``(len(at), point_size)``
        """
        unrolled = self.unrolled
        index = np.clip(np.searchsorted(times, at, side='right') - 1, 0, len(times) - 1)
        return self._moved(index, CubicSpline(times, unrolled)(at) - unrolled[index])

    def smooth(self, times: np.ndarray, cutoff: float) -> np.ndarray:
        """
        Samples of the cubic smoothing spline of the development, rolled back.

        A motion at ``cutoff`` [Hz] comes out with half its amplitude, one at half of it with
        94 %, one at twice with 6 %, none delayed (``1 / (1 + (f / cutoff)⁴)``); the stamps may be
        irregular.
        """
        spacing = np.gradient(times)
        mean = (times[-1] - times[0]) / (len(times) - 1)
        penalty = 1.0 / (mean * (2.0 * np.pi * cutoff) ** 4)
        unrolled = self.unrolled
        smooth = np.column_stack([
            make_smoothing_spline(times, column, w=spacing / mean, lam=penalty)(times)
            for column in unrolled.T])
        return self._moved(np.arange(len(times)), smooth - unrolled)

    def _moved(self, index: np.ndarray, offsets: np.ndarray) -> np.ndarray:
        """Points ``offsets`` away from the samples at ``index``, in their frames."""
        moved = self.frames[index]
        _rowwise(self.table, ops.MOVE, moved, offsets, 0)
        return _rowwise(self.table, ops.POINT, moved, np.empty((len(index), 0)),
                        self.manifold.point_size)[0]


def distances(manifold: Manifold, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """
    Geodesic distance in each factor between points of two sequences.

    :param a: flat points, shape ``(count, point_size)``
    :returns: shape ``(count, factors)``; the distance in the product is their Euclidean norm
    """
    table = factor_table(manifold.factors)
    frames, _ = _rowwise(table, ops.FRAME, a, np.empty((len(a), 0)), manifold.frame_size)
    away, _ = _rowwise(table, ops.FRAME_LOG, frames, b, manifold.tangent_size)
    return np.column_stack([np.linalg.norm(away[:, part], axis=1)
                            for part in manifold.tangent_slices])


def differentiate(steps: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """
    First and second derivatives at the samples from the steps between them (central differences).

    At the ends the second derivative is the neighbour's and the first is extrapolated half a step.

    :param steps: shape ``(samples - 1, n)``, at least two
    """
    between = steps / dt
    acceleration = np.diff(between, axis=0) / dt
    acceleration = np.vstack([acceleration[:1], acceleration, acceleration[-1:]])
    inner = 0.5 * (between[1:] + between[:-1])
    first = between[0] - 0.5 * dt * acceleration[0]
    last = between[-1] + 0.5 * dt * acceleration[-1]
    return np.vstack([first, inner, last]), acceleration


def published_derivatives(manifold: Manifold, points: np.ndarray, targets: np.ndarray,
                          dt: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """
    Velocities, accelerations and logarithms to the targets in the representation as stored.

    Tangents of neighbouring points are subtracted as they stand, as the paper does; on spheres the
    results are projected to the tangent space. Source: [GDMP] eqs. (20), (21).

    :param points: flat samples, shape ``(samples, point_size)``
    :param targets: a flat point for each
    :raises CutLocusError: as `Development`
    """
    table, size = factor_table(manifold.factors), manifold.tangent_size
    forth, gaps = _rowwise(table, ops.LOG, points[:-1], points[1:], size)
    _check_steps(manifold, gaps)
    back, _ = _rowwise(table, ops.LOG, points[1:], points[:-1], size)
    to_goal, gaps = _rowwise(table, ops.LOG, points, targets, size)
    _check_goal(manifold, gaps)
    velocity, acceleration = differentiate(0.5 * (forth - back), dt)
    return (_rowwise(table, ops.TANGENT, points, velocity, size)[0],
            _rowwise(table, ops.TANGENT, points, acceleration, size)[0], to_goal)
