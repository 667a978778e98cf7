"""
Compiled: one motion from roll-outs in several task frames, and where the frames are.

A motion with task frames has one roll-out in each frame, all at the same progress. Each point is
placed where its frame is now, ``ŷ_f = T_f(t) y_f(s)``, and the fused point of a factor is their
mean, weighted with the shares of the frames: ``Σ_f p_f(s) Log_y(ŷ_f) = 0``. The offset of a start
elsewhere fades on top of it. Velocity and acceleration are those of this point as a function of
time, by central differences over a time so short that only rounding limits them.

The memory of such a roll-out (`gdmp_ros.dmp.layout`) goes on with the numbers of `Fusion`, then
with the memories of the roll-outs in the frames.
"""
from __future__ import annotations

import math
from typing import Any, NamedTuple

from gdmp_ros.dmp.layout import motion_view
from gdmp_ros.kernels import (
    always_inline,
    inlined,
    jitable,
    kernel,
    local_numbers,
    noinline,
    numbers_at,
)
from gdmp_ros.manifolds.factors import (
    CUT_LOCUS_LIMIT,
    exp,
    factor_exp,
    factor_log,
    frame_point,
    log,
    log_in_frame,
    transport_frame,
)
from gdmp_ros.manifolds.linalg import copy_numbers, norm
from gdmp_ros.manifolds.quaternion import exp_at_identity

#: What a rigid motion does with a factor: moves a position, turns vectors, an orientation
#: (quaternion or matrix) or a symmetric matrix, or leaves it.
MOVES, TURNS, TURNS_QUATERNION, TURNS_ROTATION, TURNS_MATRIX, STAYS = range(6)
#: A frame, row of `Fusion.frames`: pose, twist, stamp of the pose [s], offset from it (see
#: `pose_at`), when the offset began [s], and the rate at which it fades [1/s].
POSE, TWIST, STAMP, OFFSET, SINCE, RATE = 0, 7, 13, 14, 32, 33
FRAME_ROW = 34
#: Coefficients of how the offset of the start fades.
FADE_TERMS = 6
#: Most iterations of a mean of more than two points on a curved manifold.
_ITERATIONS = 50
#: A mean is found when the next step is as short as this.
_FOUND = 1e-12
#: After so many time constants nothing is left of an offset.
_GONE = 50.0


class Fusion(NamedTuple):
    """
    Numbers of the fusion; K frames, F factors, N knots of the shares. All are flat.

    :ivar settings: knots, dimension of the frames (2 or 3), s at which the offset of the start has
        faded out (0: there is none), half of the time of a difference [s]
    :ivar actions: for each factor, what a rigid motion does with it
    :ivar frames: rows as described at `POSE`
    :ivar shares: coefficients of uniform cubic B-splines, (N, K, F)
    :ivar signs: of each frame's points, so that ±q of all frames are near each other, (K, F)
    :ivar goals: of the roll-outs in the frames, points
    :ivar fade: coefficients of the offset of the start by s, in the frame ``home``
    :ivar home: frame at the fused start
    :ivar states: of the roll-outs in the frames
    :ivar later: their points at another time
    :ivar placed: points where the frames are
    :ivar share: of each frame and factor at the moment, (K, F)
    :ivar points: the fused point before, at and after the moment, the goal, a spare one
    :ivar moved: a frame
    :ivar tangents: two of them
    """

    settings: Any
    actions: Any
    frames: Any
    shares: Any
    signs: Any
    goals: Any
    fade: Any
    home: Any
    states: Any
    later: Any
    placed: Any
    share: Any
    points: Any
    moved: Any
    tangents: Any


_SETTINGS, _POINTS, _TANGENTS = 4, 5, 2


@inlined
def fusion_size(sizes, knots):
    """Numbers of a fusion."""
    k, f, p, n = sizes.views, sizes.factors, sizes.point, sizes.tangent
    return (_SETTINGS + f + k * FRAME_ROW + knots * k * f + k * f + k * p + FADE_TERMS * n
            + sizes.frame + k * (2 + p + 2 * n) + 2 * k * p + k * f + _POINTS * p + sizes.frame
            + _TANGENTS * n)


@jitable
def _part(memory, at, size):
    return numbers_at(memory, at, size), at + size


