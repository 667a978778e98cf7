"""The goal of a motion, and how it moves after a switch, [GDMP] eq. (28)."""
from __future__ import annotations

from collections.abc import Sequence
import math
from typing import Any

import numpy as np

from gdmp_ros.dmp.layout import Motion
from gdmp_ros.kernels import always_inline, jitable
from gdmp_ros.manifolds import Manifold
from gdmp_ros.manifolds.factors import CUT_LOCUS_LIMIT, exp, log, log_in_frame


@jitable
def goal_fraction(alpha_g: Any, rate: Any, elapsed: Any) -> Any:
    """
    Fraction of the way that a goal has moved, ``elapsed`` after its switch: ``1 - e^(-α_g e)``.

    Where that is faster than ``rate``, the goal moves at ``rate`` first, then by the same closed
    form.

    :param rate: largest rate of the fraction by s
    """
    if alpha_g <= rate:
        return -math.expm1(-alpha_g * elapsed)
    slow = (1.0 - rate / alpha_g) / rate
    if elapsed <= slow:
        return rate * elapsed
    return 1.0 - rate / alpha_g * math.exp(-alpha_g * (elapsed - slow))


@always_inline
def move_goal(motion, s):
    """Write the goal at ``s``, in closed form from its switch."""
    scalars, points, tangents = motion.scalars, motion.points, motion.tangents
    fraction = goal_fraction(scalars.alpha_g, scalars.goal_rate, s - scalars.switched_at)
    for i in range(motion.sizes.tangent):
        tangents.spare[i] = fraction * tangents.goal_direction[i]
    exp(motion.factors, points.goal_from, tangents.spare, points.goal, motion.work)
    if fraction == 1.0:
        scalars.goal_is_moving = 0


@always_inline
def update_start_to_goal(motion, target):
    """Write ``Log_{Y0}(G)``, in the start's frame (parallel) or as a tangent (published)."""
    if motion.scalars.parallel == 1:
        distance = log_in_frame(motion.factors, motion.frames.start, target,
                                motion.tangents.start_to_goal, motion.work)
    else:
        distance = log(motion.factors, motion.points.start, target,
                       motion.tangents.start_to_goal, motion.work)
    if distance < CUT_LOCUS_LIMIT:
        motion.scalars.cut_locus = 1


def switch_goal(manifold: Manifold, motion: Motion, new: np.ndarray,
                speeds: Sequence[float] | None) -> None:
    """
    Let the goal move to a new one from the next node on.

    :param new: point
    :param speeds: fastest it may move in each factor [1/s at speed 1]; None for no limit
    """
    scalars, points = motion.scalars, motion.points
    switched_at = (scalars.interval + 1.0) / scalars.steps
    present = _goal_at(manifold, motion, switched_at)
    direction, distance = manifold.log_anyway(present, new)
    if distance < CUT_LOCUS_LIMIT:
        scalars.cut_locus = 1
    motion.tangents.goal_direction[:] = direction
    points.goal_from[:], points.goal_new[:] = present.reshape(-1), new.reshape(-1)
    scalars.goal_rate = rate = _largest_rate(manifold, present, new, speeds, scalars.duration)
    slow = max(0.0, 1.0 / rate - 1.0 / scalars.alpha_g) if 0.0 < rate < math.inf else 0.0
    scalars.switched_at = switched_at
    scalars.settle_by = max(2.0, switched_at + 1.0 + slow)
    scalars.goal_is_moving, scalars.finished, scalars.not_settled = 1, 0, 0


def _goal_at(manifold: Manifold, motion: Motion, s: float) -> np.ndarray:
    scalars, points, shape = motion.scalars, motion.points, manifold.point_shape
    if not scalars.goal_is_moving:
        return np.array(points.goal.reshape(shape))
    fraction = goal_fraction(scalars.alpha_g, scalars.goal_rate, s - scalars.switched_at)
    return manifold.exp(points.goal_from.reshape(shape), fraction * motion.tangents.goal_direction)


def _largest_rate(manifold: Manifold, present: np.ndarray, new: np.ndarray,
                  speeds: Sequence[float] | None, duration: float) -> float:
    """Largest rate of a goal's fraction by s."""
    if speeds is None:
        return math.inf
    away = manifold.factor_distances(present.reshape(1, -1), new.reshape(1, -1))[0]
    return min((speed * duration / d for speed, d in zip(speeds, away) if d > 0.0),
               default=math.inf)
