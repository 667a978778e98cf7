"""The smoothest weights for given deviations of a motion."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gdmp_ros.dmp.primitive import Gains
from gdmp_ros.dmp.response import LAST, responses, third_derivatives


class Smoother(NamedTuple):
    """
    Linear maps between weights and the motion that they add.

    :ivar motion: from weights to deviations, shape ``(samples, n_basis)``
    :ivar weights: from deviations to weights, shape ``(n_basis, samples)``
    """

    motion: np.ndarray
    weights: np.ndarray


def smoother(count: int, gains: Gains, progress: np.ndarray, wavelength: float) -> Smoother:
    """
    Compute the maps; after the end there is no deviation.

    :param count: of the basis functions
    :param progress: of the samples, equally spaced from 0 to 1
    :param wavelength: shortest of a deviation, in durations
    """
    response = responses(count, gains)
    spacing = progress[1]
    held = np.arange(1.0 + spacing, LAST, spacing)
    matrix = response.at(np.concatenate([progress, held]))[1][:, 1:]
    rough = third_derivatives(response.motion[:, 1:])
    normal = spacing * matrix.T @ matrix + (wavelength / (2.0 * np.pi)) ** 6 * rough.T @ rough
    normal[np.diag_indices(count)] += 1e-12 * np.trace(normal) / count
    motion = matrix[:len(progress)]
    return Smoother(motion, np.linalg.solve(normal, spacing * motion.T))
