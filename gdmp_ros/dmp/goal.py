"""The goal of a motion: how it moves to a new one, [GDMP] eq. (28), and whether it is reached."""
from __future__ import annotations

from collections.abc import Sequence
import math
from typing import Any

import numpy as np

from gdmp_ros.dmp.layout import Motion
from gdmp_ros.kernels import always_inline, jitable, noinline, numbers_at
from gdmp_ros.manifolds import Manifold
from gdmp_ros.manifolds.factors import (
    CUT_LOCUS_LIMIT,
    factor_log_in_frame,
    frame_at,
    frame_point,
    from_frame,
    log,
    log_in_frame,
    to_frame,
    transport_frame,
)
from gdmp_ros.manifolds.linalg import copy_numbers, norm
from gdmp_ros.util.profiles import smoothstep

#: A goal nearer than this to being opposite to the last waypoint carries it [rad].
OPPOSITE = 0.3
#: A goal has reached its target after this many time constants: e^-8 of the way is left.
SETTLED = 8.0
#: A velocity of the goal below this part of a still factor's limit is taken as zero.
_NEGLIGIBLE = 1e-6
#: A factor is at rest below this part of its largest speed …
REST_SHARE = 0.01
#: … or, if it hardly moves, below this many goal tolerances per second (2 mm/s for a position).
STILL_TOLERANCES = 4.0
#: Part of a duration for which the motion must rest at its goal: a short pause does not count.
DWELL = 0.05
#: From this progress on a motion may have arrived; before it, the largest velocities are noted
#: once in so many intervals, at most 1/500 of a duration.
BEFORE_END, LOOK_EVERY = 1.0 - DWELL, 8


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


@jitable
def target_shift(scalars: Any, s: Any) -> Any:
    """Time for which the target has moved from its anchor at ``s`` [s]."""
    if scalars.target_by_progress == 1:
        # The term with Log_Y0(G) takes the share x of the way away. With 1 + x instead of 1 only
        # x² is missing, which is nothing at the end.
        left = min(s - scalars.target_since, 0.0) * scalars.duration
        return left * (1.0 + math.exp(-scalars.alpha_x * s))
    return (scalars.time + (s - scalars.progress) * scalars.time_per_progress
            - scalars.target_since)


@always_inline
def move_goal(motion, s):
    """Write the goal at ``s``, and its frame."""
    scalars, tangents, frame = motion.scalars, motion.tangents, motion.frames.goal
    fraction = goal_fraction(scalars.alpha_g, scalars.goal_rate, s - scalars.switched_at)
    copy_numbers(motion.sizes.frame, motion.frames.anchor, frame)
    if scalars.target_is_moving == 1:
        shift = target_shift(scalars, s)
        for i in range(motion.sizes.tangent):
            tangents.spare[i] = shift * tangents.target_velocity[i]
        transport_frame(motion.factors, frame, tangents.spare, motion.work)
    scalars.offset_left = 1.0 - fraction
    for i in range(motion.sizes.tangent):
        tangents.spare[i] = scalars.offset_left * tangents.goal_offset[i]
    transport_frame(motion.factors, frame, tangents.spare, motion.work)
    frame_point(motion.factors, frame, motion.points.goal, motion.work)
    if fraction == 1.0 and scalars.target_is_moving == 0:
        copy_numbers(motion.sizes.point, motion.points.anchor, motion.points.goal)
        scalars.goal_is_moving = 0


@always_inline
def _follow_target_velocity(motion, s):
    """Let the velocity of the goal follow that of its target, like the goal itself."""
    scalars, tangents = motion.scalars, motion.tangents
    share = -math.expm1(-scalars.alpha_g / scalars.steps)
    moving = False
    passed = scalars.target_by_progress == 1 and s >= scalars.target_since
    for i in range(motion.factors.size):
        factor = motion.factors[i]
        for k in range(factor.tangent, factor.tangent_end):
            target = 0.0 if passed else tangents.target_velocity[k]
            tangents.goal_velocity[k] += share * (target - tangents.goal_velocity[k])
            moving = moving or max(abs(target), abs(tangents.goal_velocity[k])) > (
                _NEGLIGIBLE * motion.still_speeds[i])
    if not moving:
        for k in range(motion.sizes.tangent):
            tangents.target_velocity[k], tangents.goal_velocity[k] = 0.0, 0.0
        scalars.target_is_moving = 0


