"""Independent tasks on several processes or on a Dask cluster, with one progress bar."""
from __future__ import annotations

from collections.abc import Callable, Sequence
import contextlib
from functools import cache, wraps
import json
from pathlib import Path
from typing import Any, cast, TypeVar

from threadpoolctl import ThreadpoolController

from gdmp_ros.errors import DataError
from gdmp_ros.util.optional_imports import extra, optional_import
from gdmp_ros.util.terminal import progress

Function = TypeVar('Function', bound=Callable[..., object])
#: Time within which a Dask scheduler must answer [s].
CONNECT_S = 10.0


@cache
def _controller() -> ThreadpoolController:
    import scipy.linalg  # noqa: F401  it brings its own library, which is to be found
    return ThreadpoolController()


def one_thread(function: Function) -> Function:
    """
    Let ``function`` use one thread for linear algebra.

    Matrices of a fit are small. Several threads only wait for each other, and on a busy machine
    each wait lasts until the others get a core: learning took thirty times as long.
    """
    @wraps(function)
    def limited(*arguments: object, **options: object) -> object:
        with _controller().limit(limits=1, user_api='blas'):
            return function(*arguments, **options)
    return cast(Function, limited)


class Journal:
    """Results by key, written to disk as soon as they are known."""

    def __init__(self, path: Path | None, subject: str):
        """
        Read the results of an earlier run.

        :param path: None for no file
        :param subject: what the results are about; a journal of another subject is refused
        :raises DataError: if the file is not such a journal
        """
        self._path = path
        self.results: dict[str, Any] = {}
        if path is None:
            return
        if not path.exists():
            path.write_text(json.dumps({'journal': subject}) + '\n')
            return
        lines = path.read_text().splitlines()
        try:
            head = json.loads(lines[0])
        except (ValueError, IndexError):
            head = None
        if head != {'journal': subject}:
            raise DataError(f'{path}: not a journal of {subject}: remove it or name another file')
        for line in lines[1:]:
            # The last line is incomplete if the run was killed while writing it.
            with contextlib.suppress(ValueError):
                key, result = json.loads(line)
                self.results[key] = result

    def keep(self, key: str, result: Any) -> None:
        """Add a result."""
        self.results[key] = result
        if self._path is not None:
            with self._path.open('a') as out:
                out.write(json.dumps([key, result]) + '\n')


def map_tasks(title: str, function: Callable[[Any], Any], tasks: dict[str, Any], jobs: int = 1,
              dask: str | None = None, journal: Journal | None = None) -> dict[str, Any]:
    """
    Apply ``function`` to every task and return the results by key, in the order of the tasks.

    :param function: of one task, importable by name; its results must be plain values
    :param jobs: number of processes; -1 for one per core
    :param dask: address of a Dask scheduler, instead of processes on this machine
    :param journal: tasks with a result in it are skipped
    :raises DataError: if the scheduler cannot be reached
    """
    from joblib import delayed, Parallel
    journal = journal or Journal(None, title)
    left = {key: task for key, task in tasks.items() if key not in journal.results}
    with progress(title, len(tasks)) as step, _cluster(dask):
        for _ in range(len(tasks) - len(left)):
            step()
        options: dict[str, Any] = {'n_jobs': jobs} if dask is None else {}
        worker = Parallel(return_as='generator_unordered', **options)
        for key, result in worker(delayed(_keyed)(function, key, task)
                                  for key, task in left.items()):
            journal.keep(key, result)
            step()
    return {key: journal.results[key] for key in tasks}


def _keyed(function: Callable[[Any], Any], key: str, task: Any) -> tuple[str, Any]:
    return key, function(task)


@contextlib.contextmanager
def _cluster(address: str | None) -> Any:
    if address is None:
        yield
        return
    from joblib import parallel_config
    with optional_import(extra('dask')):
        from distributed import Client
    try:
        client = Client(address, timeout=CONNECT_S)
    except (OSError, ValueError) as error:
        raise DataError(f'no Dask scheduler answers at {address!r}: {error}') from None
    with client, parallel_config(backend='dask', wait_for_workers_timeout=30):
        yield


def scheduler_address(arguments: Sequence[str]) -> str | None:
    """
    Address from the arguments of ``--backend dask ADDRESS``; None without arguments.

    :raises DataError: if it is another backend or has no address
    """
    if not arguments:
        return None
    if len(arguments) != 2 or arguments[0] != 'dask':
        raise DataError(f'--backend is {" ".join(arguments)!r}, expected: dask ADDRESS')
    return arguments[1]
