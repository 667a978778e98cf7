"""How takes of a motion vary around their mean, and with the contexts of the takes."""
from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import NamedTuple, TypeAlias

import numpy as np

from gdmp_ros.errors import DataError, ParameterError
from gdmp_ros.util.numeric import numbers_or_none

#: A context as users give it: a number for each name, or numbers in the order of the names.
Context: TypeAlias = Mapping[str, float] | Sequence[float] | np.ndarray
#: Largest condition of the correlations between the numbers of a context.
LARGEST_CONDITION = 1e8
#: A number varies if its range is this part of its size: six digits of it are left.
DIGITS = 1e6 * np.finfo(float).eps
#: Part of the range that a context may be outside of what was shown: rounding.
_ROUNDING = 1e-9


class Kriging(NamedTuple):
    """
    The linear algebra of universal kriging.

    :ivar trend: maps what the takes show to the coefficients of the trend, ``(1 + m, takes)``
    :ivar bend: maps it to those of the process, ``(takes, takes)``
    :ivar inverse: of the covariance of the takes
    :ivar trend_covariance: of the coefficients of the trend, ``(1 + m, 1 + m)``
    """

    trend: np.ndarray
    bend: np.ndarray
    inverse: np.ndarray
    trend_covariance: np.ndarray


def kriging(near: np.ndarray, linear: np.ndarray) -> Kriging:
    """
    Compute the maps for takes with a covariance and a linear trend.

    :param near: covariance of the takes, ``(takes, takes)``
    :param linear: 1 and the numbers of each take, ``(takes, 1 + m)``
    """
    inverse = np.linalg.inv(near)
    trend_covariance = np.linalg.inv(linear.T @ inverse @ linear)
    trend = trend_covariance @ linear.T @ inverse
    return Kriging(trend, inverse - inverse @ linear @ trend, inverse, trend_covariance)


