"""Tables and progress bars on the terminal."""
from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
import sys
import threading
import time


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


