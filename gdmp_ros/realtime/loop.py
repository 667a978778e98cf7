"""Clocks, periodic loops on absolute deadlines, and the threads that loops run in."""
from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
import ctypes
import gc
import os
import resource
import sys
import threading
import time
from typing import Protocol, TypeAlias, TypeVar

NS = 1_000_000_000
#: How often Python may switch threads while a loop runs [s]; the default of 5 ms is five ticks.
SWITCH_INTERVAL_S = 1e-4
#: Default SCHED_FIFO priority (1 … 99; threaded interrupts run at 50).
DEFAULT_PRIORITY = 40
#: Priority of `raised_priority`: above all normal threads, not above any loop.
RAISED_PRIORITY = 1

#: Yields the time at which it is to be resumed [ns], again and again; a time that has passed means
#: as soon as possible.
Loop: TypeAlias = Generator[int, None, None]
Result = TypeVar('Result')
#: mlockall: MCL_CURRENT, MCL_FUTURE, MCL_ONFAULT: only pages that are used.
_LOCKED = 1 | 2 | 4
_real_time_threads: set[LoopThread] = set()


class RunningLoop(Protocol):
    """A loop that a clock runs."""

    @property
    def failure(self) -> BaseException | None:
        """Exception that ended it, None while it runs."""

    @property
    def scheduler(self) -> str:
        """``fifo`` or ``other``."""

    def end(self) -> None:
        """End it where it yields; nothing of it runs after the return."""


class Clock(Protocol):
    """
    Source of time, and what waits for it.

    Nodes have one clock: that of the system, or one that a test steps.
    """

    def now(self) -> int:
        """Steady time, for intervals and deadlines [ns]."""

    def wall(self) -> int:
        """Time of day, for stamps [ns since 1970]."""

    def sleep_until(self, deadline_ns: int) -> None:
        """Return at the steady time ``deadline_ns`` or a little later."""

    def start(self, loop: Loop, priority: int | None = None) -> RunningLoop:
        """
        Run a loop beside the caller.

        :param priority: SCHED_FIFO priority 1 … 99; 0: normal; -1: `DEFAULT_PRIORITY` if granted;
            None: the loop has no deadlines that matter
        """


class SystemClock:
    """The machine's clocks; a loop runs in a thread of its own."""

    def now(self) -> int:
        """Steady time [ns]."""
        return time.monotonic_ns()

    def wall(self) -> int:
        """Time of day [ns since 1970]."""
        return time.time_ns()

    def sleep_until(self, deadline_ns: int) -> None:
        """Sleep until the deadline; return at once if it has passed."""
        left = deadline_ns - time.monotonic_ns()
        if left > 0:
            time.sleep(left * 1e-9)

    def start(self, loop: Loop, priority: int | None = None) -> LoopThread:
        """Run a loop in a thread of its own; see `Clock.start`."""
        thread = LoopThread(loop, self, priority)
        thread.start()
        return thread


def thread_cpu_ns() -> int:
    """CPU time of the calling thread [ns]."""
    return time.thread_time_ns()


def periodic(step: Callable[[int, int], None], period_ns: int, clock: Clock) -> Loop:
    """
    Call ``step(deadline_ns, now_ns)`` on a fixed time grid.

    The grid is absolute, so delays do not accumulate. After an overrun the missed ticks are
    skipped: ``step`` integrates over the time between the deadlines it is given.
    """
    deadline = clock.now() + period_ns
    while True:
        yield deadline
        step(deadline, clock.now())
        late = (clock.now() - deadline) // period_ns
        deadline += (max(late, 0) + 1) * period_ns


def run(loop: Loop, clock: Clock, stop: Callable[[], bool]) -> None:
    """Run a loop in the calling thread until ``stop()``."""
    for deadline in loop:
        if stop():
            loop.close()
            return
        clock.sleep_until(deadline)


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


def priority_beside(priority: int) -> int | None:
    """
    Priority of a loop in Python beside one with a priority; see `Clock.start`.

    It holds the interpreter and sends through the same sockets: were it interrupted there by
    another process, the other loop would wait.
    """
    return RAISED_PRIORITY if priority else None


def _keep_memory(keeps: bool) -> None:
    """Let no page of this process be moved to disk, if the system grants that."""
    library = ctypes.CDLL(None)
    if not keeps:
        library.munlockall()
    # With a limit, memory that is needed later would not be given.
    elif resource.getrlimit(resource.RLIMIT_MEMLOCK)[0] == resource.RLIM_INFINITY:
        library.mlockall(_LOCKED)


class _Punctual:
    """Settings of the interpreter while loops with deadlines run, from the first to the last."""

    def __init__(self) -> None:
        self._loops: set[LoopThread] = set()
        self._changing = threading.Lock()

    def begin(self, loop: LoopThread) -> None:
        """Switch threads often, and collect no garbage, while a loop runs."""
        with self._changing:
            if not self._loops:
                self._switch_interval = sys.getswitchinterval()
                sys.setswitchinterval(SWITCH_INTERVAL_S)
                gc.collect()
                gc.freeze()
                gc.disable()
                _keep_memory(True)
            self._loops.add(loop)

    def end(self, loop: LoopThread) -> None:
        """The loop has ended."""
        with self._changing:
            if loop not in self._loops:
                return
            self._loops.remove(loop)
            if not self._loops:
                sys.setswitchinterval(self._switch_interval)
                gc.enable()
                gc.unfreeze()
                _keep_memory(False)


_punctual = _Punctual()


class LoopThread:
    """
    A thread for a loop.

    Where deadlines matter it has real-time priority if granted, and no garbage collection.

    :ivar scheduler: ``fifo`` or ``other``, as soon as the thread runs
    :ivar failure: exception that ended the loop
    """

    def __init__(self, loop: Loop, clock: Clock, priority: int | None = None):
        """Prepare the thread; see `Clock.start`."""
        self.scheduler = 'other'
        self.failure: BaseException | None = None
        self._loop, self._clock = loop, clock
        self._in_time = priority is not None
        self._priority = DEFAULT_PRIORITY if priority == -1 else priority or 0
        self._ready, self._ending = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._run, name='loop', daemon=True)

    def start(self) -> None:
        """Start the thread and wait until its priority is known."""
        if self._in_time:
            _punctual.begin(self)
        self._thread.start()
        self._ready.wait()

    def end(self) -> None:
        """End the loop where it yields."""
        self._ending.set()
        self.join()

    def join(self) -> None:
        """Wait for the end of the loop."""
        self._thread.join()
        if self._in_time:
            _punctual.end(self)

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
            run(self._loop, self._clock, self._ending.is_set)
        except BaseException as error:
            self.failure = error
        finally:
            _real_time_threads.discard(self)


def in_loop_thread(work: Callable[[], Result]) -> Result:
    """Result of a function that runs like the loop of a node, with its priority."""
    result: list[Result] = []

    def loop() -> Loop:
        result.append(work())
        yield 0
    thread = LoopThread(loop(), SystemClock(), -1)
    thread.start()
    thread.end()
    if thread.failure is not None:
        raise thread.failure
    return result[0]
