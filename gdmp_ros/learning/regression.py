"""Linear regression of the forcing term's weights, [GDMP] eq. (21)."""
from __future__ import annotations

import numpy as np
from scipy.linalg import cho_factor, cho_solve, LinAlgError, lstsq

from gdmp_ros.dmp.forcing import design_matrix


def scaled_design_matrix(functions: np.ndarray, alpha_x: float,
                         s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """
    Design matrix with columns of unit length, and their original lengths.

    Without scaling, the pivots of the normal equations would span two decades, as the phase does.
    """
    matrix = np.empty((s.size, functions.shape[1]))
    design_matrix(functions, alpha_x, s, matrix)
    lengths = np.sqrt(np.einsum('ij,ij->j', matrix, matrix))
    lengths[lengths == 0.0] = 1.0
    matrix /= lengths
    return matrix, lengths


def regress(functions: np.ndarray, alpha_x: float, s: np.ndarray, target: np.ndarray,
            ridge: float = 0.0) -> np.ndarray:
    """
    Least-squares weights of all outputs at once, shape ``(functions, outputs)``.

    If every basis function covers samples, the normal equations are well conditioned (about 400
    for 60 functions); otherwise an orthogonal factorisation gives the shortest weights.

    :param s: sample times in durations, shape ``(samples,)``
    :param target: forcing to reproduce, shape ``(samples, outputs)``
    :param ridge: added to the diagonal of the normal equations, whose entries are 1
    """
    matrix, lengths = scaled_design_matrix(functions, alpha_x, s)
    normal = matrix.T @ matrix
    normal[np.diag_indices_from(normal)] += ridge
    try:
        factor = cho_factor(normal, check_finite=False)
        pivots = np.diag(factor[0])
        if pivots.min() > 1e-5 * pivots.max():
            solved = cho_solve(factor, matrix.T @ target, check_finite=False)
            return np.ascontiguousarray(solved / lengths[:, None])
    except LinAlgError:
        pass
    solved = lstsq(matrix, target, check_finite=False)[0]
    return np.ascontiguousarray(solved / lengths[:, None])
