"""A periodic loop on absolute deadlines, and the thread it runs in."""
from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import gc
import os
import sys
import threading
import time
from typing import Protocol

#: How often Python may switch threads while a loop runs [s]; the default of 5 ms is five ticks.
SWITCH_INTERVAL_S = 1e-4
#: Default SCHED_FIFO priority (1 … 99; threaded interrupts run at 50).
DEFAULT_PRIORITY = 40
#: Priority of `raised_priority`: above all normal threads, not above any loop.
RAISED_PRIORITY = 1


class Clock(Protocol):
    """Source of time of a loop."""

    def now(self) -> int:
        """Present time [ns]."""

    def sleep_until(self, deadline_ns: int) -> None:
        """Return at ``deadline_ns`` or a little later."""


class RunningLoop(Protocol):
    """A loop that runs in a thread of its own."""

    @property
    def failure(self) -> BaseException | None:
        """Exception that ended it, None while it runs."""

    @property
    def scheduler(self) -> str:
        """``fifo`` or ``other``."""

    def leave(self) -> None:
        """End it; no step is made after the return."""


class MonotonicClock:
    """The machine's monotonic clock."""

    def now(self) -> int:
        """Present time [ns]."""
        return time.monotonic_ns()

    def sleep_until(self, deadline_ns: int) -> None:
        """Sleep until the deadline; return at once if it has passed."""
        left = deadline_ns - time.monotonic_ns()
        if left > 0:
            time.sleep(left * 1e-9)


def run_periodic(step: Callable[[int, int], None], period_ns: int, clock: Clock,
                 stop: Callable[[], bool]) -> int:
    """
    Call ``step(deadline_ns, now_ns)`` on a fixed time grid until ``stop()``.

    The grid is absolute, so delays do not accumulate. After an overrun the missed ticks are
    skipped: ``step`` integrates over the time between the deadlines it is given.

    :returns: number of missed deadlines
    """
    missed = 0
    deadline = clock.now() + period_ns
    while not stop():
        clock.sleep_until(deadline)
        step(deadline, clock.now())
        late = (clock.now() - deadline) // period_ns
        if late > 0:
            missed += late
        deadline += (max(late, 0) + 1) * period_ns
    return missed


_real_time_threads: set[RealtimeThread] = set()


@contextmanager
def raised_priority() -> Iterator[None]:
    """
    Let the calling thread precede other processes, while a loop of this process has SCHED_FIFO.

    A thread that is interrupted while it holds the GIL keeps the loop waiting, for milliseconds on
    a busy machine.
    """
    if not _real_time_threads:
        yield
        return
    # Threads and processes that are started meanwhile have normal priority.
    policy = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
    os.sched_setscheduler(0, policy, os.sched_param(RAISED_PRIORITY))
    try:
        yield
    finally:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


class RealtimeThread:
    """
    A thread for a periodic loop: real-time priority if granted, no garbage collection.

    :ivar scheduler: ``fifo`` or ``other``, as soon as the thread runs
    :ivar failure: exception that ended the thread
    """

    def __init__(self, target: Callable[[], None], priority: int = -1):
        """
        Prepare the thread.

        :param priority: SCHED_FIFO priority 1 … 99; 0: normal; -1: `DEFAULT_PRIORITY` if granted
        """
        self.scheduler = 'other'
        self.failure: BaseException | None = None
        self._target = target
        self._priority = DEFAULT_PRIORITY if priority < 0 else priority
        self._ready = threading.Event()
        self._thread = threading.Thread(target=self._run, name='realtime', daemon=True)

    def start(self) -> None:
        """Start the thread and wait until its priority is known."""
        self._switch_interval = sys.getswitchinterval()
        sys.setswitchinterval(SWITCH_INTERVAL_S)
        gc.collect()
        gc.freeze()
        gc.disable()
        self._thread.start()
        self._ready.wait()

    def join(self) -> None:
        """Wait for the end of the loop, then enable the garbage collector again."""
        self._thread.join()
        sys.setswitchinterval(self._switch_interval)
        gc.enable()
        gc.unfreeze()

    def _run(self) -> None:
        if self._priority > 0:
            try:
                # 0 is the calling thread only.
                os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(self._priority))
                self.scheduler = 'fifo'
                _real_time_threads.add(self)
            except OSError:
                self.scheduler = 'other'
        self._ready.set()
        try:
            self._target()
        except BaseException as error:
            self.failure = error
        finally:
            _real_time_threads.discard(self)
