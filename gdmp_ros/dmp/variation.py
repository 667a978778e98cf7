"""How takes of a motion vary around their mean: the data of a `gdmp_ros.dmp.Distribution`."""
from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from gdmp_ros.errors import DataError


@dataclass(frozen=True, eq=False)
class Variation:
    """
    A Gaussian over start, goal and weights of a primitive, with its mean at the primitive.

    :ivar factor: F with covariance ``F Fᵀ``, shape ``(2 n + n_basis n, R)``: first the shift of
        the start in the primitive's frame, then that of the goal in the frame carried there, then
        the weights row by row
    :ivar noise: variance of what start, goal and weights do not explain, for each coordinate,
        shape ``(n,)``
    :ivar timing: standard deviation of the logarithm of the duration
    :ivar context_mean: mean of the numbers that describe the situation of a take, shape ``(m,)``
    :ivar context_scale: L with their covariance ``L Lᵀ``, shape ``(m, m)``; the last m columns of
        F belong to ``L⁻¹ (context - mean)``
    """

    factor: np.ndarray
    noise: np.ndarray
    timing: float = 0.0
    context_mean: np.ndarray = field(default_factory=lambda: np.empty(0))
    context_scale: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))

    def __post_init__(self) -> None:
        for name in ('factor', 'noise', 'context_mean', 'context_scale'):
            array = np.array(getattr(self, name), dtype=np.float64)
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    def check(self, n_basis: int, size: int) -> None:
        """
        Check that it fits a primitive.

        :param size: of the tangent space
        :raises DataError: naming the part and the shape
        """
        rows = (2 + n_basis) * size
        if self.factor.ndim != 2 or len(self.factor) != rows:
            raise DataError(f'variation: factor has shape {self.factor.shape}, expected '
                            f'({rows}, any)')
        if self.noise.shape != (size,) or not (self.noise >= 0.0).all():
            raise DataError(f'variation: noise has shape {self.noise.shape}, expected {size} '
                            'numbers >= 0')
        contexts = len(self.context_mean)
        if self.context_scale.shape != (contexts, contexts) or self.factor.shape[1] < contexts:
            raise DataError(f'variation: context_scale has shape {self.context_scale.shape}, '
                            f'expected {(contexts, contexts)}, and at least as many columns of '
                            'factor')
        if contexts and not (np.diag(self.context_scale) > 0.0).all():
            raise DataError('variation: context_scale is singular')
        if not 0.0 <= self.timing <= 10.0:
            raise DataError(f'variation: timing is {self.timing!r}, expected 0 to 10')
