"""Statistics of a periodic loop."""
from __future__ import annotations

from array import array
from pathlib import Path
from typing import NamedTuple

import numpy as np

#: Numbers of a `LatenessRecorder` before those of the ticks.
BEGIN = 3


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

    :ivar numbers: ticks, missed deadlines, the last deadline; then deadline and lateness of each
        tick that is kept [ns]: a compiled loop writes them too
    """

    def __init__(self, period_ns: int, capacity: int = 1 << 17):
        """:param capacity: ticks kept; older ones are overwritten"""
        self._period = period_ns
        self._capacity = capacity
        # Written once, because the first access to a page of memory causes a page fault.
        self.numbers = array('q', [0]) * (BEGIN + 2 * capacity)

    @property
    def ticks(self) -> int:
        """Ticks that were made in time or late."""
        return self.numbers[0]

    @property
    def missed(self) -> int:
        """Deadlines without a tick."""
        return self.numbers[1]

    @property
    def rate_hz(self) -> float:
        """Ticks per second that are asked for."""
        return 1e9 / self._period

    def add(self, deadline_ns: int, now_ns: int) -> None:
        """Count a tick; deadlines skipped since the last one count as missed."""
        numbers = self.numbers
        ticks = numbers[0]
        if ticks:
            numbers[1] += (deadline_ns - numbers[2]) // self._period - 1
        slot = BEGIN + 2 * (ticks % self._capacity)
        numbers[0], numbers[2] = ticks + 1, deadline_ns
        numbers[slot], numbers[slot + 1] = deadline_ns, now_ns - deadline_ns

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
        return np.frombuffer(self.numbers, dtype=np.int64)[BEGIN:].reshape(-1, 2)[slots]

    def save(self, path: str | Path) -> None:
        """Write `ticks_kept` as a NumPy file."""
        np.save(path, self.ticks_kept())


def skipped(deadlines: np.ndarray, period_ns: int) -> np.ndarray:
    """Deadlines without a tick between each two, shape ``(ticks - 1,)``."""
    # Rounded: a loop may move its deadlines (`gdmp_ros.ros.arm.position_loop`).
    missed: np.ndarray = (np.diff(deadlines) + period_ns // 2) // period_ns - 1
    return missed.clip(min=0)


def punctuality_of(ticks: np.ndarray, period_ns: int) -> Punctuality:
    """Figures of at least two ticks, as from `LatenessRecorder.ticks_kept`."""
    deadlines, late = ticks[:, 0], ticks[:, 1] * 1e-3
    p50, p99 = np.percentile(late, [50.0, 99.0])
    missed = int(skipped(deadlines, period_ns).sum())
    rate = (len(ticks) - 1) / ((deadlines[-1] - deadlines[0]) * 1e-9)
    return Punctuality(len(ticks), missed, float(rate), float(p50), float(p99), float(late.max()))
