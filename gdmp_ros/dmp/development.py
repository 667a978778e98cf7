"""
A curve on a manifold unrolled into Rⁿ, and its derivatives.

A frame is transported along the samples. The step from one sample to the next has coordinates in
it; their cumulative sum is the curve's *development*, an ordinary curve in Rⁿ. Its derivatives are
the covariant derivatives of the curve, and it can be interpolated like any other curve.
"""
from __future__ import annotations

import numpy as np

from gdmp_ros.errors import CutLocusError, DataError
from gdmp_ros.kernels import kernel
from gdmp_ros.manifolds import Manifold
from gdmp_ros.manifolds.factors import (
    CUT_LOCUS_LIMIT,
    log_in_frame,
    RENORMALIZE_EVERY,
    renormalize_frame,
    transport_frame,
)
from gdmp_ros.manifolds.linalg import copy_into
from gdmp_ros.manifolds.manifold import kernel_array
from gdmp_ros.util.profiles import minimum_jerk


@kernel
def _develop(factors, frame, points, targets, frames, steps, to_target, distances, work):
    """
    Transport ``frame`` along the samples.

    :param distances: written: of each neighbour (row 0) and target (row 1) from the cut locus
    """
    for i in range(points.shape[0]):
        copy_into(frame, frames[i])
        distances[1, i] = log_in_frame(factors, frame, targets[i], to_target[i], work)
        if i + 1 < points.shape[0]:
            distances[0, i] = log_in_frame(factors, frame, points[i + 1], steps[i], work)
            transport_frame(factors, frame, steps[i], work)
            if i % RENORMALIZE_EVERY == RENORMALIZE_EVERY - 1:
                renormalize_frame(factors, frame, work)


def _check_steps(manifold: Manifold, distances: np.ndarray) -> None:
    at = int(np.argmin(distances))
    if distances[at] < CUT_LOCUS_LIMIT:
        raise CutLocusError(f'{manifold!r}: samples {at} and {at + 1} are {distances[at]:.2g} rad '
                            f'from the cut locus of each other: sampled too coarsely',
                            float(distances[at]))


def _check_targets(manifold: Manifold, distances: np.ndarray) -> None:
    at = int(np.argmin(distances))
    if distances[at] < CUT_LOCUS_LIMIT:
        raise CutLocusError(f'{manifold!r}: sample {at} is {distances[at]:.2g} rad from the cut '
                            f'locus of the goal, expected at least {CUT_LOCUS_LIMIT:g}',
                            float(distances[at]))


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
        self.points = kernel_array(points)
        self.frames = np.empty((count, manifold.frame_size))
        self.steps = np.empty((count - 1, size))
        self.to_target = np.empty((count, size))
        distances = np.full((2, count), np.inf)
        ends = np.broadcast_to(self.points[-1], points.shape) if targets is None else targets
        _develop(manifold.factor_table, frame.copy(), self.points, kernel_array(ends), self.frames,
                 self.steps, self.to_target, distances, manifold.scratch())
        _check_steps(manifold, distances[0])
        if not np.isfinite(self.steps).all():
            at = int(np.argmin(np.isfinite(self.steps).all(axis=1)))
            raise DataError(f'{manifold!r}: the way from sample {at} to {at + 1} is not finite: a '
                            'point is too near the border of the manifold')
        if targets is not None:
            _check_targets(manifold, distances[1])

    @property
    def unrolled(self) -> np.ndarray:
        """The development: the samples as a curve in Rⁿ, shape ``(samples, n)``."""
        return np.vstack([np.zeros(self.steps.shape[1]), np.cumsum(self.steps, axis=0)])

    def interpolate(self, times: np.ndarray, at: np.ndarray) -> np.ndarray:
        """
        Points of a twice differentiable curve through the samples (a cubic spline, unrolled).

        Between two samples the spline is seen from the frame of either; on a curved space these
        views differ. A share with derivatives zero at both ends leads from one to the other.

        :param times: of the samples, increasing, shape ``(samples,)``
        :param at: times wanted, within those of the samples
        :returns: flat points, shape ``(len(at), point_size)``
        """
        from scipy.interpolate import CubicSpline  # slow to import
        unrolled = self.unrolled
        index = np.clip(np.searchsorted(times, at, side='right') - 1, 0, len(times) - 2)
        interpolated = CubicSpline(times, unrolled)(at)
        before, after = (self.moved(interpolated - unrolled[i], i) for i in (index, index + 1))
        manifold, before = self.manifold, self.manifold.unflat(before)
        tangents, _ = manifold.log_anyway(before, manifold.unflat(after))
        tangents *= minimum_jerk((at - times[index]) / np.diff(times)[index])[:, None]
        return manifold.flat(manifold.exp(before, tangents))

    def smooth(self, times: np.ndarray, cutoff: float) -> np.ndarray:
        """
        Samples of the cubic smoothing spline of the development, back on the manifold.

        The frequency response is ``1 / (1 + (f / cutoff)⁴)`` without delay: 50 % of the amplitude
        at ``cutoff`` [Hz], 94 % at half of it, 6 % at twice. Stamps may be irregular.
        """
        from scipy.interpolate import make_smoothing_spline  # slow to import
        spacing = np.gradient(times)
        mean = (times[-1] - times[0]) / (len(times) - 1)
        penalty = 1.0 / (mean * (2.0 * np.pi * cutoff) ** 4)
        unrolled = self.unrolled
        smooth = np.column_stack([
            make_smoothing_spline(times, column, w=spacing / mean, lam=penalty)(times)
            for column in unrolled.T])
        return self.moved(smooth - unrolled)

    def ways_to(self, points: np.ndarray) -> np.ndarray:
        """
        Logarithm of a point at each sample, coordinates in the frames there.

        :param points: flat, shape ``(samples, point_size)``
        """
        return self.manifold.log_in_frame(self.frames, self.manifold.unflat(points))[0]

    def moved(self, offsets: np.ndarray, index: np.ndarray | None = None) -> np.ndarray:
        """
        Points away from the samples.

        :param offsets: coordinates in the frames at the samples
        :param index: of the samples; all by default
        :returns: flat points
        """
        manifold, frames = self.manifold, self.frames if index is None else self.frames[index]
        moved = manifold.transport_frame(frames, offsets)
        return manifold.flat(manifold.frame_point(moved))


def differentiate(steps: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """
    First and second derivatives at the samples from the steps between them (central differences).

    At the ends the second derivative is that of the neighbour; the first is extrapolated half a
    step.

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

    As in the paper, tangents of neighbouring points are subtracted without transport; on spheres
    the results are projected to the tangent space. Source: [GDMP] eqs. (20), (21).

    :param points: flat samples, shape ``(samples, point_size)``
    :param targets: a flat point for each
    :raises CutLocusError: as `Development`
    """
    points = manifold.unflat(points)
    forward, distances = manifold.log_anyway(points[:-1], points[1:])
    _check_steps(manifold, distances)
    backward, _ = manifold.log_anyway(points[1:], points[:-1])
    to_target, distances = manifold.log_anyway(points, manifold.unflat(targets))
    _check_targets(manifold, distances)
    velocities, accelerations = differentiate(0.5 * (forward - backward), dt)
    return (manifold.project_tangent(points, velocities),
            manifold.project_tangent(points, accelerations), to_target)
