"""Fit of the forcing term: the dynamical system inverted along the demonstrations."""
from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
import math
from typing import NamedTuple
import warnings

import numpy as np

from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.development import Development, differentiate, published_derivatives
from gdmp_ros.dmp.forcing import basis
from gdmp_ros.dmp.primitive import frame_of
from gdmp_ros.dmp.response import LAST
from gdmp_ros.dmp.rollout import Rollout
from gdmp_ros.dmp.segments import targets
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import CutLocusError, GdmpWarning
from gdmp_ros.learning.preparation import (
    blank_primitive,
    common_segments,
    FitSettings,
    LARGEST_CURVATURE_ERROR,
    own_segments,
)
from gdmp_ros.learning.regression import regress

#: Samples of a motion per duration, and at least this many for each basis function.
SAMPLES, SAMPLES_PER_FUNCTION = 1000, 4
#: Inversions; the first leaves 2e-5 of the span or less, the second 4e-6.
INVERSIONS = 2


class _Inverted(NamedTuple):
    """Regression targets from one demonstration."""

    s: np.ndarray
    forcing: np.ndarray
    velocity: np.ndarray


def fit_forcing(demos: list[Demonstration], settings: FitSettings) -> Callable[[int], Skill]:
    """
    Prepare the fit; the result makes a primitive with a number of basis functions.

    Source: [GDMP] eqs. (20), (21).
    """
    blank = blank_primitive(demos, [d.points[0] for d in demos], [d.points[-1] for d in demos],
                            common_segments(demos, settings), settings)
    parts = [_invert(d, blank) for d in demos]
    s, forcing = (np.concatenate([p.s for p in parts]), np.vstack([p.forcing for p in parts]))
    blank = replace(blank, velocity=np.mean([p.velocity for p in parts], axis=0))

    def with_basis(count: int) -> Skill:
        functions = basis(count, settings.gains.alpha_x)
        return replace(blank, weights=regress(functions, settings.gains.alpha_x, s, forcing,
                                              settings.regularization))
    return with_basis


def _invert(demonstration: Demonstration, blank: Skill) -> _Inverted:
    """Solve [GDMP] eq. (17) for the forcing term along a uniform demonstration."""
    manifold, gains, points = blank.manifold, blank.gains, demonstration.flat_points
    duration = demonstration.duration
    dt = duration / (len(points) - 1)
    s = np.linspace(0.0, 1.0, len(points))
    frame = frame_of(blank, demonstration.points[0])
    attracting = targets(manifold, own_segments(blank, demonstration), points[-1], s)
    if blank.connection == 'parallel':
        development = Development(manifold, points, frame, targets=attracting)
        velocity, acceleration = differentiate(development.steps, dt)
        to_target, start_velocity = development.to_target, velocity[0]
    else:
        velocity, acceleration, to_target = published_derivatives(manifold, points, attracting, dt)
        start_velocity = manifold.to_frame(frame, velocity[0])
    x = np.exp(-gains.alpha_x * s)
    forcing = ((duration ** 2 * acceleration + gains.alpha_z * duration * velocity)
               / (gains.alpha_z * gains.beta_z) - to_target + to_target[0] * x[:, None])
    return _Inverted(s, forcing, duration * start_velocity)


class _Motion(NamedTuple):
    """
    A motion that is wanted.

    :ivar start: point
    :ivar goal: point
    :ivar points: flat, at the samples
    """

    start: np.ndarray
    goal: np.ndarray
    points: np.ndarray


def with_published(fitted: Skill, ends: Sequence[tuple[np.ndarray, np.ndarray]]) -> Skill:
    """
    Make the motions of a primitive with the published connection.

    :param fitted: with the exact connection
    :param ends: start and goal of each motion
    """
    s = _samples(fitted.n_basis)
    target = [_Motion(start, goal, _path(fitted, start, goal, s)) for start, goal in ends]
    paths = [motion.points for motion in target]
    published = replace(fitted, connection='published')
    best, smallest = published, np.inf
    for _ in range(INVERSIONS):
        try:
            candidate = _inverted(published, target, paths, s)
            result = [_path(candidate, motion.start, motion.goal, s) for motion in target]
            moves = [_unrolled(fitted, motion, path).ways_to(motion.points)
                     for motion, path in zip(target, result)]
        except CutLocusError:
            break
        error = float(sum((move ** 2).sum() for move in moves))
        if not error < smallest:
            break
        best, smallest = candidate, error
        paths = [_unrolled(fitted, motion, path).moved(move)
                 for motion, path, move in zip(target, paths, moves)]
    rms = math.sqrt(smallest / (len(s) * len(target)))
    span = max(float(np.linalg.norm(_unrolled(fitted, each, each.points).unrolled, axis=1).max())
               for each in target)
    if rms > LARGEST_CURVATURE_ERROR * span:
        warnings.warn(f"connection='published': the roll-out is {rms:.2g} away from the fitted "
                      f"motion, {rms / span:.0%} of the span; connection='parallel' follows it",
                      GdmpWarning, stacklevel=6)
    return best


def _samples(count: int) -> np.ndarray:
    return np.arange(0.0, LAST, 1.0 / max(SAMPLES, SAMPLES_PER_FUNCTION * count))


def _path(primitive: Skill, start: np.ndarray, goal: np.ndarray, s: np.ndarray) -> np.ndarray:
    rollout = Rollout(primitive, start=start, goal=goal, duration=1.0)
    return np.asarray(rollout.sample(s).points.reshape(len(s), -1))


def _inverted(primitive: Skill, target: list[_Motion], paths: list[np.ndarray],
              s: np.ndarray) -> Skill:
    """Solve [GDMP] eq. (17) for the forcing term along the paths."""
    manifold, gains = primitive.manifold, primitive.gains
    during = s <= 1.0
    x = np.exp(-gains.alpha_x * s[during])[:, None]
    forcing = []
    for motion, path in zip(target, paths):
        goal = motion.goal.reshape(-1)
        attracting = targets(manifold, primitive.segments, goal, s)
        velocity, acceleration, to_target = published_derivatives(manifold, path, attracting,
                                                                  s[1] - s[0])
        first = manifold.log(motion.start, attracting[0].reshape(manifold.point_shape))
        pull = (acceleration + gains.alpha_z * velocity) / (gains.alpha_z * gains.beta_z)
        forcing.append((pull - to_target)[during] + first * x)
    weights = regress(basis(primitive.n_basis, gains.alpha_x), gains.alpha_x,
                      np.tile(s[during], len(forcing)), np.vstack(forcing), 0.0)
    return replace(primitive, weights=weights)


def _unrolled(primitive: Skill, motion: _Motion, path: np.ndarray) -> Development:
    return Development(primitive.manifold, path, frame_of(primitive, motion.start))
