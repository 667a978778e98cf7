"""What Ctrl-C and SIGTERM do to this process."""
from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
import signal
import threading


def interrupt_on_sigterm() -> None:
    """Make SIGTERM raise KeyboardInterrupt, as Ctrl-C does, so that everything is cleaned up."""
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt
    signal.signal(signal.SIGTERM, interrupt)


def stop_event() -> threading.Event:
    """Event that SIGINT and SIGTERM set from now on instead of ending this process."""
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    return stop


@contextmanager
def noted_interrupts() -> Iterator[threading.Event]:
    """
    Set an event when Ctrl-C raises KeyboardInterrupt.

    Compiled code, such as that of rclpy, turns a KeyboardInterrupt into other exceptions.
    """
    noted = threading.Event()

    def interrupt(*_: object) -> None:
        noted.set()
        raise KeyboardInterrupt

    # Another handler, or none in a background job, is left as it is.
    before = signal.getsignal(signal.SIGINT)
    replaced = (threading.current_thread() is threading.main_thread()
                and before in (signal.default_int_handler, signal.SIG_DFL))
    if replaced:
        signal.signal(signal.SIGINT, interrupt)
    try:
        yield noted
    finally:
        if replaced:
            signal.signal(signal.SIGINT, before)
