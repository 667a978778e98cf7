"""
The compiled heart: leapfrog steps on the fixed grid, and the motion between its nodes.

Time is ``s = ∫ dt/τ``; node k lies at s = k / K. Within a step the point drifts half a step with
the old velocity, the velocity is advanced with goal, logarithm and forcing term at mid-step by the
exact solution of its linear part, and the point drifts on with the new velocity. Between the nodes
the velocity is interpolated in the frame at mid-step (``parallel``: linearly, which meets both
half drifts exactly; ``published``: by a cubic Hermite in the frame of the earlier node). The path
is then the same for any sequence of `advance` and has a continuous velocity.

Rows and entries of the roll-out's arrays are named here, once.
"""
from __future__ import annotations

import math

from gdmp_ros.compilation import compiled, inlined
from gdmp_ros.dmp.forcing import forcing
from gdmp_ros.manifolds import operations as ops
from gdmp_ros.manifolds.registry import apply_factor, apply_factors

# Rows of `frames` and of `points`: START, the interval's nodes PREVIOUS and NODE, its middle MID.
START, PREVIOUS, MID, NODE, WORK = range(5)
FRAME_ROWS = 5
# Further rows of `points`.
GOAL, GOAL_FROM, GOAL_NEW = 5, 6, 7
POINT_ROWS = 8
# Rows of `vectors`: Z at PREVIOUS and at NODE, logarithms, the goal's direction, F, scratch.
Z_PREVIOUS, Z, TO_GOAL, START_TO_GOAL, DIRECTION, FORCE, OFFSET, RATE, CURVE, SPARE = range(10)
VECTOR_ROWS = 10
# Entries of `numbers`.
(S, INTERVAL, SPEED, SPEED_GOAL, SPEED_RATE, DURATION, STEPS, ALPHA_X, ALPHA_G, SWITCHED, MOVING,
 HELD, CUT_LOCUS, FINISHED, NOT_SETTLED, TIME, PARALLEL, SPEED_SLOPE) = range(18)
NUMBERS = 18
# Rows of `gains`: e^(-alpha_z h) and (1 - e^(-alpha_z h)) beta_z for every coordinate.
DECAY, PULL = range(2)

_MEND_EVERY = 32
#: e^-40 of the way is left: less than rounding.
_ARRIVED = 40.0
#: Forcing ends within this part of a duration after the nominal end.
_FADE = 0.05


@compiled
def _copy(source, out):
    for i in range(source.size):
        out[i] = source[i]


@inlined
def _move_goal(table, numbers, points, vectors, s):
    """Goal at ``s`` after a switch, in closed form, [GDMP] eq. (28)."""
    elapsed = numbers[ALPHA_G] * (s - numbers[SWITCHED])
    fraction = -math.expm1(-elapsed)
    for i in range(vectors.shape[1]):
        vectors[SPARE, i] = fraction * vectors[DIRECTION, i]
    apply_factors(table, ops.EXP, points[GOAL_FROM], vectors[SPARE], points[GOAL])
    if elapsed > _ARRIVED:
        numbers[MOVING] = 0.0


@inlined
def _start_to_goal(table, numbers, frames, points, vectors):
    """Refresh ``Log_{Y0}(G)``, in the start's frame (parallel) or representation (published)."""
    if numbers[PARALLEL] > 0.0:
        gap = apply_factors(table, ops.FRAME_LOG, frames[START], points[GOAL],
                            vectors[START_TO_GOAL])
    else:
        gap = apply_factors(table, ops.LOG, points[START], points[GOAL], vectors[START_TO_GOAL])
    if gap < ops.CUT_LOCUS_LIMIT:
        numbers[CUT_LOCUS] = 1.0


@inlined
def _drift_to_mid(table, numbers, frames, points, vectors, half):
    """Half a drift from NODE to MID; where the goal is, seen from there."""
    offset = vectors[OFFSET]
    for i in range(offset.size):
        offset[i] = half * vectors[Z, i]
    _copy(vectors[TO_GOAL], vectors[SPARE])
    if numbers[PARALLEL] > 0.0:
        _copy(frames[NODE], frames[MID])
        apply_factors(table, ops.MOVE, frames[MID], offset, vectors[SPARE])
        op, seen_from = ops.FRAME_LOG, frames[MID]
    else:
        apply_factors(table, ops.TANGENT, points[NODE], offset, vectors[RATE])
        apply_factors(table, ops.EXP, points[NODE], vectors[RATE], points[MID])
        op, seen_from = ops.LOG, points[MID]
    gap = apply_factors(table, op, seen_from, points[GOAL], vectors[TO_GOAL])
    if gap < ops.CUT_LOCUS_LIMIT:
        # Undefined there: go on along the last direction.
        numbers[CUT_LOCUS] = 1.0
        for factor in range(table.shape[0]):
            part = apply_factor(table, factor, op, seen_from, points[GOAL], vectors[RATE])
            if part < ops.CUT_LOCUS_LIMIT:
                for i in range(table[factor, 4], table[factor, 5]):
                    vectors[TO_GOAL, i] = vectors[SPARE, i]


