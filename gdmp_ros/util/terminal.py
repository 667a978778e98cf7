"""Tables and progress on the terminal; progress only where someone looks."""
from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
import sys

from rich.console import Console
from rich.progress import Progress
from rich.table import Table
from rich.text import Text


def table(title: str, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Print a table."""
    result = Table(title=Text(title), title_justify='left')
    for i, column in enumerate(columns):
        result.add_column(Text(column), justify='left' if i == 0 else 'right')
    for row in rows:
        result.add_row(*(Text(str(cell)) for cell in row))
    width = None if sys.stdout.isatty() else 110
    Console(width=width).print(result)


@contextmanager
def progress(title: str, total: int) -> Iterator[Callable[..., None]]:
    """Show a progress bar on standard error; the value is called with what was done (1)."""
    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(title, total=total)
        yield lambda done=1: bar.advance(task, done)
