"""
Layout of a roll-out's memory: one flat array, cut into named parts.

One array makes a call of the compiled step cheap, and the memories of many roll-outs, one after
another, are stepped in one call (`gdmp_ros.dmp.Batch`). The memory begins with a record of sizes;
the parts follow in the order in which `motion_view` cuts them.
"""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from gdmp_ros.kernels import inlined, jitable, matrix_at, numbers_at, records_at
from gdmp_ros.manifolds.factors import FACTOR, work_size

#: Most obstacles at a time, and numbers of each (`gdmp_ros.dmp.obstacles`).
OBSTACLE_CAPACITY, OBSTACLE_SIZE = 64, 13

#: Sizes of the parts. ``obstacle_factor``: the factor that avoids obstacles, -1 for none;
#: ``position``: the size of that factor, or 0. ``views``: task frames that the motion is seen from
#: (`gdmp_ros.dmp.fusion`); ``own``: where the numbers of their fusion begin.
SIZES = np.dtype([(name, np.int64) for name in (
    'total', 'factors', 'basis', 'point', 'tangent', 'frame', 'waypoints', 'obstacle_factor',
    'position', 'relations', 'work', 'views', 'own')])

#: A relation between two factors (`gdmp_ros.dmp.relations`): its kind, numbers of the factors, and
#: of the orientation that carries an offset, -1 for none; whether the first factor leads.
RELATION = np.dtype([(name, np.float64) for name in (
    'kind', 'first', 'second', 'carrier', 'leads', 'distance', 'stiffness', 'damping')])

#: The scalars of a roll-out; flags are 0 or 1.
SCALARS = np.dtype([(name, np.float64) for name in (
    'time',                # elapsed [s]
    'progress',            # s = ∫ dt/τ
    'interval',            # index of the grid interval that was computed last, -1 before the first
    'steps',               # grid intervals per unit of s
    'duration',            # τ at speed 1 [s]
    'alpha_x', 'alpha_g',
    'stiffness',           # α_z β_z
    'speed',               # present speed of the phase, 1 as demonstrated
    'speed_slope',         # its rate of change [1/s]
    'speed_ramp',          # what the speed follows with a first-order lag
    'speed_goal',          # what was asked for
    'speed_rate',          # largest rate of change [1/s]
    'slowdown',            # factor of the speed from phase stopping
    'time_per_progress',   # dt/ds of the last step [s]
    'goal_rate',           # largest rate of a goal's fraction by s
    'switched_at',         # s at which the goal was switched
    'offset_left',         # fraction of the goal's offset from its target that is left
    'target_since',        # where a moving target was at its anchor: time [s], or s (see below)
    'arrived_at',          # s since which the motion has been at rest at its goal, -1 if it is not
    'settle_by',           # s at which the motion ends, whether the goal is reached or not
    'correction_end',      # s at which the correction of the start has faded out
    'amplitude',           # of a rhythmic motion: present factor of its forcing term
    'amplitude_goal',      # what was asked for
    'obstacles',           # how many there are
    'obstacle_gain', 'obstacle_reach', 'obstacle_limit',
    'parallel',            # flag: connection, 1 parallel, 0 published
    'rhythmic',            # flag: the motion repeats a cycle around its goal
    'goal_is_moving',      # flag: it has not reached its target, or the target moves
    'target_is_moving',    # flag: the target has a velocity, or had one until now
    'target_by_progress',  # flag: the target moves with s to its anchor, not with time
    'waypoint_is_carried', # flag: the last waypoint is where the goal carries it
    'held',                # flag: a step was not finite, the last state is kept
    'cut_locus', 'finished', 'not_settled')])  # flags of `gdmp_ros.dmp.Rollout`