@inlined
def _drift_to_node(table, numbers, frames, points, vectors, half):
    offset = vectors[OFFSET]
    if numbers[PARALLEL] > 0.0:
        for i in range(offset.size):
            offset[i] = half * vectors[Z, i]
        _copy(frames[MID], frames[NODE])
        apply_factors(table, ops.MOVE, frames[NODE], offset, vectors[SPARE])
        if int(numbers[INTERVAL]) % _MEND_EVERY == _MEND_EVERY - 1:
            apply_factors(table, ops.MEND, frames[NODE], vectors[SPARE], vectors[SPARE])
        return frames[NODE].sum()
    _copy(vectors[Z], vectors[RATE])
    apply_factors(table, ops.TANGENT, points[MID], vectors[RATE], vectors[Z])
    for i in range(offset.size):
        offset[i] = half * vectors[Z, i]
    apply_factors(table, ops.EXP, points[MID], offset, points[NODE])
    if int(numbers[INTERVAL]) % _MEND_EVERY == _MEND_EVERY - 1:
        apply_factors(table, ops.MEND_POINT, points[NODE], vectors[SPARE], vectors[SPARE])
    # A matrix that has left the cone has no frame; its NaN tells.
    apply_factors(table, ops.FRAME, points[NODE], vectors[SPARE], frames[WORK])
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
def _step(table, gains, functions, weights, numbers, frames, points, vectors):
    """
    Compute the next interval; False, with everything as before, where the result is not finite.

    Source: [GDMP] eqs. (17), (18), (22), with the linear part solved exactly.
    """
    h = 1.0 / numbers[STEPS]
    s = (numbers[INTERVAL] + 1.5) * h
    x = math.exp(-numbers[ALPHA_X] * s)
    if numbers[MOVING] > 0.0:
        _move_goal(table, numbers, points, vectors, s)
    if numbers[MOVING] > 0.0 or numbers[INTERVAL] < 0.0:
        _start_to_goal(table, numbers, frames, points, vectors)
    forcing(functions, weights, s, x, vectors[FORCE])
    shaping = _fade(s)
    _copy(frames[NODE], frames[PREVIOUS])
    _copy(points[NODE], points[PREVIOUS])
    _copy(vectors[Z], vectors[Z_PREVIOUS])
    _drift_to_mid(table, numbers, frames, points, vectors, 0.5 * h)
    for i in range(vectors.shape[1]):
        shape = vectors[FORCE, i] - vectors[START_TO_GOAL, i] * x
        pull = vectors[TO_GOAL, i] + shaping * shape
        vectors[Z, i] = gains[DECAY, i] * vectors[Z, i] + gains[PULL, i] * pull
    total = _drift_to_node(table, numbers, frames, points, vectors, 0.5 * h) + vectors[Z].sum()
    if not math.isfinite(total):
        _copy(frames[PREVIOUS], frames[NODE])
        _copy(points[PREVIOUS], points[NODE])
        _copy(vectors[Z_PREVIOUS], vectors[Z])
        return False
    numbers[INTERVAL] += 1.0
    return True


@inlined
def _interpolate(table, numbers, frames, points, vectors, u):
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
        apply_factors(table, ops.FRAME, points[PREVIOUS], vectors[SPARE], frames[WORK])
        _copy(frames[WORK], frames[MID])
        apply_factors(table, ops.FRAME_LOG, frames[MID], points[NODE], offset)
        apply_factors(table, ops.MOVE, frames[MID], offset, vectors[SPARE])
        apply_factors(table, ops.COORDS, frames[WORK], vectors[Z_PREVIOUS], rate)
        apply_factors(table, ops.COORDS, frames[MID], vectors[Z], curve)
        for i in range(offset.size):
            whole, first, last = offset[i], h * rate[i], h * curve[i]
            square, cube = 3.0 * whole - 2.0 * first - last, first + last - 2.0 * whole
            offset[i] = u * (first + u * (square + u * cube))
            rate[i] = (first + u * (2.0 * square + 3.0 * u * cube)) / h
            curve[i] = (2.0 * square + 6.0 * u * cube) / (h * h)
    apply_factors(table, ops.MOVE, frames[WORK], offset, vectors[SPARE])


