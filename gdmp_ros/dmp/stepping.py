"""
The compiled heart: leapfrog steps on the fixed grid, and the motion between its nodes.

Time is ``s = ∫ dt/τ``; node k lies at s = k / K. Within a step the point drifts half a step with
the old velocity, the velocity is advanced with goal, logarithm and forcing term at mid-step by the
exact solution of its linear part, and the point drifts on with the new velocity. Between the nodes
the velocity is interpolated in the frame at mid-step (``parallel``: linearly, which meets both
half drifts exactly; ``published``: by a cubic Hermite in the frame of the earlier node;
`gdmp_ros.dmp.moment`). The path
is then the same for any sequence of `advance` and has a continuous velocity.

All that a roll-out knows and changes lies in one flat array, cut by `gdmp_ros.dmp.memory`.
"""
from __future__ import annotations

import math

import numpy as np

from gdmp_ros.compilation import borrowed, compiled, inlined
from gdmp_ros.dmp.forcing import forcing
from gdmp_ros.dmp.memory import (
    ACCELERATION_BOUND,
    ALPHA_G,
    ALPHA_X,
    CUT_LOCUS,
    DECAY,
    DIRECTION,
    END_AT,
    FINISHED,
    FIRST,
    FORCE,
    GOAL,
    GOAL_FROM,
    GOAL_RATE,
    HELD,
    INTERVAL,
    MID,
    MOVING,
    NODE,
    OBSTACLE_GAIN,
    OBSTACLE_RANGE,
    OBSTACLES,
    OFFSET,
    OUT_SIZE,
    PARALLEL,
    PREVIOUS,
    PULL,
    PUSH,
    PUSH_END,
    RATE,
    S,
    SPARE,
    SPEED,
    SPEED_SLOPE,
    START,
    START_TO_GOAL,
    STEERED,
    STEPS,
    STIFFNESS,
    SWITCHED,
    TARGET,
    TIME,
    TO_GOAL,
    views,
    WORK,
    Z,
    Z_PREVIOUS,
)
from gdmp_ros.dmp.moment import evaluate, settle
from gdmp_ros.dmp.segments import target_at
from gdmp_ros.dmp.steering import steer
from gdmp_ros.dmp.tempo import pass_time
from gdmp_ros.manifolds import operations as ops
from gdmp_ros.manifolds.linalg import copy_into
from gdmp_ros.manifolds.registry import apply_factor, apply_factors
from gdmp_ros.manifolds.registry import FRAME as FRAME_COLUMN
from gdmp_ros.manifolds.registry import POINT as POINT_COLUMN
from gdmp_ros.manifolds.registry import VECTOR as VECTOR_COLUMN

_MEND_EVERY = 32
#: Forcing ends within this part of a duration after the nominal end.
_FADE = 0.05
@inlined
def goal_fraction(alpha_g, rate, elapsed):
    """
    How far a goal has moved ``elapsed`` after its switch: ``1 - e^(-α_g e)``, [GDMP] eq. (28).

    Where that would be faster than ``rate`` it moves at ``rate`` until it is not: the same closed
    form from there on.
    """
    if alpha_g <= rate:
        return -math.expm1(-alpha_g * elapsed)
    slow = (1.0 - rate / alpha_g) / rate
    if elapsed <= slow:
        return rate * elapsed
    return 1.0 - rate / alpha_g * math.exp(-alpha_g * (elapsed - slow))


@inlined
def _move_goal(table, numbers, points, vectors, s, work):
    """Goal at ``s`` after a switch, in closed form."""
    fraction = goal_fraction(numbers[ALPHA_G], numbers[GOAL_RATE], s - numbers[SWITCHED])
    for i in range(vectors.shape[1]):
        vectors[SPARE, i] = fraction * vectors[DIRECTION, i]
    apply_factors(table, ops.EXP, points[GOAL_FROM], vectors[SPARE], points[GOAL], work)
    if fraction == 1.0:
        numbers[MOVING] = 0.0


@inlined
def _start_to_goal(table, numbers, frames, points, vectors, goal, work):
    """Refresh ``Log_{Y0}(G)``, in the start's frame (parallel) or representation (published)."""
    if numbers[PARALLEL] > 0.0:
        gap = apply_factors(table, ops.FRAME_LOG, frames[START], goal, vectors[START_TO_GOAL],
                            work)
    else:
        gap = apply_factors(table, ops.LOG, points[START], goal, vectors[START_TO_GOAL], work)
    if gap < ops.CUT_LOCUS_LIMIT:
        numbers[CUT_LOCUS] = 1.0