_SIZES, _SCALARS, _FACTOR, _RELATION = (
    dtype.itemsize // 8 for dtype in (SIZES, SCALARS, FACTOR, RELATION))


def scalar_index(name: str) -> int:
    """Index of a scalar of the first roll-out in a memory."""
    return _SIZES + (SCALARS.names or ()).index(name)


#: Indices of the flag ``finished``, of the progress and of the speed in a memory.
FINISHED, PROGRESS, SPEED = map(scalar_index, ('finished', 'progress', 'speed'))


class Frames(NamedTuple):
    """
    Frames: at the start, in the middle of the last two intervals, at the present point, at goals.

    ``anchor`` is at ``Points.anchor``, ``goal`` at the present goal.
    """

    start: Any
    before: Any
    mid: Any
    now: Any
    anchor: Any
    goal: Any
    spare: Any


class Points(NamedTuple):
    """
    Points: start, the last two nodes and the middle between them, goals.

    ``anchor`` is the goal that was asked for last; ``goal`` moves there, and on with it if it has
    a velocity. ``target`` is what attracts the motion now, ``first_target`` what attracted it
    first; both are the goal unless the skill is split (`gdmp_ros.dmp.segments`). ``element`` is
    the relation that two factors keep at the moment.
    """

    start: Any
    before: Any
    mid: Any
    node: Any
    goal: Any
    anchor: Any
    target: Any
    first_target: Any
    element: Any


class Tangents(NamedTuple):
    """
    Vectors: coordinates in the frame (``parallel``) or tangents (``published``).

    ``velocity`` is Z at the node, ``velocity_before`` that at the node before; ``lead`` is the
    velocity of the target by s, at the point. In the frame of the goal: ``goal_offset`` from the
    target to the goal at the last switch, ``target_velocity`` [1/s], ``goal_velocity``, which
    follows it continuously, and ``to_waypoint``, where the last waypoint is.
    """

    velocity: Any
    velocity_before: Any
    to_goal: Any
    start_to_goal: Any
    goal_offset: Any
    target_velocity: Any
    goal_velocity: Any
    to_waypoint: Any
    lead: Any
    forcing: Any
    start_correction: Any
    offset: Any
    rate: Any
    curvature: Any
    spare: Any


class Motion(NamedTuple):
    """
    The parts of a roll-out's memory.

    :ivar factors: table of the manifold's factors
    :ivar split: for each factor, whether it is split into segments
    :ivar decay: ``e^(-α_z h)`` for each coordinate
    :ivar pull: ``(1 - e^(-α_z h)) β_z`` for each coordinate
    :ivar basis: centres and widths of the basis functions, shape ``(2, n_basis)``
    :ivar tolerances: distance at which each factor counts as arrived
    :ivar still_speeds: below this speed a factor does not move [1/s]
    :ivar peaks: largest norm of Z of each factor up to the nominal end
    :ivar segment_ends: s at which each segment but the last ends
    :ivar related: for each relation, its element of a group, where the second factor has its point
    :ivar deviations: for each relation, the way from its element to that at the start, a tangent
        where the second factor has it; the difference of the distances, where it is one
    """

    sizes: Any
    scalars: Any
    factors: Any
    split: Any
    decay: Any
    pull: Any
    basis: Any
    weights: Any
    tolerances: Any
    still_speeds: Any
    peaks: Any
    segment_ends: Any
    waypoints: Any
    obstacles: Any
    relations: Any
    related: Any
    deviations: Any
    frames: Frames
    points: Points
    tangents: Tangents
    work: Any


_FRAMES, _POINTS, _TANGENTS = (len(part._fields) for part in (Frames, Points, Tangents))


@jitable
def _row(memory, at, size, index):
    return numbers_at(memory, at + index * size, size)


@inlined
def motion_view(memory):
    """Cut a memory into its parts."""
    sizes = records_at(memory, 0, 1, SIZES)[0]
    n, p, f = sizes.tangent, sizes.point, sizes.frame
    scalars = records_at(memory, _SIZES, 1, SCALARS)[0]
    at = _SIZES + _SCALARS
    factors = records_at(memory, at, sizes.factors, FACTOR)
    at += sizes.factors * _FACTOR
    split = numbers_at(memory, at, sizes.factors)
    at += sizes.factors
    decay = numbers_at(memory, at, n)
    pull = numbers_at(memory, at + n, n)
    at += 2 * n
    basis = matrix_at(memory, at, 2, sizes.basis)
    at += 2 * sizes.basis
    weights = matrix_at(memory, at, sizes.basis, n)
    at += sizes.basis * n
    tolerances = numbers_at(memory, at, sizes.factors)
    still_speeds = numbers_at(memory, at + sizes.factors, sizes.factors)
    peaks = numbers_at(memory, at + 2 * sizes.factors, sizes.factors)
    at += 3 * sizes.factors
    segment_ends = numbers_at(memory, at, sizes.waypoints)
    at += sizes.waypoints
    waypoints = matrix_at(memory, at, sizes.waypoints, p)
    at += sizes.waypoints * p
    room = OBSTACLE_CAPACITY * OBSTACLE_SIZE if sizes.position > 0 else 0
    obstacles = numbers_at(memory, at, room)
    at += room
    relations = records_at(memory, at, sizes.relations, RELATION)
    at += sizes.relations * _RELATION
    related = matrix_at(memory, at, sizes.relations, p)
    at += sizes.relations * p
    deviations = matrix_at(memory, at, sizes.relations, n)
    at += sizes.relations * n
    frames = Frames(_row(memory, at, f, 0), _row(memory, at, f, 1), _row(memory, at, f, 2),
                    _row(memory, at, f, 3), _row(memory, at, f, 4), _row(memory, at, f, 5),
                    _row(memory, at, f, 6))
    at += _FRAMES * f
    points = Points(_row(memory, at, p, 0), _row(memory, at, p, 1), _row(memory, at, p, 2),
                    _row(memory, at, p, 3), _row(memory, at, p, 4), _row(memory, at, p, 5),
                    _row(memory, at, p, 6), _row(memory, at, p, 7), _row(memory, at, p, 8))
    at += _POINTS * p
    tangents = Tangents(_row(memory, at, n, 0), _row(memory, at, n, 1), _row(memory, at, n, 2),
                        _row(memory, at, n, 3), _row(memory, at, n, 4), _row(memory, at, n, 5),
                        _row(memory, at, n, 6), _row(memory, at, n, 7), _row(memory, at, n, 8),
                        _row(memory, at, n, 9), _row(memory, at, n, 10), _row(memory, at, n, 11),
                        _row(memory, at, n, 12), _row(memory, at, n, 13), _row(memory, at, n, 14))
    at += _TANGENTS * n
    return Motion(sizes, scalars, factors, split, decay, pull, basis, weights, tolerances,
                  still_speeds, peaks, segment_ends, waypoints, obstacles, relations, related,
                  deviations, frames, points, tangents, numbers_at(memory, at, sizes.work))


@inlined
def total_size(memory):
    """Numbers of the first memory in ``memory``."""
    return records_at(memory, 0, 1, SIZES)[0].total


@inlined
def state_size(memory):
    """Numbers of one state of the first roll-out in ``memory``: time, phase, point, tangents."""
    sizes = records_at(memory, 0, 1, SIZES)[0]
    return 2 + sizes.point + 2 * sizes.tangent


def blank(factors: np.ndarray, n_basis: int, waypoints: int, obstacle_factor: int,
          relations: int = 0) -> np.ndarray:
    """
    Memory of a roll-out: sizes and factors are set, everything else is zero.

    :param factors: table of the manifold's factors
    :param waypoints: how many segments there are but the last
    :param obstacle_factor: the factor that avoids obstacles, -1 for none
    :param relations: how many there are between factors
    """
    last = factors[-1]
    n, p, f = int(last['tangent_end']), int(last['point_end']), int(last['frame_end'])
    position = int(factors[obstacle_factor]['size']) if obstacle_factor >= 0 else 0
    work = work_size(int(factors['size'].max()))
    total = (_SIZES + _SCALARS + len(factors) * (_FACTOR + 4) + 2 * n + 2 * n_basis + n_basis * n
             + waypoints * (1 + p) + OBSTACLE_CAPACITY * OBSTACLE_SIZE * (position > 0)
             + relations * (_RELATION + p + n)
             + _FRAMES * f + _POINTS * p + _TANGENTS * n + work)
    memory = np.zeros(total)
    memory[:_SIZES].view(SIZES)[0] = (total, len(factors), n_basis, p, n, f, waypoints,
                                      obstacle_factor, position, relations, work, 0, total)
    at = _SIZES + _SCALARS
    memory[at:at + len(factors) * _FACTOR].view(FACTOR)[:] = factors
    return memory


def parts(memory: np.ndarray) -> Motion:
    """Cut a memory into its parts, in Python."""
    view: Any = motion_view
    motion: Motion = view.py_func(memory)
    return motion
