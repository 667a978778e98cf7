"""
Where the numbers of a roll-out lie: one flat array, cut into named parts.

One array makes a call of the compiled step cheap, and memories laid one after another are stepped
in one call (`gdmp_ros.dmp.batch`). A memory begins with its *block*, which are integers (their 64
bits in place of a float's): the sizes, the places of the parts in the memory, the factor table and
which factors are split.
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gdmp_ros.compilation import inlined, matrix_of
from gdmp_ros.manifolds.operations import work_size
from gdmp_ros.manifolds.registry import FRAME, POINT, SIZE, TABLE_COLUMNS, VECTOR

# Entries of a block: sizes, the factor steered around obstacles, places of the parts, the table.
(END_AT, FACTORS, BASIS, POINT_SIZE, VECTOR_SIZE, FRAME_SIZE, WAYPOINTS, STEERED, OUT_SIZE,
 NUMBERS_AT, GAINS_AT, FUNCTIONS_AT, WEIGHTS_AT, TOLERANCES_AT, ENDS_AT, WAYPOINTS_AT,
 OBSTACLES_AT, FRAMES_AT, POINTS_AT, VECTORS_AT, WORK_AT) = range(21)
TABLE_AT = 21

# Rows of `frames`, and the first rows of `points`: the start, an interval's nodes and its middle
# (`parallel` keeps frames at middles, PREVIOUS that of the interval before; `published` points).
START, PREVIOUS, MID, NODE, WORK = range(5)
FRAME_ROWS = 5
# Further rows of `points`: the goal on its way from one to the other, what draws the motion now
# and what drew it first (where these are not the goal: `gdmp_ros.dmp.segments`).
GOAL, GOAL_FROM, GOAL_NEW, TARGET, FIRST = 5, 6, 7, 8, 9
POINT_ROWS = 10
# Rows of `vectors`: Z at PREVIOUS and at NODE, logarithms, the goal's direction, F, the push that
# fits the start to a given acceleration, scratch.
(Z_PREVIOUS, Z, TO_GOAL, START_TO_GOAL, DIRECTION, FORCE, PUSH, OFFSET, RATE, CURVE,
 SPARE) = range(11)
VECTOR_ROWS = 11
# Entries of `numbers`.
(S, INTERVAL, SPEED, RAMP, SPEED_GOAL, SLOWDOWN, SPEED_RATE, SPEED_SLOPE, DURATION, STEPS, ALPHA_X,
 ALPHA_G, GOAL_RATE, SWITCHED, SETTLE_BY, MOVING, HELD, CUT_LOCUS, FINISHED, NOT_SETTLED, TIME,
 PARALLEL, PUSH_END, STIFFNESS, OBSTACLES, OBSTACLE_GAIN, OBSTACLE_RANGE,
 ACCELERATION_BOUND) = range(28)
NUMBERS = 28
# Rows of `gains`: e^(-alpha_z h) and (1 - e^(-alpha_z h)) beta_z for every coordinate.
DECAY, PULL = range(2)
#: Most obstacles at a time.
OBSTACLE_CAPACITY = 32


class Views(NamedTuple):
    """The parts of a roll-out's memory, in the order of `views`."""

    table: np.ndarray
    split: np.ndarray
    numbers: np.ndarray
    gains: np.ndarray
    functions: np.ndarray
    weights: np.ndarray
    tolerances: np.ndarray
    ends: np.ndarray
    waypoints: np.ndarray
    obstacles: np.ndarray
    frames: np.ndarray
    points: np.ndarray
    vectors: np.ndarray
    work: np.ndarray


@inlined
def views(block, memory):
    """Cut ``memory`` as ``block`` says."""
    factors, basis, p, n, f = (block[FACTORS], block[BASIS], block[POINT_SIZE],
                               block[VECTOR_SIZE], block[FRAME_SIZE])
    split_at = TABLE_AT + factors * TABLE_COLUMNS
    return (matrix_of(block, TABLE_AT, factors, TABLE_COLUMNS),
            block[split_at:split_at + factors],
            memory[block[NUMBERS_AT]:block[GAINS_AT]],
            matrix_of(memory, block[GAINS_AT], 2, n),
            matrix_of(memory, block[FUNCTIONS_AT], 2, basis),
            matrix_of(memory, block[WEIGHTS_AT], basis, n),
            memory[block[TOLERANCES_AT]:block[ENDS_AT]],
            memory[block[ENDS_AT]:block[WAYPOINTS_AT]],
            matrix_of(memory, block[WAYPOINTS_AT], block[WAYPOINTS], p),
            memory[block[OBSTACLES_AT]:block[FRAMES_AT]],
            matrix_of(memory, block[FRAMES_AT], FRAME_ROWS, f),
            matrix_of(memory, block[POINTS_AT], POINT_ROWS, p),
            matrix_of(memory, block[VECTORS_AT], VECTOR_ROWS, n),
            memory[block[WORK_AT]:block[END_AT]])


def blank(table: np.ndarray, n_basis: int, waypoints: int, split: np.ndarray,
          steered: int) -> np.ndarray:
    """
    Memory of a roll-out, all zero but for its block.

    :param split: which factors have waypoints, shape ``(factors,)``
    :param steered: the factor obstacles act on, -1 for none
    """
    factors = len(table)
    p, n, f = (int(table[-1, column + 1]) for column in (POINT, VECTOR, FRAME))
    work = max(work_size(int(m)) for m in table[:, SIZE])
    position = int(table[steered, SIZE]) if steered >= 0 else 0
    sizes = [NUMBERS, 2 * n, 2 * n_basis, n_basis * n, factors, waypoints, waypoints * p,
             OBSTACLE_CAPACITY * position, FRAME_ROWS * f, POINT_ROWS * p, VECTOR_ROWS * n, work]
    places = TABLE_AT + table.size + factors + np.concatenate([[0], np.cumsum(sizes)])
    block = np.concatenate([
        [places[-1], factors, n_basis, p, n, f, waypoints, steered, 2 + p + 2 * n], places[:-1],
        table.reshape(-1), split]).astype(np.int64)
    memory = np.zeros(int(places[-1]))
    memory[:len(block)] = block.view(np.float64)
    return memory


def cut(memory: np.ndarray) -> Views:
    """The parts, as views."""
    return Views(*views.py_func(memory.view(np.int64), memory))  # type: ignore[attr-defined]
