"""How takes of a motion vary around their mean: the data of a `gdmp_ros.dmp.Distribution`."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from gdmp_ros.dmp.contexts import ContextModel
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
    :ivar contexts: how the motion depends on its context, if the takes were shown with contexts;
        the factor is what the contexts do not explain then
    """

    factor: np.ndarray
    noise: np.ndarray
    timing: float = 0.0
    contexts: ContextModel | None = None

    def __post_init__(self) -> None:
        for name in ('factor', 'noise'):
            array = np.array(getattr(self, name), dtype=np.float64, order='C')
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    @property
    def whole_factor(self) -> np.ndarray:
        """F of all that varies, with what the contexts explain."""
        if self.contexts is None:
            return self.factor
        return np.hstack([self.factor, self.contexts.spread])

    def mapped(self, change: Callable[[np.ndarray], np.ndarray]) -> Variation:
        """
        The variation in other coordinates of start, goal and weights.

        :param change: of arrays with the rows of the factor; linear
        """
        model = self.contexts
        if model is not None:
            model = replace(model, trend=change(model.trend), bend=change(model.bend),
                            spread=change(model.spread))
        return replace(self, factor=change(self.factor), contexts=model)

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
        if self.contexts is not None:
            self.contexts.check(rows)
        if not 0.0 <= self.timing <= 10.0:
            raise DataError(f'variation: timing is {self.timing!r}, expected 0 to 10')
