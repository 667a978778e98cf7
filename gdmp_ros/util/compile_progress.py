"""Reports the compilation of kernels, which takes up to a minute once and is silent otherwise."""
from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import sys
import time

from gdmp_ros.kernels import on_compile

#: Time between two reports [s].
EVERY_S = 2.0


def _print(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


@contextmanager
def compilation_reported(report: Callable[[str], None] = _print) -> Iterator[None]:
    """
    Report kernels that are compiled meanwhile, at the first one and then every two seconds.

    :param report: takes a line of text
    """
    begun: list[float] = []
    last = [-EVERY_S]

    def listen(name: str) -> None:
        now = time.monotonic()
        if not begun:
            begun.append(now)
            report('compiling the kernels, once: this takes up to a minute')
            last[0] = now
        elif now - last[0] >= EVERY_S:
            report(f'compiling the kernels: {name} ({now - begun[0]:.0f} s)')
            last[0] = now
    with on_compile(listen):
        yield
    if begun and time.monotonic() - begun[0] > EVERY_S:
        report(f'kernels compiled in {time.monotonic() - begun[0]:.0f} s')
