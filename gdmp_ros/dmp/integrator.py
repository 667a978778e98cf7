"""
The compiled integrator: leapfrog steps on a fixed grid of progress, and the state between nodes.

Progress is ``s = ∫ dt/τ`` with a speed that changes at a bounded rate; node k lies at s = k / K.
Within an interval the point drifts half a step with the old velocity; the velocity is advanced by
the exact solution of its linear part, with goal, logarithm and forcing term in the middle; the
point drifts on with the new velocity. Between the nodes the state is interpolated. The path is
therefore the same for any sequence of `advance`, and has a continuous velocity.

Everything that a roll-out knows and changes lies in one flat array (`gdmp_ros.dmp.layout`).
"""
from __future__ import annotations

import math

from gdmp_ros.dmp.forcing import forcing, update_cycle
from gdmp_ros.dmp.fusion import fuse, fusion_size, fusion_view, update_fused_arrival
from gdmp_ros.dmp.goal import (
    BEFORE_END,
    carry_waypoint,
    LOOK_EVERY,
    move_goal,
    update_arrival,
    update_lead,
    update_start_to_goal,
)
from gdmp_ros.dmp.layout import motion_view, state_size, total_size
from gdmp_ros.dmp.obstacles import avoid_obstacles
from gdmp_ros.dmp.relations import keep_relations
from gdmp_ros.dmp.segments import target_at
from gdmp_ros.kernels import always_inline, inlined, kernel, noinline, numbers_at
from gdmp_ros.manifolds.factors import (
    CUT_LOCUS_LIMIT,
    exp,
    factor_log,
    factor_log_in_frame,
    frame_at,
    frame_point,
    from_frame,
    log_in_frame,
    project_tangent,
    renormalize,
    RENORMALIZE_EVERY,
    renormalize_frame,
    to_frame,
    transport_frame,
)
from gdmp_ros.manifolds.linalg import copy_numbers
from gdmp_ros.util.profiles import smoothstep

#: Time constant with which the speed follows its ramp, so that its rate is continuous [s].
SPEED_LAG = 0.02
#: Below this difference the speed is set to that of the ramp.
_ARRIVED = 1e-5
#: The forcing term fades out within this part of a duration after the nominal end.
_FADE = 0.05


@always_inline
def _follow_ramp(scalars, rate, dt):
    """
    Let the speed follow its ramp, which changes by ``rate``, for ``dt``; return the time passed.

    The ramp is continuous with a bounded rate. Behind a first-order lag the speed has a bounded
    and continuous rate, and never leaves the range of the ramp. In closed form, so that the result
    does not depend on how time is cut into steps.
    """
    ramp, speed = scalars.speed_ramp, scalars.speed
    scalars.speed_ramp = ramp + rate * dt
    if rate == 0.0 and abs(speed - ramp) < _ARRIVED:
        scalars.speed, scalars.speed_slope = ramp, 0.0
        return ramp * dt
    gap = speed - ramp + rate * SPEED_LAG
    decay = math.exp(-dt / SPEED_LAG)
    scalars.speed = scalars.speed_ramp - rate * SPEED_LAG + gap * decay
    scalars.speed_slope = rate - gap * decay / SPEED_LAG
    return ((ramp + 0.5 * rate * dt - rate * SPEED_LAG) * dt
            - gap * SPEED_LAG * math.expm1(-dt / SPEED_LAG))


@always_inline
def pass_time(scalars, dt):
    """Advance the progress by ``dt`` [s] while the speed moves to its goal at a bounded rate."""
    goal = scalars.speed_goal * scalars.slowdown
    left = goal - scalars.speed_ramp
    ramp = min(dt, abs(left) / scalars.speed_rate)
    passed = 0.0
    if ramp > 0.0:
        passed += _follow_ramp(scalars, math.copysign(scalars.speed_rate, left), ramp)
    if ramp < dt or left == 0.0:
        scalars.speed_ramp = goal
        passed += _follow_ramp(scalars, 0.0, dt - ramp)
    if passed > 0.0:
        scalars.time_per_progress = scalars.duration * dt / passed
    scalars.progress += passed / scalars.duration
    scalars.time += dt