@always_inline
def _share_of_goal(motion, factor, s):
    """How much the target of a factor moves with the goal: 1 unless it is split."""
    count = motion.sizes.waypoints
    if count == 0 or motion.split[factor] == 0.0:
        return 1.0
    begin = motion.segment_ends[count - 1]
    return smoothstep(min((s - begin) / (1.0 - begin), 1.0)) if s > begin else 0.0


@always_inline
def carry_waypoint(motion, s):
    """
    Write the target in the last segment where the goal is nearly opposite to the last waypoint.

    The geodesic between them turns quickly there, and flips where they are opposite. From then on
    the goal carries the waypoint with it, in its frame.
    """
    noinline()
    scalars, tangents, spare = motion.scalars, motion.tangents, motion.frames.spare
    last = motion.sizes.waypoints - 1
    begin = motion.segment_ends[last]
    if scalars.waypoint_is_carried == 0:
        waypoint = numbers_at(motion.waypoints, last * motion.sizes.point, motion.sizes.point)
        for i in range(motion.factors.size):
            factor = motion.factors[i]
            distance = factor_log_in_frame(factor, motion.frames.goal, waypoint,
                                           tangents.to_waypoint, motion.work)
            if motion.split[i] == 1.0 and distance < OPPOSITE:
                scalars.waypoint_is_carried = scalars.cut_locus = 1
    if scalars.waypoint_is_carried == 0:
        return
    left = 1.0 - smoothstep(min((s - begin) / (1.0 - begin), 1.0))
    for i in range(motion.factors.size):
        factor = motion.factors[i]
        for k in range(factor.tangent, factor.tangent_end):
            tangents.spare[k] = left * motion.split[i] * tangents.to_waypoint[k]
    copy_numbers(motion.sizes.frame, motion.frames.goal, spare)
    transport_frame(motion.factors, spare, tangents.spare, motion.work)
    frame_point(motion.factors, spare, motion.points.target, motion.work)


@always_inline
def update_lead(motion, s):
    """Write the velocity of the target by s, transported from the goal to the present point."""
    noinline()
    scalars, tangents, spare = motion.scalars, motion.tangents, motion.frames.spare
    _follow_target_velocity(motion, s)
    rate = scalars.duration if scalars.target_by_progress == 1 else scalars.time_per_progress
    from_frame(motion.factors, motion.frames.goal, tangents.goal_velocity, tangents.spare,
               motion.work)
    if scalars.parallel == 1:
        copy_numbers(motion.sizes.frame, motion.frames.mid, spare)
    else:
        frame_at(motion.factors, motion.points.mid, spare, motion.work)
        copy_numbers(motion.sizes.frame, spare, motion.frames.now)
    log_in_frame(motion.factors, spare, motion.points.goal, tangents.offset, motion.work)
    transport_frame(motion.factors, spare, tangents.offset, motion.work)
    to_frame(motion.factors, spare, tangents.spare, tangents.lead, motion.work)
    for i in range(motion.factors.size):
        factor = motion.factors[i]
        for k in range(factor.tangent, factor.tangent_end):
            tangents.lead[k] *= rate * _share_of_goal(motion, i, s)
    if scalars.parallel == 0:
        copy_numbers(motion.sizes.tangent, tangents.lead, tangents.offset)
        from_frame(motion.factors, motion.frames.now, tangents.offset, tangents.lead, motion.work)


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


def present_target(manifold: Manifold, motion: Motion) -> np.ndarray:
    """The point that was asked for last, moved on with its velocity to the present."""
    scalars, anchor = motion.scalars, motion.points.anchor
    if not scalars.target_is_moving or scalars.target_by_progress:
        return np.array(anchor.reshape(manifold.point_shape))
    shift = target_shift(scalars, scalars.progress)
    tangent = manifold.from_frame(motion.frames.anchor, shift * motion.tangents.target_velocity)
    return manifold.exp(anchor.reshape(manifold.point_shape), tangent)


