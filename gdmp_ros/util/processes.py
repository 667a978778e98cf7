"""Child processes that never outlive their parent."""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
import signal
import subprocess
import threading

from gdmp_ros.errors import GdmpError
from gdmp_ros.util import child_process as child


def interrupt_on_sigterm() -> None:
    """Make SIGTERM end this process as Ctrl-C does: what it has begun is cleared away."""
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt
    signal.signal(signal.SIGTERM, interrupt)


def ended_by_signal() -> threading.Event:
    """Event that SIGINT and SIGTERM set from now on, in place of ending this process."""
    ended = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ended.set())
    return ended


class Children:
    """Processes of Python modules; leaving the context ends them all."""

    def __init__(self, environment: Mapping[str, str], logs: Path):
        """:param logs: folder for one log file per process"""
        self._environment = dict(environment)
        self._logs = logs
        logs.mkdir(parents=True, exist_ok=True)
        self.processes: dict[str, subprocess.Popen[bytes]] = {}

    def __enter__(self) -> Children:
        return self

    def __exit__(self, *_: object) -> None:
        for name in list(self.processes):
            self.stop(name)

    def start(self, name: str, module: str, arguments: Sequence[str] = (),
              prefix: Sequence[str] = (), environment: Mapping[str, str] | None = None) -> None:
        """
        Start ``python -m module`` under a name (see `gdmp_ros.util.child_process`).

        :param prefix: command that becomes it (exec), as ``nsenter`` does
        :param environment: added to that of all
        """
        with self.log(name).open('ab') as out:
            self.processes[name] = subprocess.Popen(
                [*prefix, *child.command(module, *arguments)],
                env={**self._environment, **(environment or {})}, stdout=out,
                stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL)

    def start_node(self, name: str, module: str, parameters: Mapping[str, object],
                   extra: Sequence[str] = (), prefix: Sequence[str] = (),
                   environment: Mapping[str, str] | None = None) -> None:
        """Start a ROS node with parameters."""
        words = ['--ros-args']
        for key, value in parameters.items():
            words += ['-p', f'{key}:={_yaml(value)}']
        self.start(name, module, [*words, *extra], prefix, environment)

    def stop(self, name: str, timeout: float = 10.0) -> int:
        """Ask a process to end, and end it if it does not; its exit code."""
        process = self.processes.pop(name)
        if process.poll() is None:
            process.send_signal(signal.SIGTERM)
            try:
                process.wait(timeout)
            except subprocess.TimeoutExpired:
                process.kill()
        return process.wait()

    def kill(self, name: str) -> None:
        """End a process without giving it a chance (SIGKILL)."""
        process = self.processes.pop(name)
        process.kill()
        process.wait()

    def check(self, but: str = '') -> None:
        """
        Look after all processes.

        :param but: the name of one that may end
        :raises GdmpError: if a process has ended by itself; with the end of its log
        """
        for name, process in self.processes.items():
            if name != but and process.poll() is not None:
                tail = '\n  '.join(self.log(name).read_text(errors='replace').splitlines()[-6:])
                raise GdmpError(f'{name} ended with code {process.returncode}; its last words:\n'
                                f'  {tail}')

    def log(self, name: str) -> Path:
        """Where a process's output goes."""
        return self._logs / f'{name}.log'


def _yaml(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f"'{value}'"
    if isinstance(value, (list, tuple)):
        return f'[{", ".join(_yaml(item) for item in value)}]'
    return repr(value)