@inlined
def fusion_view(memory, sizes):
    """Cut the numbers of the fusion out of a memory."""
    k, f, p, n = sizes.views, sizes.factors, sizes.point, sizes.tangent
    settings, at = _part(memory, sizes.own, _SETTINGS)
    actions, at = _part(memory, at, f)
    frames, at = _part(memory, at, k * FRAME_ROW)
    shares, at = _part(memory, at, int(settings[0]) * k * f)
    signs, at = _part(memory, at, k * f)
    goals, at = _part(memory, at, k * p)
    fade, at = _part(memory, at, FADE_TERMS * n)
    home, at = _part(memory, at, sizes.frame)
    states, at = _part(memory, at, k * (2 + p + 2 * n))
    later, at = _part(memory, at, k * p)
    placed, at = _part(memory, at, k * p)
    share, at = _part(memory, at, k * f)
    points, at = _part(memory, at, _POINTS * p)
    moved, at = _part(memory, at, sizes.frame)
    tangents, at = _part(memory, at, _TANGENTS * n)
    return Fusion(settings, actions, frames, shares, signs, goals, fade, home, states, later,
                  placed, share, points, moved, tangents)


@always_inline
def _pose_at(row, time, offset, pose, turn, vector):
    """
    Write where a frame is at a time.

    It moves with its twist from where it was measured. What a measurement has changed is an offset
    from there: (c0 + c1 u + c2 u²) e^(-rate u) at u after the change, for the position in the
    base, for the orientation as a rotation vector in the frame.

    :param row: see `POSE`
    :param offset: 0 for where it is measured, without the offset
    :param turn: scratch memory for a quaternion, ``vector`` for a rotation vector
    """
    passed = time - row[STAMP]
    for i in range(3):
        pose[i] = row[POSE + i] + row[TWIST + i] * passed
        vector[i] = row[TWIST + 3 + i] * passed
    exp_at_identity(vector, 0.5, turn)
    _multiply(turn, row, POSE + 3, pose)
    u = time - row[SINCE]
    if offset == 0 or row[RATE] == 0.0 or row[RATE] * u > _GONE:
        return
    decay = math.exp(-row[RATE] * u)
    for i in range(6):
        left = (row[OFFSET + i] + u * (row[OFFSET + 6 + i] + u * row[OFFSET + 12 + i])) * decay
        if i < 3:
            pose[i] += left
        else:
            vector[i - 3] = left
    exp_at_identity(vector, 0.5, turn)
    w, x, y, z = pose[3], pose[4], pose[5], pose[6]
    pose[3] = w * turn[0] - x * turn[1] - y * turn[2] - z * turn[3]
    pose[4] = w * turn[1] + x * turn[0] + y * turn[3] - z * turn[2]
    pose[5] = w * turn[2] - x * turn[3] + y * turn[0] + z * turn[1]
    pose[6] = w * turn[3] + x * turn[2] - y * turn[1] + z * turn[0]


@always_inline
def _multiply(a, row, at, pose):
    """Write the product of a quaternion and one that begins in a row at ``at`` to a pose."""
    w, x, y, z = row[at], row[at + 1], row[at + 2], row[at + 3]
    pose[3] = a[0] * w - a[1] * x - a[2] * y - a[3] * z
    pose[4] = a[0] * x + a[1] * w + a[2] * z - a[3] * y
    pose[5] = a[0] * y - a[1] * z + a[2] * w + a[3] * x
    pose[6] = a[0] * z + a[1] * y - a[2] * x + a[3] * w


@kernel
def pose_at(row, time, offset, pose):
    """Where a frame is at a time; see `_pose_at`."""
    _pose_at(row, time, offset, pose, local_numbers(4), local_numbers(3))


@always_inline
def _rotation_of(pose, out):
    """Write the matrix of a pose's rotation, row by row."""
    w, x, y, z = pose[3], pose[4], pose[5], pose[6]
    out[0], out[1], out[2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    out[3], out[4], out[5] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    out[6], out[7], out[8] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)


@always_inline
def _turn_matrix(d, rotation, size, first, given, out, half):
    """Write ``B Y Bᵀ`` of a symmetric matrix, with the rotation in each block of B."""
    for i in range(size):
        block = i // d * d
        for j in range(size):
            total = 0.0
            for k in range(d):
                total += rotation[3 * (i - block) + k] * given[first + (block + k) * size + j]
            half[i * size + j] = total
    for i in range(size):
        for j in range(i, size):
            block, total = j // d * d, 0.0
            for k in range(d):
                total += half[i * size + block + k] * rotation[3 * (j - block) + k]
            out[first + i * size + j] = out[first + j * size + i] = total