def correlations(first: np.ndarray, second: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """Correlation of contexts by their distance, shape ``(len(first), len(second))``."""
    offset = (first[:, None, :] - second[None, :, :]) / lengths
    return np.asarray(np.exp(-0.5 * (offset ** 2).sum(axis=2)))


def scaled(numbers: np.ndarray, takes: np.ndarray) -> np.ndarray:
    """Contexts minus the mean of the takes', in their standard deviations, same shape."""
    return np.asarray((numbers - takes.mean(axis=0)) / takes.std(axis=0))


def linear_terms(numbers: np.ndarray, takes: np.ndarray) -> np.ndarray:
    """1 and the scaled numbers of contexts, shape ``(..., 1 + m)``."""
    terms = scaled(numbers, takes)
    return np.concatenate([np.ones((*terms.shape[:-1], 1)), terms], axis=-1)


def varies(numbers: np.ndarray) -> bool:
    """Whether each number differs between the takes, and none follows from the others."""
    spread = np.ptp(numbers, axis=0)
    if not (spread > DIGITS * np.abs(numbers).max(axis=0)).all():
        return False
    return bool(np.linalg.cond(scaled(numbers, numbers)) ** 2 <= LARGEST_CONDITION)


@dataclass(frozen=True, eq=False)
class ContextModel:
    """
    Shift of start, goal and weights of a primitive for a context.

    :ivar names: of the numbers of a context, m of them
    :ivar takes: contexts of the takes, shape ``(takes, m)``
    :ivar lengths: correlation length of each number, shape ``(m,)``
    :ivar noise: variance of what the context does not explain in each take, relative to that of
        the process, shape ``(takes,)``
    :ivar trend: coefficients of `linear_terms`, shape ``(rows, 1 + m)``; the rows are those of
        `gdmp_ros.dmp.variation.Variation.factor`
    :ivar bend: coefficients of the process, shape ``(rows, takes)``
    :ivar spread: E with the covariance ``E Eᵀ`` of what the context explains, ``(rows, any)``
    :ivar timing: coefficients of `linear_terms` for the logarithm of the duration divided by
        that of the primitive, shape ``(1 + m,)``
    """

    names: tuple[str, ...]
    takes: np.ndarray
    lengths: np.ndarray
    noise: np.ndarray
    trend: np.ndarray
    bend: np.ndarray
    spread: np.ndarray
    timing: np.ndarray

    def __post_init__(self) -> None:
        for part in fields(self):
            if part.name == 'names':
                continue
            array = np.array(getattr(self, part.name), dtype=np.float64)
            array.flags.writeable = False
            object.__setattr__(self, part.name, array)

    def check(self, rows: int) -> None:
        """
        Check that the parts fit each other, and a primitive.

        :param rows: of `gdmp_ros.dmp.variation.Variation.factor`
        :raises DataError: naming the part and the shape
        """
        size, count = len(self.names), len(self.takes)
        expected = {'takes': (count, size), 'lengths': (size,), 'noise': (count,),
                    'trend': (rows, 1 + size), 'bend': (rows, count),
                    'spread': (rows, self.spread.shape[-1]), 'timing': (1 + size,)}
        for name, shape in expected.items():
            if getattr(self, name).shape != shape:
                raise DataError(f'contexts: {name} has shape {getattr(self, name).shape}, '
                                f'expected {shape}')
        if size < 1 or count < size + 1 or len(set(self.names)) < size:
            raise DataError(f'contexts: {count} takes and the names {", ".join(self.names)}, '
                            'expected different names and more takes than names')
        if not ((self.lengths > 0.0).all() and (self.noise > 0.0).all()):
            raise DataError('contexts: lengths and noise must be above 0')
        if not varies(self.takes):
            raise DataError('contexts: a number does not vary between the takes, or follows from '
                            'the others')

    def numbers(self, context: Context) -> np.ndarray:
        """
        Numbers of a context in the order of the names.

        :raises ParameterError: unless there is a finite number for each name, no further outside
            of the range of the takes than that is wide
        """
        if isinstance(context, Mapping):
            if set(context) != set(self.names):
                raise ParameterError(f'context: expected {", ".join(self.names)}, got '
                                     f'{", ".join(map(str, context)) or "nothing"}')
            context = [context[name] for name in self.names]
        given = numbers_or_none(context)
        if given.shape != (len(self.names),) or not np.isfinite(given).all():
            raise ParameterError(f'context: expected {len(self.names)} finite numbers '
                                 f'({", ".join(self.names)}), got {context!r}')
        low, high = self.takes.min(axis=0), self.takes.max(axis=0)
        for name, number, least, most in zip(self.names, given, low, high):
            if not least - (most - least) <= number <= most + (most - least):
                raise ParameterError(f'context: {name} is {number:g}, further outside of what '
                                     f'the takes show, {least:g} to {most:g}, than that is wide')
        return given

    def shift(self, numbers: np.ndarray) -> tuple[np.ndarray, float]:
        """Shift of start, goal and weights for a context, ``(rows,)``; factor of the duration."""
        linear = linear_terms(numbers, self.takes)
        near = correlations(numbers[None], self.takes, self.lengths)[0]
        return self.trend @ linear + self.bend @ near, float(np.exp(self.timing @ linear))

    def growth(self, numbers: np.ndarray) -> float:
        """Standard deviation of the shift, relative to the usual one between the takes; >= 1."""
        linear = linear_terms(self.takes, self.takes)
        own = correlations(self.takes, self.takes, self.lengths) + np.diag(self.noise)
        maps = kriging(own, linear)
        near = correlations(numbers[None], self.takes, self.lengths)[0]
        noise = self.noise.mean()
        rest = linear_terms(numbers, self.takes) - linear.T @ maps.inverse @ near
        variance = 1.0 + noise - near @ maps.inverse @ near + rest @ maps.trend_covariance @ rest
        return float(np.sqrt(max(1.0, variance / np.mean(1.0 / np.diag(maps.bend)))))

    def outside(self, numbers: np.ndarray) -> str:
        """Why a context is outside of what the takes show; empty if it is not."""
        low, high = self.takes.min(axis=0), self.takes.max(axis=0)
        margin = _ROUNDING * (high - low)
        for name, number, least, most, more in zip(self.names, numbers, low, high, margin):
            if not least - more <= number <= most + more:
                return f'{name} is {number:g}, the takes show {least:g} to {most:g}'
        offset, given = scaled(self.takes, self.takes), scaled(numbers, self.takes)
        inverse = np.linalg.inv(offset.T @ offset)
        if given @ inverse @ given > (1.0 + _ROUNDING) * np.einsum(
                'ki,ij,kj->k', offset, inverse, offset).max():
            together = ', '.join(f'{n} {x:g}' for n, x in zip(self.names, numbers))
            return f'the takes show no combination like {together}'
        return ''


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