@inlined
def _evaluate(table, numbers, frames, points, vectors, out):
    """
    Write point, velocity and acceleration of the present moment to ``out``.

    Derivatives are by time [1/s, 1/s²], in the representation at the point.
    """
    p, n = points.shape[1], vectors.shape[1]
    point, velocity, acceleration = out[:p], out[p:p + n], out[p + n:p + 2 * n]
    if numbers[HELD] > 0.0:
        if numbers[PARALLEL] > 0.0:
            apply_factors(table, ops.POINT, frames[NODE], vectors[SPARE], point)
        else:
            _copy(points[NODE], point)
        for i in range(n):
            velocity[i] = 0.0
            acceleration[i] = 0.0
        return
    u = numbers[S] * numbers[STEPS] - numbers[INTERVAL]
    _interpolate(table, numbers, frames, points, vectors, min(max(u, 0.0), 1.0))
    tempo = numbers[SPEED] / numbers[DURATION]
    change = numbers[SPEED_SLOPE] / numbers[DURATION]
    for i in range(n):
        vectors[SPARE, i] = tempo * tempo * vectors[CURVE, i] + change * vectors[RATE, i]
        vectors[RATE, i] *= tempo
    apply_factors(table, ops.POINT, frames[WORK], vectors[SPARE], point)
    apply_factors(table, ops.VECTOR, frames[WORK], vectors[RATE], velocity)
    apply_factors(table, ops.VECTOR, frames[WORK], vectors[SPARE], acceleration)


@inlined
def _pass_time(numbers, dt):
    """Advance ``s`` by ``dt`` of time while the speed moves to its goal at a bounded rate."""
    left = numbers[SPEED_GOAL] - numbers[SPEED]
    rate = math.copysign(numbers[SPEED_RATE], left)
    ramp = min(dt, abs(left) / numbers[SPEED_RATE])
    travelled = ramp * (numbers[SPEED] + 0.5 * rate * ramp)
    if ramp < dt or left == 0.0:
        numbers[SPEED] = numbers[SPEED_GOAL]
        numbers[SPEED_SLOPE] = 0.0
    else:
        numbers[SPEED] += rate * ramp
        numbers[SPEED_SLOPE] = rate
    travelled += (dt - ramp) * numbers[SPEED]
    numbers[S] += travelled / numbers[DURATION]
    numbers[TIME] += dt


@inlined
def _settle(table, tolerances, numbers, frames, points, vectors, point):
    """Decide whether the motion is over (only once s has reached 1)."""
    apply_factors(table, ops.FRAME, point, vectors[SPARE], frames[WORK])
    apply_factors(table, ops.FRAME_LOG, frames[WORK], points[GOAL_NEW], vectors[SPARE])
    arrived = True
    for factor in range(table.shape[0]):
        total = 0.0
        for i in range(table[factor, 4], table[factor, 5]):
            total += vectors[SPARE, i] * vectors[SPARE, i]
        arrived = arrived and total <= tolerances[factor] ** 2
    if arrived:
        numbers[FINISHED], numbers[NOT_SETTLED] = 1.0, 0.0
    elif numbers[S] >= max(2.0, numbers[SWITCHED] + 1.0):
        numbers[FINISHED], numbers[NOT_SETTLED] = 1.0, 1.0


@inlined
def _advance(table, gains, functions, weights, tolerances, numbers, frames, points, vectors, out,
            dt):
    """Let ``dt`` seconds pass: the nodes on the way, then the present moment into ``out``."""
    if numbers[HELD] > 0.0:
        numbers[TIME] += dt
    else:
        _pass_time(numbers, dt)
    # The small number keeps rounding in s from deciding whether a node has been passed.
    while (numbers[HELD] == 0.0 and (numbers[S] * numbers[STEPS] > numbers[INTERVAL] + 1.0 + 1e-9
                                     or numbers[INTERVAL] < 0.0)):
        if not _step(table, gains, functions, weights, numbers, frames, points, vectors):
            numbers[HELD] = 1.0
            numbers[SPEED], numbers[SPEED_SLOPE] = 0.0, 0.0
    _evaluate(table, numbers, frames, points, vectors, out)
    if numbers[S] >= 1.0 and numbers[FINISHED] == 0.0:
        _settle(table, tolerances, numbers, frames, points, vectors, out[:points.shape[1]])


@compiled
def advance(table, gains, functions, weights, tolerances, numbers, frames, points, vectors, out,
            durations):
    """
    Let each of ``durations`` [s] pass in turn and write the moment after it to a row of ``out``.

    The first call computes the first interval too, so a duration of 0 evaluates the start.
    """
    for i in range(durations.size):
        _advance(table, gains, functions, weights, tolerances, numbers, frames, points, vectors,
                out[i], durations[i])
