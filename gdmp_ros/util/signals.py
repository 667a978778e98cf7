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


#: Whether Ctrl-C is held back at present, and whether it has come meanwhile.
_held, _came = threading.Event(), threading.Event()


@contextmanager
def held_interrupts() -> Iterator[None]:
    """
    Let Ctrl-C raise KeyboardInterrupt at the end of this short piece of work, not inside of it.

    Compiled code, such as that of rclpy, turns a KeyboardInterrupt into other exceptions, or drops
    it. Acts inside of `noted_interrupts`, in the main thread.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    _held.set()
    try:
        yield
    finally:
        _held.clear()
        if _came.is_set():
            _came.clear()
            raise KeyboardInterrupt


@contextmanager
def noted_interrupts() -> Iterator[threading.Event]:
    """Set an event when Ctrl-C raises KeyboardInterrupt."""
    noted = threading.Event()

    def interrupt(*_: object) -> None:
        noted.set()
        if not _held.is_set():
            raise KeyboardInterrupt
        _came.set()

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
