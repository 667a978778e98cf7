"""Commands that several threads give and one carries out."""
from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import CancelledError, Future
from concurrent.futures import TimeoutError as FutureTimeoutError
from contextlib import suppress
import queue
from typing import Any, TypeVar

from gdmp_ros.errors import GdmpError

T = TypeVar('T')


class Commands:
    """A queue of commands; nobody or one waits for each."""

    def __init__(self) -> None:
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
        try:
            return future.result(longest)
        except (FutureTimeoutError, CancelledError):
            future.cancel()
            raise GdmpError(f'waited {longest:g} s for the nodes, without success') from None

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
