"""Runs nodes in a process until Ctrl-C, one or several: callbacks and reports."""
from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
import os
from pathlib import Path
import signal
import sys
import threading

from ament_index_python.packages import get_package_share_directory
import rclpy
from rclpy.signals import SignalHandlerOptions

from gdmp_ros.errors import GdmpError
from gdmp_ros.realtime.loop import NS, periodic, raised_priority
from gdmp_ros.realtime.loop import run as run_loop
from gdmp_ros.ros.dds import CallbackExecutor, current
from gdmp_ros.ros.lifecycle import ManagedNode, REPORT_S
from gdmp_ros.util.dds_network import default_environment, unasked_restriction
from gdmp_ros.util.processes import stop_event

#: Longest time to finish the configuration when a process is to end [s]; ``launch`` sends the next
#: signal after 5 s.
PATIENCE_S = 2.0


class _Spinner:
    """
    Runs nodes in one thread and makes their reports in another, never both at once.

    Transitions and callbacks are in one thread, because some files may only be used by the thread
    that opened them. Reports have no timers: an executor waits anew for all entities of a node
    after each timer, which takes longer than most reports.

    :ivar failed: whether a node could not configure or activate itself at the start
    """

    def __init__(self, nodes: Sequence[ManagedNode]):
        self._nodes, self._clock = nodes, current().clock
        self.failed = False
        self._busy = threading.Lock()
        self._executor = CallbackExecutor(nodes)
        # The first node has been configured; the thread is to end.
        self._configured, self._ending = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._run, name='callbacks', daemon=True)

    def spin(self, stop: threading.Event) -> None:
        """
        Start the nodes, execute callbacks and reports, and take them down.

        It ends at ``stop``, when all nodes have been shut down, or if one cannot start.
        """
        self._thread.start()
        try:
            # The thread ends if the context is shut down.
            run_loop(periodic(lambda *_: self._report(), round(REPORT_S * NS), self._clock),
                     self._clock, lambda: (
                         stop.is_set() or self.failed or not self._thread.is_alive()
                         or all(node.shut_down for node in self._nodes)))
        finally:
            # The thread ends first: the executor cannot be shut down while it waits.
            self._ending.set()
            self._executor.wake()
            if not self._configured.wait(PATIENCE_S):
                # It may take minutes. No node is active that would have to be taken down.
                print('ended while it was being configured', file=sys.stderr, flush=True)
                os._exit(0)
            self._thread.join()
            self._executor.close()

    def _report(self) -> None:
        for node in self._nodes:
            # Not for ever: while nodes are configured, Ctrl-C must be seen.
            if self._busy.acquire(timeout=REPORT_S):
                try:
                    with raised_priority():
                        _attempt(node, node.report)
                finally:
                    self._busy.release()

    def _run(self) -> None:
        try:
            with self._busy:
                for node in self._nodes:
                    if node.get_parameter('autostart').value and not self._ending.is_set():
                        self.failed |= not node.autostart()
                    self._configured.set()
            while True:
                _attempt(self._nodes[0], self._execute_next)
        except CallbackExecutor.ENDED:
            pass
        finally:
            self._configured.set()
            with self._busy:
                for node in self._nodes:
                    node.take_down()

    def _execute_next(self) -> None:
        with raised_priority():
            call = self._executor.next(self._ending.is_set)
            with self._busy:
                call()


def _attempt(node: ManagedNode, action: Callable[[], None]) -> None:
    """Run callbacks; an exception does not end the node."""
    try:
        action()
    except CallbackExecutor.ENDED:
        raise
    except Exception as error:  # rclpy itself fails too, for example on a negative /clock
        node.get_logger().error(f'a callback failed: {type(error).__name__}: {error}',
                                throttle_duration_sec=1.0)


def own_arguments(arguments: Sequence[str] | None = None) -> list[str]:
    """Arguments of the command line (or those given) before ``--ros-args``."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    return words[:words.index('--ros-args')] if '--ros-args' in words else words


def with_parameter_files(words: Sequence[str]) -> list[str]:
    """
    Arguments in which each parameter file is a path that exists.

    ``config/…`` that is not in the present folder is that of the package.

    :raises GdmpError: if there is no such file
    """
    result = list(words)
    for i, word in enumerate(words[:-1]):
        if word != '--params-file' or os.path.isfile(words[i + 1]):
            continue
        folders = [Path(__file__).parents[2]]
        with suppress(LookupError, OSError):
            folders.append(Path(get_package_share_directory('gdmp_ros')))
        paths = [folder / words[i + 1] for folder in folders]
        existing = [path for path in paths if path.is_file()]
        if not existing:
            raise GdmpError(f'{words[i + 1]}: no such parameter file, neither here nor in '
                            f'{" or ".join(map(str, folders))}')
        result[i + 1] = str(existing[0])
    return result


def run(makes: Sequence[Callable[[], ManagedNode]], arguments: Sequence[str] | None = None) -> int:
    """
    Run nodes until Ctrl-C or SIGTERM, then deactivate them.

    Which machines reach them: `gdmp_ros.util.dds_network.default_environment`.

    :returns: exit code
    """
    restriction = unasked_restriction()
    os.environ.update(default_environment())
    words = list(sys.argv if arguments is None else arguments)
    try:
        rclpy.init(args=with_parameter_files(words),
                   signal_handler_options=SignalHandlerOptions.NO)
    except (GdmpError, RuntimeError) as error:
        print(f'error: {error}', file=sys.stderr)
        return 2
    stop = stop_event()
    try:
        nodes = [make() for make in makes]
    except (GdmpError, ValueError) as error:
        print(f'error: {error}', file=sys.stderr)
        rclpy.shutdown()
        return 2
    if restriction:
        nodes[0].get_logger().info(restriction)
    spinner = _Spinner(nodes)
    try:
        spinner.spin(stop)
    finally:
        for node in nodes:
            node.destroy_node()
        rclpy.shutdown()
        # Another Ctrl-C while the interpreter ends would print a traceback.
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)
    return 1 if spinner.failed else 0


