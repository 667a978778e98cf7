"""Tables and progress bars on the terminal."""
from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
import os
import select
import sys
import termios
import threading
import time
import tty
from typing import Self


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


class Keys:
    """
    Keys from standard input: as they are pressed on a terminal, otherwise one in each line.

    Use it as a context manager: the terminal is as it was afterwards.
    """

    def __enter__(self) -> Self:
        self._input = sys.stdin.fileno()
        self._settings = termios.tcgetattr(self._input) if os.isatty(self._input) else None
        if self._settings is not None:
            tty.setcbreak(self._input, termios.TCSADRAIN)
        return self

    def __exit__(self, *_: object) -> None:
        if self._settings is not None:
            termios.tcsetattr(self._input, termios.TCSADRAIN, self._settings)

    def pressed(self) -> bool:
        """Whether `read` returns at once."""
        return bool(select.select([self._input], [], [], 0.0)[0])

    def read(self) -> str | None:
        """
        Next key, or line without its end; empty for Enter, None at the end of input.

        Nothing is read in advance: `pressed` would not know of it.
        """
        if self._settings is not None:
            key = os.read(self._input, 1).decode(errors='replace')
            return None if key in ('', '\x04') else key.strip('\r\n')
        line = b''
        while not line.endswith(b'\n'):
            part = os.read(self._input, 1)
            if not part:
                return line.decode(errors='replace').strip() if line else None
            line += part
        return line.decode(errors='replace').strip()
