"""
The state of a roll-out between two nodes.

In ``parallel`` the velocity changes linearly in the frame at the middle of the interval, which
agrees exactly with both half drifts; in ``published`` by a cubic Hermite polynomial in the frame
of the earlier node.
"""
from __future__ import annotations

import math

from gdmp_ros.kernels import always_inline, noinline, numbers_at
from gdmp_ros.manifolds.factors import (
    frame_at,
    frame_point,
    from_frame,
    log_in_frame,
    to_frame,
    transport_frame,
)
from gdmp_ros.manifolds.linalg import copy_numbers


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
            whole, first, last = offset[i], h * rate[i], h * curvature[i]
            square, cube = 3.0 * whole - 2.0 * first - last, first + last - 2.0 * whole
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
