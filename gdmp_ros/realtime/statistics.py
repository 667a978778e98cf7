"""Statistics of a periodic loop."""
from __future__ import annotations

from array import array
from pathlib import Path
from typing import NamedTuple

import numpy as np


class Punctuality(NamedTuple):
    """
    Figures of a loop.

    :ivar ticks: steps taken
    :ivar missed: missed deadlines
    :ivar rate_hz: steps per second
    """

    ticks: int
    missed: int
    rate_hz: float
    p50_us: float
    p99_us: float
    max_us: float


class LatenessRecorder:
    """
    Keeps deadline and lateness of the last ticks in preallocated arrays.

    Single numbers are written four times faster to an `array` than to a NumPy array.
    """

    def __init__(self, period_ns: int, capacity: int = 1 << 17):
        """:param capacity: ticks kept; older ones are overwritten"""
        self._period = period_ns
        self._capacity = capacity
        # Written once, because the first access to a page of memory causes a page fault.
        self._deadlines, self._lateness = (array('q', [0]) * capacity for _ in range(2))
        self._last = 0
        self.ticks = 0
        self.missed = 0

    @property
    def rate_hz(self) -> float:
        """Ticks per second that are asked for."""
        return 1e9 / self._period

    def add(self, deadline_ns: int, now_ns: int) -> None:
        """Count a tick; deadlines skipped since the last one count as missed."""
        if self.ticks:
            self.missed += (deadline_ns - self._last) // self._period - 1
        self._last = deadline_ns
        slot = self.ticks % self._capacity
        self._deadlines[slot] = deadline_ns
        self._lateness[slot] = now_ns - deadline_ns
        self.ticks += 1

    def punctuality(self, last: int | None = None) -> Punctuality:
        """Figures of the last ``last`` ticks; by default of all that are kept."""
        window = self.ticks_kept(last)
        if len(window) < 2:
            return Punctuality(self.ticks, self.missed, 0.0, 0.0, 0.0, 0.0)
        figures = punctuality_of(window, self._period)
        return figures._replace(ticks=self.ticks, missed=self.missed)

    def ticks_kept(self, last: int | None = None) -> np.ndarray:
        """
        Deadline and lateness of the last ticks [ns], oldest first, shape ``(ticks, 2)``.

        :param last: at most so many; by default all that are kept
        """
        ticks = self.ticks
        kept = min(ticks, self._capacity, last or ticks)
        slots = np.arange(ticks - kept, ticks) % self._capacity
        return np.column_stack([np.frombuffer(item, dtype=np.int64)[slots]
                                for item in (self._deadlines, self._lateness)])

    def save(self, path: str | Path) -> None:
        """Write `ticks_kept` as a NumPy file."""
        np.save(path, self.ticks_kept())


def punctuality_of(ticks: np.ndarray, period_ns: int) -> Punctuality:
    """Figures of at least two ticks, as from `LatenessRecorder.ticks_kept`."""
    deadlines, late = ticks[:, 0], ticks[:, 1] * 1e-3
    p50, p99 = np.percentile(late, [50.0, 99.0])
    missed = int((np.diff(deadlines) // period_ns - 1).clip(min=0).sum())
    rate = (len(ticks) - 1) / ((deadlines[-1] - deadlines[0]) * 1e-9)
    return Punctuality(len(ticks), missed, float(rate), float(p50), float(p99), float(late.max()))