@always_inline
def _interpolate(motion, u):
    """Write the frame at fraction ``u`` of the interval, and in it both derivatives by s."""
    frames, points, tangents, work = motion.frames, motion.points, motion.tangents, motion.work
    h, n = 1.0 / motion.scalars.steps, motion.sizes.tangent
    offset, rate, curvature = tangents.offset, tangents.rate, tangents.curvature
    if motion.scalars.parallel == 1:
        for i in range(n):
            first = tangents.velocity_before[i]
            change = tangents.velocity[i] - first
            offset[i] = h * (first * (u - 0.5) + 0.5 * change * u * u)
            rate[i] = first + change * u
            curvature[i] = change / h
        copy_numbers(motion.sizes.frame, frames.mid, frames.now)
    else:
        frame_at(motion.factors, points.before, frames.now, work)
        copy_numbers(motion.sizes.frame, frames.now, frames.mid)
        log_in_frame(motion.factors, frames.mid, points.node, offset, work)
        transport_frame(motion.factors, frames.mid, offset, work)
        to_frame(motion.factors, frames.now, tangents.velocity_before, rate, work)
        to_frame(motion.factors, frames.mid, tangents.velocity, curvature, work)
        for i in range(n):
            full, first, last = offset[i], h * rate[i], h * curvature[i]
            square, cube = 3.0 * full - 2.0 * first - last, first + last - 2.0 * full
            offset[i] = u * (first + u * (square + u * cube))
            rate[i] = (first + u * (2.0 * square + 3.0 * u * cube)) / h
            curvature[i] = (2.0 * square + 6.0 * u * cube) / (h * h)
    transport_frame(motion.factors, frames.now, offset, work)


@always_inline
def _write_held_point(motion, point):
    """Write the last node that could be computed."""
    frames, tangents = motion.frames, motion.tangents
    if motion.scalars.parallel == 0:
        copy_numbers(motion.sizes.point, motion.points.node, point)
        return
    if motion.scalars.interval >= 0.0:
        copy_numbers(motion.sizes.frame, frames.mid, frames.now)
        for i in range(motion.sizes.tangent):
            tangents.offset[i] = 0.5 / motion.scalars.steps * tangents.velocity[i]
        transport_frame(motion.factors, frames.now, tangents.offset, motion.work)
    else:
        copy_numbers(motion.sizes.frame, frames.start, frames.now)
    frame_point(motion.factors, frames.now, point, motion.work)


@always_inline
def write_state(motion, out):
    """
    Write time, phase, point, velocity and acceleration of the present moment to ``out``.

    Derivatives are by time [1/s, 1/s²], in the representation at the point.
    """
    noinline()
    scalars, tangents, frames = motion.scalars, motion.tangents, motion.frames
    p, n = motion.sizes.point, motion.sizes.tangent
    out[0] = scalars.time
    if scalars.rhythmic == 1:
        out[1] = 2.0 * math.pi * (scalars.progress - math.floor(scalars.progress))
    else:
        out[1] = math.exp(-scalars.alpha_x * scalars.progress)
    point = numbers_at(out, 2, p)
    velocity, acceleration = numbers_at(out, 2 + p, n), numbers_at(out, 2 + p + n, n)
    if scalars.held == 1:
        _write_held_point(motion, point)
        for i in range(n):
            velocity[i] = 0.0
            acceleration[i] = 0.0
        return
    u = scalars.progress * scalars.steps - scalars.interval
    _interpolate(motion, min(max(u, 0.0), 1.0))
    speed = scalars.speed / scalars.duration
    change = scalars.speed_slope / scalars.duration
    for i in range(n):
        tangents.spare[i] = speed * speed * tangents.curvature[i] + change * tangents.rate[i]
        tangents.rate[i] *= speed
    frame_point(motion.factors, frames.now, point, motion.work)
    from_frame(motion.factors, frames.now, tangents.rate, velocity, motion.work)
    from_frame(motion.factors, frames.now, tangents.spare, acceleration, motion.work)


@always_inline
def _shaping(s):
    """
    Factor of the forcing and start terms at ``s``: 1 to the nominal end, then quickly 0.

    The published terms decay with the phase only, by 1 % per 1 % of a duration past the end. The
    last weight holds the acceleration of the demonstration's last sample, which would go on
    acting: it pulls a tool that follows a LASA letter 13 mm off the goal.
    """
    return 1.0 - smoothstep(min(max((s - 1.0) / _FADE, 0.0), 1.0))


@always_inline
def _correction(s, end):
    """Factor of the start correction: from 1 at s = 0 to 0 at ``end``, with a continuous slope."""
    return 1.0 - smoothstep(s / end) if s < end else 0.0


@always_inline
def _update_target(motion, s):
    """Write the present target at ``s``, and ``Log_{Y0}`` of the first target."""
    scalars, points, p = motion.scalars, motion.points, motion.sizes.point
    moved = scalars.goal_is_moving == 1
    if moved:
        move_goal(motion, s)
    first = moved or scalars.interval < 0.0
    if motion.sizes.waypoints > 0:
        target_at(motion.factors, motion.split, motion.sizes.waypoints, motion.segment_ends,
                  motion.waypoints, points.goal, s, points.target, motion.tangents.spare,
                  motion.work)
        if s >= motion.segment_ends[motion.sizes.waypoints - 1]:
            carry_waypoint(motion, s)
        if first:
            target_at(motion.factors, motion.split, motion.sizes.waypoints, motion.segment_ends,
                      motion.waypoints, points.goal, -1.0, points.first_target,
                      motion.tangents.spare, motion.work)
    else:
        copy_numbers(p, points.goal, points.target)
        copy_numbers(p, points.goal, points.first_target)
    if first:
        update_start_to_goal(motion, points.first_target)


