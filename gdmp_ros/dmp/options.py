"""How a roll-out behaves: what may be chosen, and within which limits."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np

from gdmp_ros.errors import ParameterError
from gdmp_ros.manifolds import Manifold

#: How near every factor must be to the goal: [m], [rad], half-angle [rad], [rad], [1].
TOLERANCES = {'euclidean': 0.0005, 'sphere': 0.0025, 'quaternion': 0.00125, 'rotation': 0.0025,
              'spd': 0.0025}
#: Fastest tempo `Rollout.set_speed` accepts.
MAX_SPEED = 2.0


@dataclass(frozen=True)
class Options:
    """
    How a roll-out behaves; everything has a default.

    :ivar speed: tempo at the beginning, 0 to 2
    :ivar speed_rate: largest change of the tempo [1/s]
    :ivar tolerances: distance to the goal at which each factor counts as arrived
    :ivar goal_speed: for each factor, fastest a goal moves after a switch [1/s at speed 1, in the
        factor's metric: m, rad, half-angle rad]; infinity for no limit; None for none at all
    :ivar phase_stopping: κ in ``ds/dt ← ds/dt / (1 + κ e²)``; 0 ignores the tracking error
    :ivar error_weights: for each factor, weight of its squared tracking error in ``e² = Σ w d²``;
        1 by default
    """

    speed: float = 1.0
    speed_rate: float = 5.0
    tolerances: Sequence[float] | None = None
    goal_speed: Sequence[float] | None = None
    phase_stopping: float = 0.0
    error_weights: Sequence[float] | None = None

    def check(self, manifold: Manifold) -> None:
        """:raises ParameterError: if a number is out of range"""
        in_range('speed', self.speed, 0.0, MAX_SPEED)
        in_range('speed_rate', self.speed_rate, 1e-6, math.inf)
        in_range('phase_stopping', self.phase_stopping, 0.0, 1e9)
        count = len(manifold.factors)
        for name in ('goal_speed', 'error_weights'):
            given = getattr(self, name)
            if given is not None and not (len(given) == count and all(v >= 0.0 for v in given)):
                raise ParameterError(f'{name}: expected {count} numbers >= 0, got {given!r}')
        array = self.tolerances_of(manifold)
        if array.shape != (count,) or not (array > 0.0).all():
            raise ParameterError(f'tolerances: expected {count} numbers > 0, '
                                 f'got {self.tolerances!r}')

    def tolerances_of(self, manifold: Manifold) -> np.ndarray:
        """Tolerance of each factor."""
        if self.tolerances is None:
            return np.array([TOLERANCES[factor.kind] for factor in manifold.factors])
        return np.asarray(self.tolerances, dtype=np.float64)


def options_of(options: Options | None,
               settings: dict[str, float | Sequence[float] | None]) -> Options:
    """``options``, or the defaults, with single ones replaced by name."""
    try:
        return Options(**{**(vars(options) if options else {}), **settings})
    except TypeError:
        unknown = ', '.join(sorted(set(settings) - set(vars(Options()))))
        raise ParameterError(f'unknown option {unknown}; there are '
                             f'{", ".join(vars(Options()))}') from None


def in_range(name: str, value: object, low: float, high: float) -> float:
    """Return ``value`` as a number; refuse what is none or lies outside."""
    if not (isinstance(value, (int, float, np.number)) and low <= value <= high):
        raise ParameterError(f'{name} is {value!r}, expected a number from {low:g} to {high:g}')
    return float(value)
