"""Child processes that end with their parent, and what Ctrl-C and SIGTERM do to this one."""
from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
import signal
import subprocess
import sys
import threading
from types import FrameType
from typing import Any

from gdmp_ros.errors import GdmpError
from gdmp_ros.util.child_process import command as child_command

#: Whether Ctrl-C is held back at present, and whether it has come meanwhile.
_held, _came = threading.Event(), threading.Event()
#: After this time a signal is sent again whose exception was dropped.
_AGAIN_S = 0.05


class Interrupt(KeyboardInterrupt):
    """
    Ctrl-C, or SIGTERM.

    If a KeyboardInterrupt itself leaves the execution of a text, as modules do it when they are
    imported, CPython ends the process by the signal, although it is handled later.
    """

    def __init__(self, number: int = signal.SIGINT) -> None:
        """:param number: of the signal"""
        super().__init__()
        self.number = number


def interrupt_on_sigterm() -> None:
    """Make SIGTERM raise Interrupt, as Ctrl-C does, so that everything is cleaned up."""
    def interrupt(number: int, _: FrameType | None) -> None:
        raise Interrupt(number)
    sys.unraisablehook = partial(_send_again, sys.unraisablehook)
    signal.signal(signal.SIGTERM, interrupt)


def _send_again(others: Callable[[Any], object], dropped: Any) -> None:
    """Send the signal again if CPython dropped its exception: finalizers cannot raise one."""
    if isinstance(dropped.exc_value, Interrupt):
        timer = threading.Timer(_AGAIN_S, signal.pthread_kill,
                                (threading.main_thread().ident, dropped.exc_value.number))
        timer.daemon = True
        timer.start()
    else:
        others(dropped)


def stop_event() -> threading.Event:
    """Event that SIGINT and SIGTERM set from now on instead of ending this process."""
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    return stop


@contextmanager
def held_interrupts() -> Iterator[None]:
    """
    Let Ctrl-C raise Interrupt at the end of this short piece of work, not inside of it.

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
            raise Interrupt


@contextmanager
def noted_interrupts() -> Iterator[threading.Event]:
    """Set an event when Ctrl-C raises KeyboardInterrupt."""
    noted = threading.Event()

    def interrupt(number: int, _: FrameType | None) -> None:
        noted.set()
        if not _held.is_set():
            raise Interrupt(number)
        _came.set()

    # Another handler, or none in a background job, is left as it is.
    before = signal.getsignal(signal.SIGINT)
    replaced = (threading.current_thread() is threading.main_thread()
                and before in (signal.default_int_handler, signal.SIG_DFL))
    hook = sys.unraisablehook
    if replaced:
        signal.signal(signal.SIGINT, interrupt)
        sys.unraisablehook = partial(_send_again, hook)
    try:
        yield noted
    finally:
        if replaced:
            signal.signal(signal.SIGINT, before)
            sys.unraisablehook = hook


class ChildProcesses:
    """Processes that run Python modules; leaving the context ends them all."""

    def __init__(self, environment: Mapping[str, str], logs: Path):
        """:param logs: folder for one log file per process"""
        self._environment = dict(environment)
        self._logs = logs
        logs.mkdir(parents=True, exist_ok=True)
        self.processes: dict[str, subprocess.Popen[bytes]] = {}

    def __enter__(self) -> ChildProcesses:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop_all()

    def start(self, name: str, module: str, arguments: Sequence[str] = (),
              prefix: Sequence[str] = (), environment: Mapping[str, str] | None = None) -> None:
        """
        Start ``python -m module`` under a name (see `gdmp_ros.util.child_process`).

        :param prefix: command that executes the rest of the line, such as ``nsenter``
        :param environment: added to the environment of all processes
        """
        with self.log(name).open('ab') as out:
            self.processes[name] = subprocess.Popen(
                [*prefix, *child_command(module, *arguments)],
                env={**self._environment, **(environment or {})}, stdout=out,
                stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL)

    def start_node(self, name: str, module: str, parameters: Mapping[str, object],
                   extra: Sequence[str] = (), prefix: Sequence[str] = (),
                   environment: Mapping[str, str] | None = None) -> None:
        """Start a ROS node with parameters."""
        self.start(name, module, ros_arguments(parameters, extra), prefix, environment)

    def stop(self, name: str, timeout: float = 10.0) -> int:
        """Send SIGTERM, after ``timeout`` seconds SIGKILL; return the exit code."""
        process = self.processes.pop(name)
        if process.poll() is None:
            process.send_signal(signal.SIGTERM)
            try:
                process.wait(timeout)
            except subprocess.TimeoutExpired:
                process.kill()
        return process.wait()

    def stop_all(self) -> None:
        """Stop all processes, the newest first."""
        for name in reversed(list(self.processes)):
            self.stop(name)

    def kill(self, name: str) -> None:
        """End a process with SIGKILL."""
        process = self.processes.pop(name)
        process.kill()
        process.wait()

    def check(self, may_end: Collection[str] = ()) -> None:
        """
        Check that all processes run.

        :param may_end: names of processes that may end
        :raises GdmpError: if a process has ended; with the end of its log
        """
        for name, process in self.processes.items():
            if name not in may_end and process.poll() is not None:
                tail = '\n  '.join(self.log(name).read_text(errors='replace').splitlines()[-6:])
                raise GdmpError(f'{name} ended with code {process.returncode}; the end of its '
                                f'log:\n  {tail}')

    def log(self, name: str) -> Path:
        """File with the output of a process."""
        return self._logs / f'{name}.log'


def ros_arguments(parameters: Mapping[str, object], extra: Sequence[str] = ()) -> list[str]:
    """Arguments of a ROS node: parameters, and ``extra`` after ``--ros-args``."""
    words = ['--ros-args']
    for name, value in parameters.items():
        words += ['-p', f'{name}:={_yaml(value)}']
    return [*words, *extra]


def _yaml(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f"'{value}'"
    if isinstance(value, (list, tuple)):
        return f'[{", ".join(_yaml(item) for item in value)}]'
    return repr(value)


def thread_names() -> dict[int, str]:
    """Names of the threads of this process, by their number in the system."""
    names = {}
    for task in Path('/proc/self/task').iterdir():
        with suppress(OSError):  # it may end meanwhile
            names[int(task.name)] = (task / 'comm').read_text().strip()
    return names
