"""Commands that several threads give and one carries out."""
from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
import queue
from typing import Any, TypeVar

from gdmp_ros.errors import GdmpError
from gdmp_ros.realtime.loop import Clock, NS

T = TypeVar('T')
#: Time between two looks for a result [ns].
LOOK_NS = 2_000_000


class Commands:
    """A queue of commands; nobody or one waits for each."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._waiting: queue.SimpleQueue[tuple[Callable[[], None], Future[Any] | None]] = (
            queue.SimpleQueue())

    def put(self, work: Callable[[], None]) -> None:
        """Give a command; any thread may call it."""
        self._waiting.put((work, None))

    def ask(self, work: Callable[[], T], longest: float) -> T:
        """
        Give a command and wait for its result; one that has not begun in time is not carried out.

        :param longest: [s]
        :raises GdmpError: that of the command, or after ``longest`` seconds
        """
        future: Future[T] = Future()

        def carry_out() -> None:
            try:
                future.set_result(work())
            except GdmpError as error:
                future.set_exception(error)
        self._waiting.put((carry_out, future))
        clock = self._clock
        ends = clock.now() + round(longest * NS)
        while not future.done() and clock.now() < ends:
            clock.sleep_until(clock.now() + LOOK_NS)
        if future.cancel() or not future.done():
            raise GdmpError(f'waited {longest:g} s for the nodes, without success')
        return future.result()

    def drop(self) -> None:
        """Forget what has not been carried out."""
        with suppress(queue.Empty):
            while True:
                _, future = self._waiting.get_nowait()
                if future is not None:
                    future.cancel()

    def carry_out(self) -> None:
        """Carry out all commands; one thread calls it."""
        while not self._waiting.empty():
            work, future = self._waiting.get()
            if future is None or future.set_running_or_notify_cancel():
                work()
