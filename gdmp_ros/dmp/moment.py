"""
The present moment of a roll-out: between two nodes, at a stop, and whether it is the last.

In ``parallel`` the velocity changes linearly in the frame at the middle of the interval, which
meets both half drifts exactly; in ``published`` by a cubic Hermite in the frame of the earlier
node.
"""
from __future__ import annotations

import math

from gdmp_ros.compilation import inlined
from gdmp_ros.dmp.memory import (
    ALPHA_X,
    CURVE,
    DURATION,
    FINISHED,
    GOAL_NEW,
    HELD,
    INTERVAL,
    MID,
    NODE,
    NOT_SETTLED,
    OFFSET,
    PARALLEL,
    PREVIOUS,
    RATE,
    S,
    SETTLE_BY,
    SPARE,
    SPEED,
    SPEED_SLOPE,
    START,
    STEPS,
    TIME,
    WORK,
    Z,
    Z_PREVIOUS,
)
from gdmp_ros.manifolds import operations as ops
from gdmp_ros.manifolds.linalg import copy_into
from gdmp_ros.manifolds.registry import apply_factors
from gdmp_ros.manifolds.registry import VECTOR as VECTOR_COLUMN


@inlined
def _interpolate(table, numbers, frames, points, vectors, u, work):
    """Frame WORK at fraction ``u`` of the interval; RATE and CURVE, derivatives by s, in it."""
    h = 1.0 / numbers[STEPS]
    offset, rate, curve = vectors[OFFSET], vectors[RATE], vectors[CURVE]
    if numbers[PARALLEL] > 0.0:
        for i in range(offset.size):
            first, change = vectors[Z_PREVIOUS, i], vectors[Z, i] - vectors[Z_PREVIOUS, i]
            offset[i] = h * (first * (u - 0.5) + 0.5 * change * u * u)
            rate[i] = first + change * u
            curve[i] = change / h
        copy_into(frames[MID], frames[WORK])
    else:
        apply_factors(table, ops.FRAME, points[PREVIOUS], vectors[SPARE], frames[WORK], work)
        copy_into(frames[WORK], frames[MID])
        apply_factors(table, ops.FRAME_LOG, frames[MID], points[NODE], offset, work)
        apply_factors(table, ops.MOVE, frames[MID], offset, vectors[SPARE], work)
        apply_factors(table, ops.COORDS, frames[WORK], vectors[Z_PREVIOUS], rate, work)
        apply_factors(table, ops.COORDS, frames[MID], vectors[Z], curve, work)
        for i in range(offset.size):
            whole, first, last = offset[i], h * rate[i], h * curve[i]
            square, cube = 3.0 * whole - 2.0 * first - last, first + last - 2.0 * whole
            offset[i] = u * (first + u * (square + u * cube))
            rate[i] = (first + u * (2.0 * square + 3.0 * u * cube)) / h
            curve[i] = (2.0 * square + 6.0 * u * cube) / (h * h)
    apply_factors(table, ops.MOVE, frames[WORK], offset, vectors[SPARE], work)


@inlined
def _hold(table, numbers, frames, points, vectors, point, work):
    """The last node that could be computed, to ``point``."""
    if numbers[PARALLEL] == 0.0:
        copy_into(points[NODE], point)
        return
    place = START
    if numbers[INTERVAL] >= 0.0:
        place = WORK
        copy_into(frames[MID], frames[WORK])
        for i in range(vectors.shape[1]):
            vectors[OFFSET, i] = 0.5 / numbers[STEPS] * vectors[Z, i]
        apply_factors(table, ops.MOVE, frames[WORK], vectors[OFFSET], vectors[SPARE], work)
    apply_factors(table, ops.POINT, frames[place], vectors[SPARE], point, work)


@inlined
def evaluate(table, numbers, frames, points, vectors, out, work):
    """
    Write time, phase, point, velocity and acceleration of the present moment to ``out``.

    Derivatives are by time [1/s, 1/s²], in the representation at the point.
    """
    p, n = points.shape[1], vectors.shape[1]
    out[0], out[1] = numbers[TIME], math.exp(-numbers[ALPHA_X] * numbers[S])
    point, velocity, acceleration = (out[2:2 + p], out[2 + p:2 + p + n],
                                     out[2 + p + n:2 + p + 2 * n])
    if numbers[HELD] > 0.0:
        _hold(table, numbers, frames, points, vectors, point, work)
        for i in range(n):
            velocity[i] = 0.0
            acceleration[i] = 0.0
        return
    u = numbers[S] * numbers[STEPS] - numbers[INTERVAL]
    _interpolate(table, numbers, frames, points, vectors, min(max(u, 0.0), 1.0),
                 work)
    tempo = numbers[SPEED] / numbers[DURATION]
    change = numbers[SPEED_SLOPE] / numbers[DURATION]
    for i in range(n):
        vectors[SPARE, i] = tempo * tempo * vectors[CURVE, i] + change * vectors[RATE, i]
        vectors[RATE, i] *= tempo
    apply_factors(table, ops.POINT, frames[WORK], vectors[SPARE], point, work)
    apply_factors(table, ops.VECTOR, frames[WORK], vectors[RATE], velocity, work)
    apply_factors(table, ops.VECTOR, frames[WORK], vectors[SPARE], acceleration, work)


@inlined
def settle(table, tolerances, numbers, frames, points, vectors, point, work):
    """Decide whether the motion is over (only once s has reached 1)."""
    apply_factors(table, ops.FRAME, point, vectors[SPARE], frames[WORK], work)
    apply_factors(table, ops.FRAME_LOG, frames[WORK], points[GOAL_NEW], vectors[SPARE], work)
    arrived = True
    for factor in range(table.shape[0]):
        total = 0.0
        for i in range(table[factor, VECTOR_COLUMN], table[factor, VECTOR_COLUMN + 1]):
            total += vectors[SPARE, i] * vectors[SPARE, i]
        arrived = arrived and total <= tolerances[factor] ** 2
    if arrived:
        numbers[FINISHED], numbers[NOT_SETTLED] = 1.0, 0.0
    elif numbers[S] >= numbers[SETTLE_BY]:
        numbers[FINISHED], numbers[NOT_SETTLED] = 1.0, 1.0
