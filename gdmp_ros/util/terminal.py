"""Tables and progress bars on the terminal."""
from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
import sys
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

    :returns: a function to call with the number of steps done (default 1)
    """
    from rich.console import Console
    from rich.progress import Progress
    console = Console(stderr=True)
    if not console.is_terminal:
        yield _Lines(title, total)
        return
    with Progress(console=console, transient=True) as bar:
        task = bar.add_task(title, total=total)
        yield lambda done=1: bar.advance(task, done)


class _Lines:
    """Progress as lines of text."""

    EVERY_S = 2.0

    def __init__(self, title: str, total: int):
        self._title, self._total, self._done = title, total, 0.0
        self._printed = time.monotonic()

    def __call__(self, done: float = 1) -> None:
        self._done += done
        if time.monotonic() - self._printed >= self.EVERY_S:
            self._printed = time.monotonic()
            print(f'{self._title}: {self._done:.0f} of {self._total}', file=sys.stderr, flush=True)