def switch_goal(manifold: Manifold, motion: Motion, new: np.ndarray, velocity: np.ndarray | None,
                speeds: Sequence[float] | None) -> None:
    """
    Let the goal move to a new one from the next node on.

    :param new: point
    :param velocity: with which the new goal moves on, tangent there [1/s]; None for a goal at
        rest, but a velocity that belongs to the nominal end stays (``target_by_progress``)
    :param speeds: fastest it may move in each factor [1/s at speed 1]; None for no limit
    """
    scalars, points, tangents = motion.scalars, motion.points, motion.tangents
    switched_at = (scalars.interval + 1.0) / scalars.steps
    followed = bool(scalars.target_is_moving) and not scalars.target_by_progress
    far = not followed or bool((manifold.factor_distances(
        present_target(manifold, motion).reshape(1, -1), new.reshape(1, -1))[0]
                                > motion.tolerances).any())
    # The switch takes effect at the next node: by then the target has moved on.
    before = _goal_frame(manifold, motion, switched_at)
    at_switch, moved = new, velocity
    if velocity is not None:
        scalars.target_by_progress, scalars.target_since = 0, scalars.time
        shift = target_shift(scalars, switched_at)
        at_switch, moved = _moved_on(manifold, new, velocity, shift)
    step, distance = manifold.log_in_frame(before, at_switch)
    if distance < CUT_LOCUS_LIMIT:
        scalars.cut_locus = 1
    frame = manifold.transport_frame(before, step)
    if moved is not None:
        tangents.target_velocity[:] = manifold.to_frame(frame, moved)
        scalars.target_is_moving = 1
        frame = manifold.transport_frame(frame, -shift * tangents.target_velocity)
    elif not scalars.target_by_progress:
        tangents.target_velocity[:] = 0.0
    motion.frames.anchor[:], points.anchor[:] = frame, new.reshape(-1)
    # In the transported frame the way back has the opposite coordinates.
    tangents.goal_offset[:] = -step
    scalars.goal_rate = rate = _largest_rate(manifold, step, speeds, scalars.duration)
    slow = max(0.0, 1.0 / rate - 1.0 / scalars.alpha_g) if 0.0 < rate < math.inf else 0.0
    scalars.switched_at = switched_at
    scalars.goal_is_moving = 1
    if far or velocity is None:
        scalars.finished = scalars.not_settled = 0
        scalars.arrived_at = -1.0
        scalars.settle_by = max(2.0, switched_at + max(1.0, SETTLED / scalars.alpha_g) + slow)


def _moved_on(manifold: Manifold, point: np.ndarray, velocity: np.ndarray, time: float
              ) -> tuple[np.ndarray, np.ndarray]:
    """A point after it has moved with a velocity for a time, and its velocity there."""
    frame = manifold.frame(point)
    coordinates = manifold.to_frame(frame, velocity)
    frame = manifold.transport_frame(frame, time * coordinates)
    return manifold.exp(point, time * velocity), manifold.from_frame(frame, coordinates)


def end_with(manifold: Manifold, motion: Motion, velocity: np.ndarray) -> None:
    """
    Let the target move through the goal at the nominal end, and stop there.

    :param velocity: tangent at the goal [1/s at speed 1]
    """
    motion.tangents.target_velocity[:] = manifold.to_frame(motion.frames.anchor, velocity)
    scalars = motion.scalars
    scalars.target_by_progress = scalars.target_is_moving = scalars.goal_is_moving = 1
    scalars.target_since = 1.0


def _goal_frame(manifold: Manifold, motion: Motion, s: float) -> np.ndarray:
    """Frame at the goal at ``s``."""
    scalars, tangents, frame = motion.scalars, motion.tangents, np.array(motion.frames.anchor)
    if not scalars.goal_is_moving:
        return frame
    if scalars.target_is_moving:
        frame = manifold.transport_frame(frame, target_shift(scalars, s)
                                         * tangents.target_velocity)
    left = 1.0 - goal_fraction(scalars.alpha_g, scalars.goal_rate, s - scalars.switched_at)
    return manifold.transport_frame(frame, left * tangents.goal_offset)


def _largest_rate(manifold: Manifold, step: np.ndarray, speeds: Sequence[float] | None,
                  duration: float) -> float:
    """Largest rate of a goal's fraction by s."""
    if speeds is None:
        return math.inf
    distances = [float(np.linalg.norm(step[columns])) for columns in manifold.tangent_slices]
    return min((speed * duration / d for speed, d in zip(speeds, distances) if d > 0.0),
               default=math.inf)


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
        distance = _norm(factor, tangents.curvature)
        if scalars.goal_is_moving == 1:
            distance += scalars.offset_left * _norm(factor, tangents.goal_offset)
        arrived = arrived and distance <= motion.tolerances[i]
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
