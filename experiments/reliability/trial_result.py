"""Measurements of a trial, and requirements that failed."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
import math


@dataclass
class TrialResult:
    """
    Measurements and claims of one trial.

    :ivar measured: values by name with unit
    :ivar failed: requirements that do not hold
    :ivar late: requirements of speed that do not hold; a busy machine is enough for it
    :ivar missing: why the trial was not possible; empty if it was
    """

    measured: dict[str, float | str] = field(default_factory=dict)
    failed: list[str] = field(default_factory=list)
    late: list[str] = field(default_factory=list)
    missing: str = ''

    @property
    def holds(self) -> bool | None:
        """Whether all requirements hold; None if the trial was not possible."""
        return None if self.missing else not self.failed + self.late

    def need(self, name: str, value: float, good: Callable[[float], bool],
             of_speed: bool = False) -> None:
        """Keep a value; it has to be finite and good."""
        self.measured[name] = value
        if not (math.isfinite(value) and good(value)):
            (self.late if of_speed else self.failed).append(f'{name}: {value:.4g}')

    def claim(self, what: str, holds: bool, of_speed: bool = False) -> None:
        """Keep a claim that is true or false."""
        self.measured[what] = 'yes' if holds else 'no'
        if not holds:
            (self.late if of_speed else self.failed).append(what)
