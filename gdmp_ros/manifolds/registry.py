"""
Which manifolds there are: a new one is its own file, one line in `KINDS` and one in `apply`.

Compiled code tells the manifolds apart by their place in `KINDS`, and walks a product by a table
with one row per factor; files and parameters know them by name.
"""
from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from gdmp_ros.compilation import compiled, inlined
from gdmp_ros.manifolds import euclidean, quaternion, rotation, spd, sphere
from gdmp_ros.manifolds import operations as ops
from gdmp_ros.manifolds.manifold import Manifold

KINDS: tuple[Any, ...] = (
    euclidean.Euclidean,
    sphere.Sphere,
    quaternion.UnitQuaternion,
    rotation.SpecialOrthogonal,
    spd.SymmetricPositiveDefinite,
)


@inlined
def apply(kind, op, m, a, b, out, work):
    """Answer operation ``op`` for manifold number ``kind`` (`gdmp_ros.manifolds.operations`)."""
    if kind == 0:
        return euclidean.apply(op, m, a, b, out, work)
    if kind == 1:
        return sphere.apply(op, m, a, b, out, work)
    if kind == 2:
        return quaternion.apply(op, m, a, b, out, work)
    if kind == 3:
        return rotation.apply(op, m, a, b, out, work)
    return spd.apply(op, m, a, b, out, work)


# Columns of a factor table: where the factor's part lies in a point, a tangent and a frame.
KIND, SIZE, POINT, VECTOR, FRAME = 0, 1, 2, 4, 6
_EMPTY = 8
TABLE_COLUMNS = 10

#: For each operation, the columns that cut ``a``, ``b`` and ``out`` into factors.
_PARTS = np.full((11, 3), _EMPTY)
_PARTS[ops.EXP] = POINT, VECTOR, POINT
_PARTS[ops.LOG] = POINT, POINT, VECTOR
_PARTS[ops.FRAME] = POINT, _EMPTY, FRAME
_PARTS[ops.POINT] = FRAME, _EMPTY, POINT
_PARTS[ops.MOVE] = FRAME, VECTOR, _EMPTY
_PARTS[ops.FRAME_LOG] = FRAME, POINT, VECTOR
_PARTS[ops.VECTOR] = FRAME, VECTOR, VECTOR
_PARTS[ops.COORDS] = FRAME, VECTOR, VECTOR
_PARTS[ops.MEND] = FRAME, _EMPTY, _EMPTY
_PARTS[ops.MEND_POINT] = POINT, _EMPTY, _EMPTY
_PARTS[ops.TANGENT] = POINT, VECTOR, VECTOR


@inlined
def apply_factor(table, factor, op, a, b, out, work):
    """Answer ``op`` for one factor of a product, given the whole product's arrays."""
    i, j, k = _PARTS[op, 0], _PARTS[op, 1], _PARTS[op, 2]
    return apply(table[factor, KIND], op, table[factor, SIZE],
                 a[table[factor, i]:table[factor, i + 1]],
                 b[table[factor, j]:table[factor, j + 1]],
                 out[table[factor, k]:table[factor, k + 1]], work)


@inlined
def apply_factors(table, op, a, b, out, work):
    """Answer ``op`` factor by factor; the least of the factors' answers."""
    least = np.inf
    for factor in range(table.shape[0]):
        least = min(least, apply_factor(table, factor, op, a, b, out, work))
    return least


@compiled
def map_factors(table, op, a, b, out, answers, work):
    """Answer ``op`` for each row of ``a``, ``b`` and ``out``; `apply_factors`' answers by row."""
    for i in range(answers.size):
        answers[i] = apply_factors(table, op, a[i], b[i], out[i], work)


def work_array(table: np.ndarray) -> np.ndarray:
    """Scratch for `apply_factors`."""
    return np.empty(max(ops.work_size(int(m)) for m in table[:, SIZE]))


def factor_table(factors: Sequence[Manifold]) -> np.ndarray:
    """Table of the factors for `apply_factors`, int64 of shape (factors, 10)."""
    table = np.zeros((len(factors), TABLE_COLUMNS), dtype=np.int64)
    table[:, KIND] = [KINDS.index(type(factor)) for factor in factors]
    table[:, SIZE] = [factor.m for factor in factors]
    for column, sizes in ((POINT, [factor.point_size for factor in factors]),
                          (VECTOR, [factor.tangent_size for factor in factors]),
                          (FRAME, [factor.frame_size for factor in factors])):
        ends = np.cumsum(sizes)
        table[:, column] = ends - sizes
        table[:, column + 1] = ends
    return table
