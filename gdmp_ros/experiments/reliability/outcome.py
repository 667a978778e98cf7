"""What a trial measured, and whether that is good enough."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
import math


@dataclass
class Outcome:
    """
    Measurements and claims of one trial.

    :ivar measured: name with unit, and figure
    :ivar failed: what does not hold
    :ivar missing: why it could not be tried, empty if it was
    """

    measured: dict[str, float | str] = field(default_factory=dict)
    failed: list[str] = field(default_factory=list)
    missing: str = ''

    @property
    def holds(self) -> bool | None:
        """None where it could not be tried."""
        return None if self.missing else not self.failed

    def need(self, name: str, value: float, good: Callable[[float], bool]) -> None:
        """Keep a figure; it has to be finite and good."""
        self.measured[name] = value
        if not (math.isfinite(value) and good(value)):
            self.failed.append(f'{name}: {value:.4g}')

    def claim(self, what: str, holds: bool) -> None:
        """Keep a claim that is true or not."""
        self.measured[what] = 'yes' if holds else 'no'
        if not holds:
            self.failed.append(what)