@always_inline
def _place(factors, actions, d, pose, point, out, rotation, work):
    """Write a point that is given in a frame as it is in the base."""
    _rotation_of(pose, rotation)
    for i in range(factors.size):
        factor = factors[i]
        action, first, end = int(actions[i]), factor.point, factor.point_end
        if action in (MOVES, TURNS):
            for block in range(first, end, d):
                for row in range(d):
                    total = pose[row] if action == MOVES else 0.0
                    for k in range(d):
                        total += rotation[3 * row + k] * point[block + k]
                    out[block + row] = total
        elif action == TURNS_QUATERNION:
            w, x, y, z = point[first], point[first + 1], point[first + 2], point[first + 3]
            out[first] = pose[3] * w - pose[4] * x - pose[5] * y - pose[6] * z
            out[first + 1] = pose[3] * x + pose[4] * w + pose[5] * z - pose[6] * y
            out[first + 2] = pose[3] * y - pose[4] * z + pose[5] * w + pose[6] * x
            out[first + 3] = pose[3] * z + pose[4] * y - pose[5] * x + pose[6] * w
        elif action == TURNS_ROTATION:
            for row in range(d):
                for column in range(d):
                    total = 0.0
                    for k in range(d):
                        total += rotation[3 * row + k] * point[first + d * k + column]
                    out[first + d * row + column] = total
        elif action == TURNS_MATRIX:
            _turn_matrix(d, rotation, factor.size, first, point, out, work)
        else:
            for k in range(first, end):
                out[k] = point[k]


@kernel
def place_rows(factors, actions, d, poses, points, out, work):
    """
    Place points that are given in frames, one frame for each.

    :param poses: shape ``(count, 7)``
    :param points: flat, shape ``(count, point_size)``
    """
    rotation = local_numbers(9)
    for i in range(len(points)):
        _place(factors, actions, d, poses[i], points[i], out[i], rotation, work)


@always_inline
def _update_shares(fusion, sizes, s):
    """Evaluate the shares of all frames; they are constant beyond both ends."""
    knots, width = int(fusion.settings[0]), sizes.views * sizes.factors
    x = min(max(s, 0.0), 1.0) * (knots - 1)
    i = min(int(x), knots - 2)
    u = x - i
    v = 1.0 - u
    before, first = v * v * v / 6.0, (3.0 * u * u * u - 6.0 * u * u + 4.0) / 6.0
    after = u * u * u / 6.0
    second = 1.0 - before - first - after
    for j in range(width):
        fusion.share[j] = (before * fusion.shares[max(i - 1, 0) * width + j]
                           + first * fusion.shares[i * width + j]
                           + second * fusion.shares[(i + 1) * width + j]
                           + after * fusion.shares[min(i + 2, knots - 1) * width + j])


@always_inline
def _mean_of_factor(motion, fusion, f, point):
    """Write the mean of one factor's placed points."""
    sizes, factor = motion.sizes, motion.factors[f]
    p, share, placed = sizes.point, fusion.share, fusion.placed
    heaviest, several = 0, 0
    for k in range(sizes.views):
        if share[k * sizes.factors + f] > share[heaviest * sizes.factors + f]:
            heaviest = k
        if share[k * sizes.factors + f] > 0.0:
            several += 1
    for j in range(factor.point, factor.point_end):
        point[j] = placed[heaviest * p + j]
    if several == 1:
        return
    way = numbers_at(fusion.tangents, 0, sizes.tangent)
    step = numbers_at(fusion.tangents, sizes.tangent, sizes.tangent)
    spare = numbers_at(fusion.points, 4 * p, p)
    for _ in range(_ITERATIONS):
        for j in range(factor.tangent, factor.tangent_end):
            step[j] = 0.0
        for k in range(sizes.views):
            part = share[k * sizes.factors + f]
            if part > 0.0:
                left = factor_log(factor, point, numbers_at(placed, k * p, p), way, motion.work)
                if left < CUT_LOCUS_LIMIT:
                    motion.scalars.cut_locus = 1
                for j in range(factor.tangent, factor.tangent_end):
                    step[j] += part * way[j]
        length = 0.0
        for j in range(factor.tangent, factor.tangent_end):
            length += step[j] * step[j]
        for j in range(factor.point, factor.point_end):
            spare[j] = point[j]
        factor_exp(factor, spare, step, point, motion.work)
        # The mean of two points is on the geodesic between them: one step finds it.
        if several == 2 or length < _FOUND * _FOUND:
            break


@always_inline
def _add_start_offset(motion, fusion, s, point):
    """Move a fused point by what is left of the offset of the start."""
    end, n = fusion.settings[2], motion.sizes.tangent
    if s >= end:
        return
    u = s / end
    way = numbers_at(fusion.tangents, 0, n)
    copy_numbers(motion.sizes.frame, fusion.home, fusion.moved)
    log_in_frame(motion.factors, fusion.moved, point, way, motion.work)
    transport_frame(motion.factors, fusion.moved, way, motion.work)
    for i in range(n):
        left = 0.0
        for k in range(FADE_TERMS - 1, -1, -1):
            left = left * u + fusion.fade[k * n + i]
        way[i] = left
    transport_frame(motion.factors, fusion.moved, way, motion.work)
    frame_point(motion.factors, fusion.moved, point, motion.work)


