"""Fit of the forcing term: the dynamical system inverted along the demonstrations."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.development import Development, differentiate, published_derivatives
from gdmp_ros.dmp.forcing import basis
from gdmp_ros.dmp.primitive import frame_of, Primitive
from gdmp_ros.dmp.segments import targets
from gdmp_ros.learning.preparation import (
    blank_primitive,
    common_segments,
    FitSettings,
    own_segments,
)
from gdmp_ros.learning.regression import regress


class _Inverted(NamedTuple):
    """Regression targets from one demonstration."""

    s: np.ndarray
    forcing: np.ndarray
    velocity: np.ndarray


def fit_forcing(shown: list[Demonstration], settings: FitSettings) -> Callable[[int], Primitive]:
    """
    Prepare the fit; the result makes a primitive with a number of basis functions.

    Source: [GDMP] eqs. (20), (21).
    """
    blank = blank_primitive(shown, [d.points[0] for d in shown], [d.points[-1] for d in shown],
                            common_segments(shown, settings), settings)
    parts = [_invert(d, blank) for d in shown]
    s, forcing = (np.concatenate([p.s for p in parts]), np.vstack([p.forcing for p in parts]))
    blank = replace(blank, velocity=np.mean([p.velocity for p in parts], axis=0))

    def with_basis(count: int) -> Primitive:
        functions = basis(count, settings.gains.alpha_x)
        return replace(blank, weights=regress(functions, settings.gains.alpha_x, s, forcing,
                                              settings.regularization))
    return with_basis


def _invert(demonstration: Demonstration, blank: Primitive) -> _Inverted:
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
