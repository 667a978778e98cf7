"""
A curve on a manifold unrolled into Rⁿ, and its derivatives.

A frame is carried parallel along the samples. The step from one sample to the next has coordinates
in it; their running sum is the curve's *development*, an ordinary curve in Rⁿ: its derivatives are
the covariant derivatives of the curve, and it can be interpolated like any other.
"""
from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from gdmp_ros.compilation import compiled
from gdmp_ros.errors import CutLocusError
from gdmp_ros.manifolds import Manifold
from gdmp_ros.manifolds import operations as ops
from gdmp_ros.manifolds.registry import apply_factors, factor_table

#: Frames are re-orthonormalised after this many moves.
MEND_EVERY = 32


@compiled
def _develop(table, frame, points, goal, frames, steps, to_goal):
    none = np.empty(0)
    least_step, least_goal, at_step, at_goal = np.inf, np.inf, 0, 0
    for i in range(points.shape[0]):
        frames[i] = frame
        gap = apply_factors(table, ops.FRAME_LOG, frame, goal, to_goal[i])
        if gap < least_goal:
            least_goal, at_goal = gap, i
        if i + 1 < points.shape[0]:
            gap = apply_factors(table, ops.FRAME_LOG, frame, points[i + 1], steps[i])
            if gap < least_step:
                least_step, at_step = gap, i
            apply_factors(table, ops.MOVE, frame, steps[i], none)
            if i % MEND_EVERY == MEND_EVERY - 1:
                apply_factors(table, ops.MEND, frame, none, none)
    return least_step, at_step, least_goal, at_goal


@compiled
def _difference(table, points, goal, steps, to_goal):
    back = np.empty(steps.shape[1])
    least_step, least_goal, at_step, at_goal = np.inf, np.inf, 0, 0
    for i in range(points.shape[0]):
        gap = apply_factors(table, ops.LOG, points[i], goal, to_goal[i])
        if gap < least_goal:
            least_goal, at_goal = gap, i
        if i + 1 < points.shape[0]:
            gap = apply_factors(table, ops.LOG, points[i], points[i + 1], steps[i])
            apply_factors(table, ops.LOG, points[i + 1], points[i], back)
            if gap < least_step:
                least_step, at_step = gap, i
            for j in range(back.size):
                steps[i, j] = 0.5 * (steps[i, j] - back[j])
    return least_step, at_step, least_goal, at_goal


@compiled
def _tangents(table, points, vectors):
    work = np.empty(vectors.shape[1])
    for i in range(points.shape[0]):
        work[:] = vectors[i]
        apply_factors(table, ops.TANGENT, points[i], work, vectors[i])


@compiled
def _place(table, frames, index, offsets, points):
    none = np.empty(0)
    for i in range(index.size):
        frame = frames[index[i]].copy()
        apply_factors(table, ops.MOVE, frame, offsets[i], none)
        apply_factors(table, ops.POINT, frame, none, points[i])


def _check(manifold: Manifold, gaps: tuple[float, int, float, int]) -> None:
    step_gap, step_at, goal_gap, goal_at = gaps
    if step_gap < ops.CUT_LOCUS_LIMIT:
        raise CutLocusError(f'{manifold!r}: samples {step_at} and {step_at + 1} are {step_gap:.2g} '
                            f'rad from the cut locus of each other: sampled too coarsely', step_gap)
    if goal_gap < ops.CUT_LOCUS_LIMIT:
        raise CutLocusError(f'{manifold!r}: sample {goal_at} is {goal_gap:.2g} rad from the cut '
                            f'locus of the goal, expected at least {ops.CUT_LOCUS_LIMIT:g}',
                            goal_gap)


class Development:
    """Samples of a curve with their frames, steps and logarithms to a goal."""

    def __init__(self, manifold: Manifold, points: np.ndarray, frame: np.ndarray,
                 goal: np.ndarray | None = None):
        """
        Unroll a curve.

        :param points: samples, flat, shape ``(samples, point_size)``
        :param frame: frame at the first sample
        :param goal: point; the last sample by default
        :raises CutLocusError: if neighbours, or a sample and the goal, lie on each other's cut locus
        """
        count, size = len(points), manifold.tangent_size
        self.manifold = manifold
        self.table = factor_table(manifold.factors)
        self.points = np.require(points, requirements='CW')
        self.frames = np.empty((count, manifold.frame_size))
        self.steps = np.empty((count - 1, size))
        self.to_goal = np.empty((count, size))
        goal_point = self.points[-1] if goal is None else manifold._flat(goal)
        gaps = _develop(self.table, frame.copy(), self.points, goal_point, self.frames, self.steps,
                        self.to_goal)
        # Without a goal asked for, only the steps must be unique.
        _check(manifold, gaps if goal is not None else (gaps[0], gaps[1], np.inf, 0))

    def interpolate(self, times: np.ndarray, at: np.ndarray) -> np.ndarray:
        """
        Points of a twice differentiable curve through the samples (a cubic spline, unrolled).

        :param times: of the samples, increasing, shape ``(samples,)``
        :param at: times wanted, within those of the samples
        :returns: flat points, shape ``(len(at), point_size)``
        """
        unrolled = np.vstack([np.zeros(self.steps.shape[1]), np.cumsum(self.steps, axis=0)])
        index = np.clip(np.searchsorted(times, at, side='right') - 1, 0, len(times) - 1)
        offsets = np.ascontiguousarray(CubicSpline(times, unrolled)(at) - unrolled[index])
        out = np.empty((len(at), self.manifold.point_size))
        _place(self.table, self.frames, index, offsets, out)
        return out


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


def published_derivatives(manifold: Manifold, points: np.ndarray, goal: np.ndarray,
                          dt: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """
    Velocities, accelerations and logarithms to the goal in the representation as stored.

    Tangents of neighbouring points are subtracted as they stand, as the paper does; on spheres the
    results are projected to the tangent space. Source: [GDMP] eqs. (20), (21).

    :param points: flat samples, shape ``(samples, point_size)``
    :raises CutLocusError: as `Development`
    """
    table = factor_table(manifold.factors)
    points = np.require(points, requirements='CW')
    steps = np.empty((len(points) - 1, manifold.tangent_size))
    to_goal = np.empty((len(points), manifold.tangent_size))
    _check(manifold, _difference(table, points, manifold._flat(goal), steps, to_goal))
    velocity, acceleration = differentiate(steps, dt)
    _tangents(table, points, velocity)
    _tangents(table, points, acceleration)
    return velocity, acceleration, to_goal
