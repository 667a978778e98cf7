"""How takes depend on the contexts in which they were shown."""
from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from gdmp_ros.dmp.contexts import ContextModel, correlations, kriging
from gdmp_ros.errors import DataError, ParameterError

#: Contexts of the takes as users give them: numbers for each name, or one row for each take.
GivenContexts: TypeAlias = Mapping[str, Sequence[float]] | Sequence[Sequence[float]] | np.ndarray
#: Largest condition of the correlations between the numbers of a context.
LARGEST_CONDITION = 1e8
#: Correlation lengths that are tried, as parts of the ranges of the numbers.
LENGTHS = (0.2, 5.0)
#: Noise that is tried, relative to the process. With the last nothing but the trend is left.
NOISES = (1e-6, 1e6)
#: Least part of what the takes show that counts.
ROUNDING = 1e-12
#: Where the search begins: length, noise.
STARTS = ((0.5, 1e-4), (1.5, 1e-4), (1.0, 1.0))


@dataclass(frozen=True)
class Contexts:
    """
    Checked contexts of takes.

    :ivar names: of the numbers
    :ivar numbers: shape ``(takes, m)``
    """

    names: tuple[str, ...]
    numbers: np.ndarray

    @classmethod
    def of(cls, given: GivenContexts, count: int) -> Contexts:
        """
        Check what a user gave.

        :param count: of the takes
        :raises ParameterError: unless there are as many finite numbers for each take
        :raises DataError: if there are too few takes, or a number does not vary
        """
        names = tuple(map(str, given)) if isinstance(given, Mapping) else ()
        try:
            numbers = np.array([given[name] for name in given] if isinstance(given, Mapping)
                               else given, dtype=np.float64)
        except (TypeError, ValueError):
            numbers = np.empty(0)
        if isinstance(given, Mapping):
            numbers = numbers.T
        if numbers.ndim != 2 or len(numbers) != count or not numbers.size or not np.isfinite(
                numbers).all():
            raise ParameterError(f'contexts have shape {numbers.shape}, expected ({count}, any) '
                                 'finite numbers, one row for each demonstration')
        size = numbers.shape[1]
        if count < size + 3:
            raise DataError(f'{count} takes, expected at least {size + 3} for contexts of {size} '
                            'numbers')
        spread = numbers.std(axis=0)
        if not (spread > 0.0).all() or np.linalg.cond(np.atleast_2d(
                np.cov((numbers / np.where(spread > 0.0, spread, 1.0)).T))) > LARGEST_CONDITION:
            raise DataError('contexts: a number does not vary between the takes, or follows '
                            'from the others')
        return cls(names or tuple(f'c{i + 1}' for i in range(size)), numbers)


class ContextFit:
    """
    Universal kriging of what takes show, with lengths and noise of the largest likelihood.

    :ivar left: what is left of each take if the others explain it, shape ``(takes, any)``
    """

    def __init__(self, contexts: Contexts, shown: np.ndarray, scales: np.ndarray,
                 take_weights: np.ndarray):
        """
        :param shown: numbers of each take, shape ``(takes, any)``
        :param scales: that make these numbers comparable
        :param take_weights: 1 on average
        """
        self._contexts, self._shown, self._weights = contexts, shown, take_weights
        self._linear = np.column_stack([np.ones(len(shown)), contexts.numbers])
        self._range = np.ptp(contexts.numbers, axis=0)
        # Distances between the takes are all that the choice needs: a square matrix has them.
        left, values, _ = np.linalg.svd(shown * scales, full_matrices=False)
        self._compact = left * values
        self._lengths, self._noise = self._chosen()
        self._maps = kriging(self._covariance(self._lengths, self._noise), self._linear)
        self.left = (self._maps.bend @ shown) / np.diag(self._maps.bend)[:, None]

    def model(self, rows: Callable[[np.ndarray], np.ndarray], lengths: np.ndarray
              ) -> tuple[ContextModel, np.ndarray]:
        """
        The model of the takes, and what it leaves of the logarithms of their durations.

        :param rows: coordinates of a primitive, of numbers that a take shows, both row by row
        :param lengths: logarithms of the takes' durations, divided by that of the primitive
        """
        trend, bend = (rows(part @ self._shown).T for part in (self._maps.trend,
                                                               self._maps.bend))
        near = correlations(self._contexts.numbers, self._contexts.numbers, self._lengths)
        explained = self._linear @ trend.T + near @ bend.T
        roots = np.sqrt(self._weights)[:, None]
        away = roots * (explained - np.average(explained, axis=0, weights=self._weights))
        _, values, right = np.linalg.svd(away / np.sqrt(len(away) - 1.0), full_matrices=False)
        kept = values > 1e-9 * values[0]
        # The few durations say no more than a trend.
        timing = np.linalg.lstsq(roots * self._linear, roots[:, 0] * lengths, rcond=None)[0]
        return ContextModel(self._contexts.names, self._contexts.numbers, self._lengths,
                            self._noise / self._weights, trend, bend,
                            (values[kept, None] * right[kept]).T, timing
                            ), lengths - self._linear @ timing

    def _covariance(self, lengths: np.ndarray, noise: float) -> np.ndarray:
        near = correlations(self._contexts.numbers, self._contexts.numbers, lengths)
        near[np.diag_indices(len(near))] += noise / self._weights
        return near

    def _unlikelihood(self, logarithms: np.ndarray) -> float:
        """Restricted likelihood, times -2; all numbers share one variance of the process."""
        length, noise = np.exp(logarithms)
        near = self._covariance(length * self._range, noise)
        maps = kriging(near, self._linear)
        energy = np.einsum('kc,kl,lc->', self._compact, maps.bend, self._compact)
        # Takes that a trend explains exactly leave nothing but rounding.
        energy = max(float(energy), ROUNDING * float((self._compact ** 2).sum()) + 1e-300)
        free = len(near) - self._linear.shape[1]
        return float(free * np.log(energy) + np.linalg.slogdet(near)[1]
                     - np.linalg.slogdet(maps.trend_covariance)[1])

    def _chosen(self) -> tuple[np.ndarray, float]:
        """One length for all numbers: one for each would be chosen from too few takes."""
        from scipy.optimize import minimize  # slow to import
        found = min((minimize(self._unlikelihood, np.log(start), method='L-BFGS-B',
                              bounds=np.log([LENGTHS, NOISES])) for start in STARTS),
                    key=lambda one: float(one.fun))
        length, noise = np.exp(found.x)
        return length * self._range, float(noise)
