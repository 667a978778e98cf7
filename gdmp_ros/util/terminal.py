"""Tables and progress bars on the terminal; kernels that are compiled meanwhile."""
from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
import sys
import threading
import time

from gdmp_ros.kernels import on_compile


def table(title: str, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Print a table."""
    # rich is imported where it is used: it costs 50 ms of every start.
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text
    result = Table(title=Text(title), title_justify='left')
    for i, column in enumerate(columns):
        result.add_column(Text(column), justify='left' if i == 0 else 'right')
    for row in rows:
        result.add_row(*(Text(str(cell)) for cell in row))
    Console(width=None if sys.stdout.isatty() else 110).print(result)


@contextmanager
def progress(title: str, total: int) -> Iterator[Callable[..., None]]:
    """
    Show progress on standard error: a bar on a terminal, otherwise a line every two seconds.

    A step that takes longer is seen too: the time passes.

    :returns: a function to call with the number of steps done (default 1)
    """
    from rich.console import Console
    from rich.progress import Progress, TimeElapsedColumn
    console = Console(stderr=True)
    if not console.is_terminal:
        lines = _Lines(title, total)
        try:
            yield lines
        finally:
            lines.end()
        return
    columns = (*Progress.get_default_columns(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task(title, total=total)
        yield lambda done=1: bar.advance(task, done)


def rising(step: Callable[..., None]) -> Callable[[float], None]:
    """
    Function to call with all that is done, instead of what is new; what falls is not shown.

    :param step: of `progress`
    """
    reported = 0.0

    def show(done: float) -> None:
        nonlocal reported
        step(max(done - reported, 0.0))
        reported = max(done, reported)
    return show


class _Lines:
    """Progress as lines of text."""

    EVERY_S = 2.0

    def __init__(self, title: str, total: int):
        self._title, self._total, self._done = title, total, 0.0
        self._began = time.monotonic()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._print, daemon=True)
        self._thread.start()

    def __call__(self, done: float = 1) -> None:
        self._done += done

    def _print(self) -> None:
        while not self._ended.wait(self.EVERY_S):
            print(f'{self._title}: {self._done:.0f} of {self._total}, '
                  f'{time.monotonic() - self._began:.0f} s', file=sys.stderr, flush=True)

    def end(self) -> None:
        """Print no more."""
        self._ended.set()
        self._thread.join()


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
            self._report('compiling the kernels, once: this takes up to a minute')
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