@always_inline
def _needs_renormalization(scalars):
    return int(scalars.interval) % RENORMALIZE_EVERY == RENORMALIZE_EVERY - 1


@always_inline
def _drift_to_mid(motion, h):
    """
    Move on to the middle of the next interval.

    In the frame, the second half drift of the last interval and the first one of the next are one
    step: the same geodesic with the same velocity.
    """
    sizes, scalars, frames, points = motion.sizes, motion.scalars, motion.frames, motion.points
    tangents, offset = motion.tangents, motion.tangents.offset
    if scalars.parallel == 1:
        share = h
        if scalars.interval < 0.0:
            share = 0.5 * h
            copy_numbers(sizes.frame, frames.start, frames.mid)
        for i in range(sizes.tangent):
            offset[i] = share * tangents.velocity[i]
        copy_numbers(sizes.frame, frames.mid, frames.before)
        transport_frame(motion.factors, frames.mid, offset, motion.work)
        if _needs_renormalization(scalars):
            renormalize_frame(motion.factors, frames.mid, motion.work)
        return
    for i in range(sizes.tangent):
        offset[i] = 0.5 * h * tangents.velocity[i]
    copy_numbers(sizes.point, points.node, points.before)
    project_tangent(motion.factors, points.node, offset, tangents.rate, motion.work)
    exp(motion.factors, points.node, tangents.rate, points.mid, motion.work)


@always_inline
def _log_of_target(motion):
    """Write where the target is, seen from the middle of the interval."""
    tangents, table = motion.tangents, motion.factors
    copy_numbers(motion.sizes.tangent, tangents.to_goal, tangents.spare)
    for i in range(table.size):
        factor = table[i]
        if motion.scalars.parallel == 1:
            distance = factor_log_in_frame(factor, motion.frames.mid, motion.points.target,
                                           tangents.to_goal, motion.work)
        else:
            distance = factor_log(factor, motion.points.mid, motion.points.target,
                                  tangents.to_goal, motion.work)
        if distance < CUT_LOCUS_LIMIT:
            # The direction is not unique: keep the last one.
            motion.scalars.cut_locus = 1
            for k in range(factor.tangent, factor.tangent_end):
                tangents.to_goal[k] = tangents.spare[k]


@always_inline
def _advance_velocity(motion, s):
    """
    The velocity after the interval: [GDMP] eq. (17), its linear part solved exactly.

    A rhythmic motion has no term of the start, and its forcing term does not decay.
    """
    scalars, tangents = motion.scalars, motion.tangents
    if scalars.rhythmic == 1:
        x, shaping = 0.0, 1.0
        update_cycle(motion, s)
    else:
        x, shaping = math.exp(-scalars.alpha_x * s), _shaping(s)
        forcing(motion.basis, motion.weights, s, x, tangents.forcing)
    correction = _correction(s, scalars.correction_end)
    copy_numbers(motion.sizes.tangent, tangents.velocity, tangents.velocity_before)
    if scalars.obstacles > 0.0:
        avoid_obstacles(motion)
    for i in range(motion.sizes.tangent):
        term = (tangents.forcing[i] + correction * tangents.start_correction[i]
                - tangents.start_to_goal[i] * x)
        attraction = tangents.to_goal[i] + shaping * term
        tangents.velocity[i] = (motion.decay[i] * tangents.velocity[i]
                                + motion.pull[i] * attraction
                                + (1.0 - motion.decay[i]) * tangents.lead[i])
    if motion.sizes.relations > 0:
        keep_relations(motion, s)


@always_inline
def _drift_to_node(motion, half):
    """The second half drift (`published` only); return a sum that is finite if the result is."""
    sizes, scalars, frames, points = motion.sizes, motion.scalars, motion.frames, motion.points
    tangents = motion.tangents
    if scalars.parallel == 1:
        return _sum(sizes.frame, frames.mid)
    copy_numbers(sizes.tangent, tangents.velocity, tangents.rate)
    project_tangent(motion.factors, points.mid, tangents.rate, tangents.velocity, motion.work)
    for i in range(sizes.tangent):
        tangents.offset[i] = half * tangents.velocity[i]
    exp(motion.factors, points.mid, tangents.offset, points.node, motion.work)
    if _needs_renormalization(scalars):
        renormalize(motion.factors, points.node, motion.work)
    # A matrix outside the cone has no frame: the frame is NaN then.
    frame_at(motion.factors, points.node, frames.now, motion.work)
    return _sum(sizes.frame, frames.now)