@inlined
def _drift_to_mid(table, numbers, frames, points, vectors, h, work):
    """
    On to the middle of the next interval.

    In the frame, the last interval's second half drift and the next one's first are one: the same
    geodesic with the same velocity.
    """
    offset = vectors[OFFSET]
    if numbers[PARALLEL] > 0.0:
        share = h
        if numbers[INTERVAL] < 0.0:
            share = 0.5 * h
            copy_into(frames[START], frames[MID])
        for i in range(offset.size):
            offset[i] = share * vectors[Z, i]
        copy_into(frames[MID], frames[PREVIOUS])
        apply_factors(table, ops.MOVE, frames[MID], offset, vectors[RATE], work)
        if int(numbers[INTERVAL]) % _MEND_EVERY == _MEND_EVERY - 1:
            apply_factors(table, ops.MEND, frames[MID], vectors[SPARE], vectors[SPARE], work)
        return
    for i in range(offset.size):
        offset[i] = 0.5 * h * vectors[Z, i]
    copy_into(points[NODE], points[PREVIOUS])
    apply_factors(table, ops.TANGENT, points[NODE], offset, vectors[RATE], work)
    apply_factors(table, ops.EXP, points[NODE], vectors[RATE], points[MID], work)


@inlined
def _look_at_target(table, numbers, frames, points, vectors, target, work):
    """Where the target is, seen from the middle of the interval."""
    copy_into(vectors[TO_GOAL], vectors[SPARE])
    for factor in range(table.shape[0]):
        if numbers[PARALLEL] > 0.0:
            gap = apply_factor(table, factor, ops.FRAME_LOG, frames[MID], target,
                               vectors[TO_GOAL], work)
        else:
            gap = apply_factor(table, factor, ops.LOG, points[MID], target, vectors[TO_GOAL],
                               work)
        if gap < ops.CUT_LOCUS_LIMIT:
            # Undefined there: go on along the last direction.
            numbers[CUT_LOCUS] = 1.0
            for i in range(table[factor, VECTOR_COLUMN], table[factor, VECTOR_COLUMN + 1]):
                vectors[TO_GOAL, i] = vectors[SPARE, i]


@inlined
def _drift_to_node(table, numbers, frames, points, vectors, half, work):
    """The second half drift, `published` only; a sum that is finite if the result is."""
    offset = vectors[OFFSET]
    if numbers[PARALLEL] > 0.0:
        return frames[MID].sum()
    copy_into(vectors[Z], vectors[RATE])
    apply_factors(table, ops.TANGENT, points[MID], vectors[RATE], vectors[Z], work)
    for i in range(offset.size):
        offset[i] = half * vectors[Z, i]
    apply_factors(table, ops.EXP, points[MID], offset, points[NODE], work)
    if int(numbers[INTERVAL]) % _MEND_EVERY == _MEND_EVERY - 1:
        apply_factors(table, ops.MEND_POINT, points[NODE], vectors[SPARE], vectors[SPARE],
                      work)
    # A matrix that has left the cone has no frame; its NaN tells.
    apply_factors(table, ops.FRAME, points[NODE], vectors[SPARE], frames[WORK], work)
    return frames[WORK].sum()


@inlined
def _fade(s):
    """
    Share of the forcing and start terms at ``s``: 1 to the nominal end, then quickly 0.

    The published terms decay with the phase only, by 1 % per 1 % of a duration past the end. What
    the last weight holds, the acceleration at the demonstration's last sample, would go on acting:
    on a LASA letter it pulls the tool 13 mm off the goal again.
    """
    u = min(max((s - 1.0) / _FADE, 0.0), 1.0)
    return 1.0 - u * u * (3.0 - 2.0 * u)


@inlined
def _gentle_end(u):
    """From 1 at ``u`` = 0 to 0 at 1 and beyond, with a continuous slope."""
    u = min(u, 1.0)
    return (1.0 - u) * (1.0 - u) * (1.0 + 2.0 * u)


@inlined
def _steer(layout, table, numbers, obstacles, frames, points, vectors):
    """Add the steering away from obstacles to the target's pull on the position factor."""
    row = table[layout[STEERED]]
    first, size = row[VECTOR_COLUMN], row[VECTOR_COLUMN + 1] - row[VECTOR_COLUMN]
    if numbers[PARALLEL] > 0.0:
        position = frames[MID, row[FRAME_COLUMN]:row[FRAME_COLUMN] + size]
    else:
        position = points[MID, row[POINT_COLUMN]:row[POINT_COLUMN] + size]
    push = vectors[SPARE, first:first + size]
    steer(position, vectors[Z, first:first + size], obstacles[:int(numbers[OBSTACLES]) * size],
          numbers[OBSTACLE_GAIN], numbers[OBSTACLE_RANGE], numbers[ACCELERATION_BOUND], push)
    for i in range(size):
        vectors[TO_GOAL, first + i] += push[i] / numbers[STIFFNESS]


