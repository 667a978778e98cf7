"""Rest before and after a demonstrated motion."""
from __future__ import annotations

import warnings

import numpy as np

from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.errors import DataError, GdmpWarning
from gdmp_ros.manifolds.manifold import Manifold

#: Rest at the ends of a demonstration is cut off if it is longer than this [s]. At rest every
#: factor stays within its goal tolerance.
REST_S = 0.1
#: Rest longer than this is cut off with a note [s].
TOLD_S = 1.0


def without_rest(demonstration: Demonstration, where: str) -> slice:
    """The samples without rest longer than `REST_S` at either end, but for one sample of it."""
    times, points = demonstration.times, demonstration.flat_points
    first = _resting(demonstration.manifold, times, points)
    last = len(times) - 1 - _resting(demonstration.manifold, -times[::-1], points[::-1])
    if last - first < 2:
        raise DataError(f'{where}: nothing moves: every sample is within the goal '
                        'tolerance of the first')
    before, after = times[first] - times[0], times[-1] - times[last]
    if before + after > TOLD_S:
        warnings.warn(f'{where}: rest is cut off: {before:.1f} s before the motion, {after:.1f} s '
                      'after it', GdmpWarning, stacklevel=3)
    return slice(first, last + 1)


def _resting(manifold: Manifold, times: np.ndarray, points: np.ndarray) -> int:
    """Index of the last sample of the rest at the beginning; 0 without rest."""
    tolerances = [factor.goal_tolerance for factor in manifold.factors]
    origin = np.broadcast_to(points[0], points.shape)
    moved = (manifold.factor_distances(origin, points) > tolerances).any(axis=1)
    last = int(np.argmax(moved)) - 1 if moved.any() else len(points) - 1
    return last if times[last] - times[0] > REST_S else 0
