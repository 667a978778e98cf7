"""How a roll-out behaves: options and their limits."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math
from typing import Any

import numpy as np

from gdmp_ros.errors import ParameterError
from gdmp_ros.manifolds import Manifold
from gdmp_ros.util.numeric import numbers_or_none

#: Longest time that may pass in one call [s]; NaN and infinity are longer.
LONGEST_STEP = 3600.0
#: Shortest duration of a motion [s]: its grid has 4000 steps, 80 in a millisecond then.
SHORTEST_DURATION = 0.05
#: Largest amplitude of a cycle, as a factor of the demonstrated one.
MAX_AMPLITUDE = 2.0
#: Slowest limit of the speed of a goal: a slower one would not arrive in hours.
SLOWEST_GOAL = 1e-6
#: Fastest speed of the phase that `Rollout.set_speed` accepts.
MAX_SPEED = 2.0


@dataclass(frozen=True)
class Options:
    """
    How a roll-out behaves; everything has a default.

    :ivar speed: speed of the phase at the beginning, 0 to 2; 1 is as demonstrated
    :ivar speed_rate: largest change of the speed [1/s]
    :ivar tolerances: distance to the goal at which each factor counts as arrived
    :ivar goal_speed: for each factor, fastest a goal moves after a switch [1/s at speed 1, in the
        factor's metric: m, rad, half-angle rad]; infinity or None for no limit
    :ivar phase_stopping: κ in ``ds/dt ← ds/dt / (1 + κ e²)``; 0 ignores the tracking error
    :ivar error_weights: for each factor, weight of its squared tracking error in ``e² = Σ w d²``;
        1 by default
    :ivar amplitude: of a rhythmic skill, 0 to 2; 1 is as demonstrated
    """

    speed: float = 1.0
    speed_rate: float = 5.0
    tolerances: Sequence[float] | None = None
    goal_speed: Sequence[float] | None = None
    phase_stopping: float = 0.0
    error_weights: Sequence[float] | None = None
    amplitude: float = 1.0

    def check(self, manifold: Manifold) -> None:
        """:raises ParameterError: if a number is out of range"""
        check_range('speed', self.speed, 0.0, MAX_SPEED)
        check_range('amplitude', self.amplitude, 0.0, MAX_AMPLITUDE)
        check_range('speed_rate', self.speed_rate, 1e-6, math.inf)
        check_range('phase_stopping', self.phase_stopping, 0.0, 1e9)
        count = len(manifold.factors)
        for name, low, high in (('goal_speed', SLOWEST_GOAL, math.inf),
                                ('error_weights', 0.0, 1e9)):
            given = getattr(self, name)
            values = numbers_or_none(given)
            if given is not None and not (values.shape == (count,) and (
                    (low <= values) & (values <= high)).all()):
                raise ParameterError(f'{name}: expected {count} numbers from {low:g} to {high:g}, '
                                     f'got {given!r}')
        array = self.tolerances_of(manifold)
        if array.shape != (count,) or not (array > 0.0).all():
            raise ParameterError(f'tolerances: expected {count} numbers > 0, '
                                 f'got {self.tolerances!r}')

    def tolerances_of(self, manifold: Manifold) -> np.ndarray:
        """Tolerance of each factor."""
        if self.tolerances is None:
            return np.array([factor.goal_tolerance for factor in manifold.factors])
        return numbers_or_none(self.tolerances)


def merged_options(options: Options | None, changes: dict[str, Any]) -> Options:
    """
    ``options``, or the defaults, with single ones replaced by name.

    :raises ParameterError: if a name is unknown
    """
    known = vars(options or Options())
    unknown = sorted(set(changes) - set(known))
    if unknown:
        raise ParameterError(f'unknown option {", ".join(unknown)}; expected one of '
                             f'{", ".join(known)}')
    return Options(**{**known, **changes})


def check_steps(least: float, most: float) -> None:
    """
    Check times to pass.

    :param least: the shortest [s]
    :param most: the longest [s]
    :raises ParameterError: unless they are from 0 to `LONGEST_STEP`
    """
    if not (least >= 0.0 and most <= LONGEST_STEP):
        wrong = most if least >= 0.0 else least
        raise ParameterError(f'the time to pass is {wrong!r} s, expected a number from 0 to '
                             f'{LONGEST_STEP:g}')


def check_range(name: str, value: object, low: float, high: float) -> float:
    """
    Return ``value`` as a number.

    :raises ParameterError: if it is not a number from ``low`` to ``high``
    """
    if not (isinstance(value, (int, float, np.number)) and low <= value <= high):
        raise ParameterError(f'{name} is {value!r}, expected a number from {low:g} to {high:g}')
    return float(value)