@always_inline
def _sum(count, values):
    total = 0.0
    for i in range(count):
        total += values[i]
    return total


@always_inline
def _step(motion):
    """
    Compute the next interval.

    :returns: False, with everything as before, if the result is not finite

    Source: [GDMP] eqs. (17), (18), (22).
    """
    noinline()
    scalars = motion.scalars
    h = 1.0 / scalars.steps
    s = (scalars.interval + 1.5) * h
    _update_target(motion, s)
    _drift_to_mid(motion, h)
    _log_of_target(motion)
    if scalars.target_is_moving == 1:
        update_lead(motion, s)
    _advance_velocity(motion, s)
    sizes, tangents = motion.sizes, motion.tangents
    total = _drift_to_node(motion, 0.5 * h) + _sum(sizes.tangent, tangents.velocity)
    if not math.isfinite(total):
        copy_numbers(sizes.frame, motion.frames.before, motion.frames.mid)
        copy_numbers(sizes.point, motion.points.before, motion.points.node)
        copy_numbers(sizes.tangent, tangents.velocity_before, tangents.velocity)
        return False
    scalars.interval += 1.0
    if s >= BEFORE_END or int(scalars.interval) % LOOK_EVERY == 0:
        update_arrival(motion, s)
    return True


@inlined
def _step_to_present(motion):
    """Compute the intervals up to the present progress; hold the state if one is not finite."""
    scalars = motion.scalars
    # The small number keeps rounding in s from deciding whether a node has been passed.
    while scalars.held == 0 and (scalars.interval < 0.0 or (
            scalars.progress * scalars.steps > scalars.interval + 1.0 + 1e-9)):
        if not _step(motion):
            scalars.held = 1
            scalars.speed, scalars.speed_slope = 0.0, 0.0


@inlined
def _advance_to(motion, state):
    """Let the time pass that ``state`` begins with, and write the state then."""
    scalars = motion.scalars
    if scalars.held == 1:
        scalars.time += state[0]
    else:
        pass_time(scalars, state[0])
    _step_to_present(motion)
    write_state(motion, state)


@always_inline
def _advance_views(memory, motion, state):
    """`_advance_to` for a motion with task frames: one roll-out in each, at the same progress."""
    noinline()
    scalars, sizes = motion.scalars, motion.sizes
    if scalars.held == 1:
        scalars.time += state[0]
    else:
        pass_time(scalars, state[0])
    fusion, width = fusion_view(memory, sizes), state_size(memory)
    at, settled = sizes.own + fusion_size(sizes, int(fusion.settings[0])), True
    for k in range(sizes.views):
        view = motion_view(numbers_at(memory, at, sizes.total - at))
        view.scalars.time, view.scalars.progress = scalars.time, scalars.progress
        view.scalars.speed, view.scalars.speed_slope = scalars.speed, scalars.speed_slope
        _step_to_present(view)
        write_state(view, numbers_at(fusion.states, k * width, width))
        if view.scalars.held == 1:
            scalars.held, scalars.speed, scalars.speed_slope = 1, 0.0, 0.0
        settled = settled and view.scalars.finished == 1
        at += view.sizes.total
    state[0] = scalars.time
    state[1] = math.exp(-scalars.alpha_x * scalars.progress)
    fuse(motion, fusion, state)
    update_fused_arrival(motion, fusion, settled, numbers_at(state, 2, sizes.point))


@kernel
def advance(memory, out):
    """
    Let time pass for every roll-out in ``memory``, and write the states after it to ``out``.

    Where a state will have its time, ``out`` contains the time to pass until then [s]. States of
    all roll-outs follow one another; then come those after the next time step. The first call
    computes the first interval too, so that no time to pass evaluates the start.

    :param memory: one or more memories (`gdmp_ros.dmp.layout`), one after another
    :param out: flat
    """
    at, width = 0, 0
    while at < memory.size:
        rest = numbers_at(memory, at, memory.size - at)
        width += state_size(rest)
        at += total_size(rest)
    at, start = 0, 0
    while at < memory.size:
        rest = numbers_at(memory, at, memory.size - at)
        motion, size = motion_view(rest), state_size(rest)
        for first in range(start, out.size, width):
            if motion.sizes.views > 0:
                _advance_views(rest, motion, numbers_at(out, first, size))
            else:
                _advance_to(motion, numbers_at(out, first, size))
        at += motion.sizes.total
        start += size