@always_inline
def _place_all(motion, fusion, time, offset, points):
    """Place one point of each frame."""
    noinline()
    pose, turn, vector, rotation = (local_numbers(7), local_numbers(4), local_numbers(3),
                                    local_numbers(9))
    sizes = motion.sizes
    for k in range(sizes.views):
        placed = numbers_at(fusion.placed, k * sizes.point, sizes.point)
        _pose_at(numbers_at(fusion.frames, k * FRAME_ROW, FRAME_ROW), time, offset, pose, turn,
                 vector)
        _place(motion.factors, fusion.actions, int(fusion.settings[1]), pose,
               numbers_at(points, k * sizes.point, sizes.point), placed, rotation, motion.work)
        for f in range(sizes.factors):
            if fusion.signs[k * sizes.factors + f] < 0.0:
                for j in range(motion.factors[f].point, motion.factors[f].point_end):
                    placed[j] = -placed[j]


@always_inline
def _fuse_at(motion, fusion, later, point):
    """Write the fused point ``later`` [s] than the states of the frames."""
    noinline()
    scalars, p, n = motion.scalars, motion.sizes.point, motion.sizes.tangent
    half, width = 0.5 * later * later, 2 + p + 2 * n
    way = numbers_at(fusion.tangents, 0, n)
    for k in range(motion.sizes.views):
        state = numbers_at(fusion.states, k * width, width)
        target = numbers_at(fusion.later, k * p, p)
        if later == 0.0:
            copy_numbers(p, numbers_at(state, 2, p), target)
        else:
            for i in range(n):
                way[i] = later * state[2 + p + i] + half * state[2 + p + n + i]
            exp(motion.factors, numbers_at(state, 2, p), way, target, motion.work)
    _place_all(motion, fusion, scalars.time + later, 1, fusion.later)
    s = scalars.progress + (later * scalars.speed + half * scalars.speed_slope) / scalars.duration
    _update_shares(fusion, motion.sizes, s)
    for f in range(motion.sizes.factors):
        _mean_of_factor(motion, fusion, f, point)
    if fusion.settings[2] > 0.0:
        _add_start_offset(motion, fusion, s, point)


@always_inline
def fuse(motion, fusion, state):
    """Write the state of the fused motion; those of the frames are known."""
    p, n, short = motion.sizes.point, motion.sizes.tangent, fusion.settings[3]
    before = numbers_at(fusion.points, 0, p)
    point, after = numbers_at(state, 2, p), numbers_at(fusion.points, 2 * p, p)
    _fuse_at(motion, fusion, -short, before)
    _fuse_at(motion, fusion, short, after)
    _fuse_at(motion, fusion, 0.0, point)
    velocity, acceleration = numbers_at(state, 2 + p, n), numbers_at(state, 2 + p + n, n)
    log(motion.factors, point, after, velocity, motion.work)
    log(motion.factors, point, before, acceleration, motion.work)
    for i in range(n):
        forward, back = velocity[i], acceleration[i]
        velocity[i] = 0.5 * (forward - back) / short
        acceleration[i] = (forward + back) / (short * short)


@always_inline
def _write_goal(motion, fusion, point):
    """Write the fused goal: where the motion comes to rest if the frames go on as measured."""
    noinline()
    _update_shares(fusion, motion.sizes, 1.0)
    _place_all(motion, fusion, motion.scalars.time, 0, fusion.goals)
    for f in range(motion.sizes.factors):
        _mean_of_factor(motion, fusion, f, point)


@always_inline
def update_fused_arrival(motion, fusion, settled, point):
    """
    Decide whether a fused motion has finished.

    :param settled: whether the roll-outs in the frames have finished
    :param point: the present one
    """
    scalars, p, n = motion.scalars, motion.sizes.point, motion.sizes.tangent
    if scalars.finished == 1 or scalars.progress < 1.0:
        return
    goal = numbers_at(fusion.points, 3 * p, p)
    way = numbers_at(fusion.tangents, 0, n)
    _write_goal(motion, fusion, goal)
    log(motion.factors, point, goal, way, motion.work)
    arrived = settled
    for f in range(motion.sizes.factors):
        factor = motion.factors[f]
        first = factor.tangent
        arrived = arrived and norm(factor.tangent_end - first, numbers_at(
            way, first, factor.tangent_end - first)) <= motion.tolerances[f]
    if arrived:
        scalars.finished, scalars.not_settled = 1, 0
    elif scalars.progress >= scalars.settle_by:
        scalars.finished, scalars.not_settled = 1, 1


@kernel
def write_goal(memory, point):
    """Write the fused goal of the roll-out in a memory."""
    rest = numbers_at(memory, 0, memory.size)
    motion = motion_view(rest)
    _write_goal(motion, fusion_view(rest, motion.sizes), point)
