"""Whether a motion has finished: at its goal and at rest relative to it, for a while."""
from __future__ import annotations

import math

from gdmp_ros.kernels import always_inline, noinline
from gdmp_ros.manifolds.factors import log_in_frame, to_frame

#: A factor is at rest below this part of its largest speed …
REST_SHARE = 0.01
#: … or, if it hardly moves, below this many goal tolerances per second (2 mm/s for a position).
STILL_TOLERANCES = 4.0
#: Part of a duration for which the motion must be at rest at its goal: a pause is no rest.
DWELL = 0.05


@always_inline
def _norm(factor, values):
    total = 0.0
    for k in range(factor.tangent, factor.tangent_end):
        total += values[k] * values[k]
    return math.sqrt(total)


@always_inline
def _relative_velocity(motion):
    """Write the velocity by s relative to the target, in a frame."""
    tangents, n = motion.tangents, motion.sizes.tangent
    for i in range(n):
        tangents.rate[i] = tangents.velocity[i] - tangents.lead[i]
    if motion.scalars.parallel == 0:
        to_frame(motion.factors, motion.frames.now, tangents.rate, tangents.curvature, motion.work)
        for i in range(n):
            tangents.rate[i] = tangents.curvature[i]


@always_inline
def _way_to_goal(motion):
    """Write the coordinates of the goal, seen from the motion."""
    if motion.scalars.parallel == 1:
        for i in range(motion.sizes.tangent):
            motion.tangents.curvature[i] = motion.tangents.to_goal[i]
    else:
        log_in_frame(motion.factors, motion.frames.now, motion.points.goal,
                     motion.tangents.curvature, motion.work)


@always_inline
def _has_arrived(motion):
    scalars, tangents = motion.scalars, motion.tangents
    _way_to_goal(motion)
    arrived = True
    for i in range(motion.factors.size):
        factor = motion.factors[i]
        away = _norm(factor, tangents.curvature)
        if scalars.goal_is_moving == 1:
            away += scalars.offset_left * _norm(factor, tangents.goal_offset)
        arrived = arrived and away <= motion.tolerances[i]
    _relative_velocity(motion)
    for i in range(motion.factors.size):
        still = motion.still_speeds[i] * scalars.duration
        fastest = REST_SHARE * motion.peaks[i] if motion.peaks[i] > still else still
        arrived = arrived and _norm(motion.factors[i], tangents.rate) <= fastest
    return arrived


@always_inline
def update_arrival(motion, s):
    """
    Note the largest velocities up to the nominal end, and decide whether the motion has finished.

    Called after every interval, so that the result does not depend on how time is cut into steps.
    """
    noinline()
    scalars = motion.scalars
    if s < 1.0:
        _relative_velocity(motion)
        for i in range(motion.factors.size):
            speed = _norm(motion.factors[i], motion.tangents.rate)
            motion.peaks[i] = max(motion.peaks[i], speed)
    if s < 1.0 - DWELL or scalars.finished == 1:
        return
    if not _has_arrived(motion):
        scalars.arrived_at = -1.0
        if s >= scalars.settle_by:
            scalars.finished, scalars.not_settled = 1, 1
        return
    if scalars.arrived_at < 0.0:
        scalars.arrived_at = s
    if s >= max(1.0, scalars.arrived_at + DWELL):
        scalars.finished, scalars.not_settled = 1, 0
