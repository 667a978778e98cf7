"""
The compiled heart: leapfrog steps on the fixed grid, and the motion between its nodes.

Time is ``s = ∫ dt/τ``; node k lies at s = k / K. Within a step the point drifts half a step with
the old velocity, the velocity is advanced with goal, logarithm and forcing term at mid-step by the
exact solution of its linear part, and the point drifts on with the new velocity. Between the nodes
the velocity is interpolated in the frame at mid-step (``parallel``: linearly, which meets both
half drifts exactly; ``published``: by a cubic Hermite in the frame of the earlier node). The path
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
    CURVE,
    CUT_LOCUS,
    DECAY,
    DIRECTION,
    DURATION,
    END_AT,
    FINISHED,
    FIRST,
    FORCE,
    GOAL,
    GOAL_FROM,
    GOAL_NEW,
    GOAL_RATE,
    HELD,
    INTERVAL,
    MID,
    MOVING,
    NODE,
    NOT_SETTLED,
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
    RAMP,
    RATE,
    S,
    SETTLE_BY,
    SLOWDOWN,
    SPARE,
    SPEED,
    SPEED_GOAL,
    SPEED_RATE,
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
from gdmp_ros.dmp.segments import target_at
from gdmp_ros.dmp.steering import steer
from gdmp_ros.manifolds import operations as ops
from gdmp_ros.manifolds.registry import apply_factor, apply_factors
from gdmp_ros.manifolds.registry import FRAME as FRAME_COLUMN
from gdmp_ros.manifolds.registry import POINT as POINT_COLUMN
from gdmp_ros.manifolds.registry import VECTOR as VECTOR_COLUMN

_MEND_EVERY = 32
#: Forcing ends within this part of a duration after the nominal end.
_FADE = 0.05
#: Time constant with which the tempo follows its ramp, so that it has no kink [s].
TEMPO_LAG = 0.02
#: The tempo has arrived when this near: with the lag a step of 0.05 % of nominal speed per second.
_TEMPO_ARRIVED = 1e-5


@compiled
def _copy(source, out):
    for i in range(source.size):
        out[i] = source[i]


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
            _copy(frames[START], frames[MID])
        for i in range(offset.size):
            offset[i] = share * vectors[Z, i]
        _copy(frames[MID], frames[PREVIOUS])
        apply_factors(table, ops.MOVE, frames[MID], offset, vectors[RATE], work)
        if int(numbers[INTERVAL]) % _MEND_EVERY == _MEND_EVERY - 1:
            apply_factors(table, ops.MEND, frames[MID], vectors[SPARE], vectors[SPARE], work)
        return
    for i in range(offset.size):
        offset[i] = 0.5 * h * vectors[Z, i]
    _copy(points[NODE], points[PREVIOUS])
    apply_factors(table, ops.TANGENT, points[NODE], offset, vectors[RATE], work)
    apply_factors(table, ops.EXP, points[NODE], vectors[RATE], points[MID], work)


@inlined
def _look_at_target(table, numbers, frames, points, vectors, target, work):
    """Where the target is, seen from the middle of the interval."""
    _copy(vectors[TO_GOAL], vectors[SPARE])
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
    _copy(vectors[Z], vectors[RATE])
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
    _copy(vectors[Z], vectors[Z_PREVIOUS])
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
        _copy(frames[PREVIOUS], frames[MID])
        _copy(points[PREVIOUS], points[NODE])
        _copy(vectors[Z_PREVIOUS], vectors[Z])
        return False
    numbers[INTERVAL] += 1.0
    return True


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
        _copy(frames[MID], frames[WORK])
    else:
        apply_factors(table, ops.FRAME, points[PREVIOUS], vectors[SPARE], frames[WORK], work)
        _copy(frames[WORK], frames[MID])
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
        _copy(points[NODE], point)
        return
    place = START
    if numbers[INTERVAL] >= 0.0:
        place = WORK
        _copy(frames[MID], frames[WORK])
        for i in range(vectors.shape[1]):
            vectors[OFFSET, i] = 0.5 / numbers[STEPS] * vectors[Z, i]
        apply_factors(table, ops.MOVE, frames[WORK], vectors[OFFSET], vectors[SPARE], work)
    apply_factors(table, ops.POINT, frames[place], vectors[SPARE], point, work)


@inlined
def _evaluate(table, numbers, frames, points, vectors, out, work):
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
def _follow(numbers, rate, dt):
    """
    Let the tempo follow its ramp, which changes by ``rate``, for ``dt``; return the time passed.

    The ramp is continuous and of bounded rate; behind a first-order lag the tempo has a bounded
    and continuous rate, and never leaves the range of the ramp. In closed form, so that the result
    does not depend on how time is cut into steps.
    """
    ramp, speed = numbers[RAMP], numbers[SPEED]
    numbers[RAMP] += rate * dt
    if rate == 0.0 and abs(speed - ramp) < _TEMPO_ARRIVED:
        numbers[SPEED], numbers[SPEED_SLOPE] = ramp, 0.0
        return ramp * dt
    gap = speed - ramp + rate * TEMPO_LAG
    decay = math.exp(-dt / TEMPO_LAG)
    numbers[SPEED] = numbers[RAMP] - rate * TEMPO_LAG + gap * decay
    numbers[SPEED_SLOPE] = rate - gap * decay / TEMPO_LAG
    return ((ramp + 0.5 * rate * dt - rate * TEMPO_LAG) * dt
            - gap * TEMPO_LAG * math.expm1(-dt / TEMPO_LAG))


@inlined
def _pass_time(numbers, dt):
    """Advance ``s`` by ``dt`` of time while the tempo moves to its goal at a bounded rate."""
    goal = numbers[SPEED_GOAL] * numbers[SLOWDOWN]
    left = goal - numbers[RAMP]
    ramp = min(dt, abs(left) / numbers[SPEED_RATE])
    travelled = 0.0
    if ramp > 0.0:
        travelled += _follow(numbers, math.copysign(numbers[SPEED_RATE], left), ramp)
    if ramp < dt or left == 0.0:
        numbers[RAMP] = goal
        travelled += _follow(numbers, 0.0, dt - ramp)
    numbers[S] += travelled / numbers[DURATION]
    numbers[TIME] += dt


@inlined
def _settle(table, tolerances, numbers, frames, points, vectors, point, work):
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
                _pass_time(numbers, dt)
            # The small number keeps rounding in s from deciding whether a node has been passed.
            while (numbers[HELD] == 0.0
                   and (numbers[S] * numbers[STEPS] > numbers[INTERVAL] + 1.0 + 1e-9
                        or numbers[INTERVAL] < 0.0)):
                if not _step(block, table, numbers, gains, functions, weights, split, ends,
                             waypoints, obstacles, frames, points, vectors, work):
                    numbers[HELD] = 1.0
                    numbers[SPEED], numbers[SPEED_SLOPE] = 0.0, 0.0
            _evaluate(table, numbers, frames, points, vectors, row, work)
            if numbers[S] >= 1.0 and numbers[FINISHED] == 0.0:
                _settle(table, tolerances, numbers, frames, points, vectors,
                        row[2:2 + points.shape[1]], work)
        at += block.size
        start += block[OUT_SIZE]
