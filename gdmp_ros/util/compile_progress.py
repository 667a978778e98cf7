"""Reports the compilation of kernels, which takes some minutes, once."""
from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import sys
import threading
import time

from gdmp_ros.kernels import on_compile

#: Time between two reports [s].
EVERY_S = 2.0


def _print(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


@contextmanager
def compilation_reported(report: Callable[[str], None] = _print) -> Iterator[None]:
    """
    Report kernels that are compiled meanwhile: at the first one, then every two seconds.

    :param report: takes a line of text; it is called from another thread
    """
    reporter = _Reporter(report)
    with on_compile(reporter.started, reporter.finished):
        try:
            yield
        finally:
            reporter.close()


class _Reporter:
    """Prints lines from a thread of its own: the compiler does not return between two kernels."""

    def __init__(self, report: Callable[[str], None]):
        self._report = report
        self._names: list[str] = []
        self._compiled = 0
        self._first = self._begun = self._spent = 0.0
        self._closed = threading.Event()
        self._thread: threading.Thread | None = None

    def started(self, name: str) -> None:
        # A kernel that calls another one starts before it and is finished after it.
        if not self._names:
            self._begun = time.monotonic()
        self._names.append(name)
        if self._thread is None:
            self._first = self._begun
            self._report('compiling the kernels, once: this takes some minutes')
            self._thread = threading.Thread(target=self._run, daemon=True)
            self._thread.start()

    def finished(self) -> None:
        self._compiled += 1
        if self._names:
            self._names.pop()
        if not self._names:
            self._spent += time.monotonic() - self._begun

    def close(self) -> None:
        self._closed.set()
        if self._thread is None:
            return
        self._thread.join()
        self._report(f'{self._compiled} kernels compiled in {self._spent:.0f} s')

    def _run(self) -> None:
        while not self._closed.wait(EVERY_S):
            names = self._names[-1:]
            if names:
                self._report(f'compiling the kernels: {names[0]}, {self._compiled} done '
                             f'({time.monotonic() - self._first:.0f} s)')