@inlined
def _step(layout, table, numbers, gains, functions, weights, split, ends, waypoints, obstacles,
          frames, points, vectors, work):
    """
    Compute the next interval; False, with everything as before, where the result is not finite.

    Source: [GDMP] eqs. (17), (18), (22), with the linear part solved exactly.
    """
    h = 1.0 / numbers[STEPS]
    s = (numbers[INTERVAL] + 1.5) * h
    x = math.exp(-numbers[ALPHA_X] * s)
    moved = numbers[MOVING] > 0.0
    if moved:
        _move_goal(table, numbers, points, vectors, s, work)
    target, first = points[GOAL], points[GOAL]
    if ends.size > 0:
        target, first = points[TARGET], points[FIRST]
        target_at(table, split, ends, waypoints, points[GOAL], s, target, vectors[SPARE], work)
        if moved or numbers[INTERVAL] < 0.0:
            target_at(table, split, ends, waypoints, points[GOAL], -1.0, first, vectors[SPARE],
                      work)
    if moved or numbers[INTERVAL] < 0.0:
        _start_to_goal(table, numbers, frames, points, vectors, first, work)
    forcing(functions, weights, s, x, vectors[FORCE])
    shaping = _fade(s)
    _drift_to_mid(table, numbers, frames, points, vectors, h, work)
    _look_at_target(table, numbers, frames, points, vectors, target, work)
    copy_into(vectors[Z], vectors[Z_PREVIOUS])
    if numbers[OBSTACLES] > 0.0:
        _steer(layout, table, numbers, obstacles, frames, points, vectors)
    if s < numbers[PUSH_END]:
        push = _gentle_end(s / numbers[PUSH_END])
        for i in range(vectors.shape[1]):
            vectors[FORCE, i] += push * vectors[PUSH, i]
    for i in range(vectors.shape[1]):
        shape = vectors[FORCE, i] - vectors[START_TO_GOAL, i] * x
        pull = vectors[TO_GOAL, i] + shaping * shape
        vectors[Z, i] = gains[DECAY, i] * vectors[Z, i] + gains[PULL, i] * pull
    total = (_drift_to_node(table, numbers, frames, points, vectors, 0.5 * h, work)
             + vectors[Z].sum())
    if not math.isfinite(total):
        copy_into(frames[PREVIOUS], frames[MID])
        copy_into(points[PREVIOUS], points[NODE])
        copy_into(vectors[Z_PREVIOUS], vectors[Z])
        return False
    numbers[INTERVAL] += 1.0
    return True


@compiled
def advance(memory, out):
    """
    Let time pass for every roll-out in ``memory``, and write the moment after it to ``out``.

    Where the time of a moment will be, ``out`` brings the time to pass until then [s]. Moments
    follow one another, each with all roll-outs in turn. The first call computes the first interval
    too, so no time to pass evaluates the start.

    :param memory: one or more of `gdmp_ros.dmp.memory`, one after another
    :param out: flat
    """
    memory, out = borrowed(memory), borrowed(out)
    integers = memory.view(np.int64)
    at, width = 0, 0
    while at < memory.size:
        width += integers[at + OUT_SIZE]
        at += integers[at + END_AT]
    at, start = 0, 0
    while at < memory.size:
        block = integers[at:at + integers[at + END_AT]]
        (table, split, numbers, gains, functions, weights, tolerances, ends, waypoints, obstacles,
         frames, points, vectors, work) = views(block, memory[at:at + block.size])
        for first in range(start, out.size, width):
            row = out[first:first + block[OUT_SIZE]]
            dt = row[0]
            if numbers[HELD] > 0.0:
                numbers[TIME] += dt
            else:
                pass_time(numbers, dt)
            # The small number keeps rounding in s from deciding whether a node has been passed.
            while (numbers[HELD] == 0.0
                   and (numbers[S] * numbers[STEPS] > numbers[INTERVAL] + 1.0 + 1e-9
                        or numbers[INTERVAL] < 0.0)):
                if not _step(block, table, numbers, gains, functions, weights, split, ends,
                             waypoints, obstacles, frames, points, vectors, work):
                    numbers[HELD] = 1.0
                    numbers[SPEED], numbers[SPEED_SLOPE] = 0.0, 0.0
            evaluate(table, numbers, frames, points, vectors, row, work)
            if numbers[S] >= 1.0 and numbers[FINISHED] == 0.0:
                settle(table, tolerances, numbers, frames, points, vectors,
                        row[2:2 + points.shape[1]], work)
        at += block.size
        start += block[OUT_SIZE]
