"""Whether a motion has finished: at its goal and at rest relative to it, for a while."""
from __future__ import annotations

from gdmp_ros.kernels import always_inline, noinline, numbers_at
from gdmp_ros.manifolds.factors import log_in_frame, to_frame
from gdmp_ros.manifolds.linalg import norm

#: A factor is at rest below this part of its largest speed …
REST_SHARE = 0.01
#: … or, if it hardly moves, below this many goal tolerances per second (2 mm/s for a position).
STILL_TOLERANCES = 4.0
#: Part of a duration for which the motion must rest at its goal: a short pause does not count.
DWELL = 0.05

#: From this progress on a motion may have arrived; before it, the largest velocities are noted
#: once in so many intervals, at most 1/500 of a duration.
BEFORE_END, LOOK_EVERY = 1.0 - DWELL, 8


@always_inline
def _norm(factor, values):
    size = factor.tangent_end - factor.tangent
    return norm(size, numbers_at(values, factor.tangent, size))


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

    Called after the same intervals however time is cut into steps, so that the result is the same.
    A rhythmic motion finishes when its amplitude has been set to 0.
    """
    noinline()
    scalars = motion.scalars
    if s < 1.0:
        _relative_velocity(motion)
        for i in range(motion.factors.size):
            speed = _norm(motion.factors[i], motion.tangents.rate)
            motion.peaks[i] = max(motion.peaks[i], speed)
    if s < BEFORE_END or scalars.finished == 1 or scalars.amplitude_goal > 0.0:
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
