"""
Search for better numbers by trying some: reward-weighted averaging, and CMA-ES as its peer.

All numbers are in units of their own first standard deviation: a search begins at 0 with the unit
covariance.
"""
from __future__ import annotations

from collections.abc import Callable, Sequence
import math
from typing import Any, Protocol

import numpy as np

from gdmp_ros.errors import ParameterError
from gdmp_ros.util.optional_imports import extra, optional_import

#: Elitism h of [PIBB]: the worst sample of an update has the weight e^-h of the best one.
ELITISM = 10.0
#: Share of the new covariance in an update, as in the demonstrations of dmpbbo.
LEARNING_RATE = 0.5
#: Bounds of the standard deviation along each axis, in units of the first one.
SMALLEST, LARGEST = 0.05, 3.0


class Search(Protocol):
    """
    A search; the same random numbers and costs give the same samples.

    :ivar mean: best guess, shape ``(n,)``
    :ivar covariance: of the samples around it, shape ``(n, n)``
    """

    mean: np.ndarray
    covariance: np.ndarray

    def ask(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """Numbers to try, shape ``(count, n)``."""

    def tell(self, samples: np.ndarray, costs: Sequence[float | None]) -> None:
        """
        Learn from the costs of samples.

        :param costs: None for a sample that violated a limit: as bad as the worst one
        """


def ranked(costs: Sequence[float | None]) -> np.ndarray | None:
    """
    Costs of an update with the worst one for samples without a cost.

    :returns: None if no sample has one: nothing can be learned
    """
    known = [cost for cost in costs if cost is not None]
    if not known:
        return None
    worst = max(known)
    # A sample without a cost is worse than all others, also if those are equal.
    worst += max(worst - min(known), abs(worst), 1e-9) if len(known) < len(costs) else 0.0
    return np.array([worst if cost is None else cost for cost in costs])


def reward_weights(costs: np.ndarray) -> np.ndarray:
    """Weights of samples, [PIBB] section 3: exponentials of the costs over their range."""
    span = float(np.ptp(costs))
    weights = np.ones(len(costs)) if span == 0.0 else np.exp(
        -ELITISM * (costs - costs.min()) / span)
    return np.asarray(weights / weights.sum())


class RewardWeighted:
    """
    PI^BB with covariance adaptation.

    [PIBB]: F. Stulp, O. Sigaud, *Robot skill learning: from reinforcement learning to evolution
    strategies*, Paladyn 4(1), 2013. The mean becomes the reward-weighted mean of the samples, the
    covariance goes to their reward-weighted covariance around the old mean.
    """

    def __init__(self, size: int):
        """:param size: how many numbers are searched"""
        self.mean, self.covariance = np.zeros(size), np.eye(size)

    def ask(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """Numbers to try, shape ``(count, n)``."""
        values, axes = np.linalg.eigh(self.covariance)
        # The symmetric root: eigenvectors, and so the samples, would depend on the machine.
        root = axes * np.sqrt(values) @ axes.T
        return np.asarray(self.mean + rng.standard_normal((count, len(values))) @ root)

    def tell(self, samples: np.ndarray, costs: Sequence[float | None]) -> None:
        """Learn from the costs of samples."""
        known = ranked(costs)
        if known is None:
            return
        weights, offset = reward_weights(known), samples - self.mean
        result = (weights[:, None] * offset).T @ offset
        mixed = (1.0 - LEARNING_RATE) * self.covariance + LEARNING_RATE * result
        values, axes = np.linalg.eigh(mixed)
        values = np.clip(values, SMALLEST ** 2, LARGEST ** 2)
        self.covariance = (axes * values) @ axes.T
        self.mean = weights @ samples


class CmaEs:
    """CMA-ES of the package ``cma``."""

    def __init__(self, size: int):
        """:raises ImportError: without the package"""
        self._size = size
        self.mean, self.covariance = np.zeros(size), np.eye(size)
        self._strategy: Any = None
        self._rng: np.random.Generator | None = None

    def ask(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """Numbers to try, shape ``(count, n)``; the same ``count`` every time."""
        self._rng = rng
        if self._strategy is None:
            with optional_import(extra('improve')):
                import cma
            self._strategy = cma.CMAEvolutionStrategy(np.zeros(self._size), 1.0, {
                'popsize': count, 'seed': math.nan, 'randn': self._normal, 'verbose': -9,
                'verb_log': 0})
        return np.array(self._strategy.ask(count))

    def _normal(self, *shape: int) -> np.ndarray:
        if self._rng is None:
            raise RuntimeError('ask comes first')
        return self._rng.standard_normal(shape)

    def tell(self, samples: np.ndarray, costs: Sequence[float | None]) -> None:
        """Learn from the costs of samples."""
        known = ranked(costs)
        if known is None:
            return
        strategy = self._strategy
        strategy.tell(list(samples), known.tolist())
        self.mean = np.array(strategy.mean)
        self.covariance = np.array(strategy.sigma ** 2 * strategy.sm.covariance_matrix)


#: Searches by name.
SEARCHES: dict[str, Callable[[int], Search]] = {'pibb': RewardWeighted, 'cma': CmaEs}


def search_of(name: str, size: int) -> Search:
    """:raises ParameterError: if the name is unknown"""
    if name not in SEARCHES:
        raise ParameterError(f'search is {name!r}, expected one of {", ".join(SEARCHES)}')
    return SEARCHES[name](size)
