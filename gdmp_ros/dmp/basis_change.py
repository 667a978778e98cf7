"""The same motion with more basis functions."""
from __future__ import annotations

from dataclasses import replace
import functools

import numpy as np

from gdmp_ros.dmp.forcing import basis, design_matrix
from gdmp_ros.dmp.primitive import Primitive
from gdmp_ros.dmp.variation import Variation

#: Samples of the forcing term for each basis function.
_SAMPLES = 20


def with_functions(primitive: Primitive, count: int) -> Primitive:
    """
    Return the primitive with ``count`` basis functions, or itself if it has as many.

    The forcing term stays the same up to what the functions can describe. So does its variation.
    """
    if primitive.n_basis >= count:
        return primitive
    primitive.check_ends('basis functions')
    matrix = _change(primitive.n_basis, count, primitive.gains.alpha_x)
    variation = primitive.variation
    return replace(primitive, weights=matrix @ primitive.weights,
                   variation=None if variation is None else _changed(
                       variation, matrix, primitive.manifold.tangent_size))


def _changed(variation: Variation, matrix: np.ndarray, size: int) -> Variation:
    """The variation with its rows for other weights."""
    def changed(rows: np.ndarray) -> np.ndarray:
        ends, weights = rows[:2 * size], rows[2 * size:].reshape(matrix.shape[1], -1)
        return np.vstack([ends, (matrix @ weights).reshape(-1, rows.shape[1])])

    return variation.mapped(changed)


@functools.lru_cache(maxsize=8)
def _change(before: int, after: int, alpha_x: float) -> np.ndarray:
    """Matrix from weights to weights of more functions."""
    progress = np.linspace(0.0, 1.0, _SAMPLES * after)
    few, many = (np.empty((len(progress), count)) for count in (before, after))
    for count, matrix in ((before, few), (after, many)):
        design_matrix(basis(count, alpha_x), alpha_x, progress, matrix)
    # Every moment counts alike, although the forcing term decays with the phase.
    scale = np.exp(alpha_x * progress)[:, None]
    return np.asarray(np.linalg.lstsq(scale * many, scale * few, rcond=1e-10)[0])
