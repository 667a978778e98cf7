"""
How kernels are compiled, where they are kept, and when they are compiled again.

They are compiled without the GIL and without exceptions. Numba stamps a cached function with the
size and time of its own file: an edit of a comment compiles it again, an edit of a function that
it calls in another file does not. Here the stamp is a hash of the function's bytecode, of the
constants it uses, and of every kernel it calls.
"""
from __future__ import annotations

from collections.abc import Callable, Iterator
import contextlib
import dis
import hashlib
import inspect
import math
import os
from pathlib import Path
import shutil
import sys
import tempfile
import time
from types import CodeType, FunctionType
from typing import Any, cast, TypeVar

import numba
from numba.core.caching import (
    _Cache,  # noqa: PLC2701  Numba has no public name for it
    _CacheLocator,  # noqa: PLC2701
    CompileResultCacheImpl,
    FunctionCache,
)
from numba.core.dispatcher import Dispatcher
from numba.extending import register_jitable
import numpy as np

from gdmp_ros.kernels import intrinsics

#: Versions of one kernel that are kept, so that two checkouts do not compile in turns.
_KEPT_VERSIONS = 3
#: A folder of another version of Python or Numba is removed after so many days without a change.
_STALE_DAYS = 60.0

#: Called before a kernel is compiled, with its name, and after; none by default.
_listeners: list[tuple[Callable[[str], None], Callable[[], None]]] = []


def cache_folder() -> Path:
    """Folder of the compiled kernels: ``GDMP_CACHE``, the user's cache, or a temporary folder."""
    folder = _base_folder() / _version()
    if _is_writable(folder):
        return folder
    fallback = Path(tempfile.gettempdir()) / f'gdmp_ros-{os.getuid()}' / folder.name
    fallback.mkdir(parents=True, exist_ok=True)
    return fallback


def _base_folder() -> Path:
    chosen = os.environ.get('GDMP_CACHE')
    home = os.environ.get('XDG_CACHE_HOME') or os.path.expanduser('~/.cache')
    return Path(chosen) if chosen else Path(home) / 'gdmp_ros'


def _version() -> str:
    return f'numba-{numba.__version__}-{sys.implementation.cache_tag}'


def _is_writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(folder, os.W_OK)


def is_warm() -> bool:
    """Whether kernels have been compiled and kept before."""
    return any(cache_folder().glob('*/*.nbi'))


def remove_stale() -> None:
    """Remove kernels of versions of Python or Numba no longer used."""
    oldest = time.time() - 86400.0 * _STALE_DAYS
    for folder in _base_folder().glob('numba-*'):
        if folder.is_dir() and folder.name != _version() and -_age(folder) < oldest:
            shutil.rmtree(folder, ignore_errors=True)


def _age(path: Path) -> float:
    """Time of a file or folder, negative; another process may have removed it meanwhile."""
    try:
        return -path.stat().st_mtime
    except FileNotFoundError:
        return math.inf


@contextlib.contextmanager
def on_compile(started: Callable[[str], None], finished: Callable[[], None]) -> Iterator[None]:
    """
    Observe the compilation of kernels.

    :param started: called with the name of every kernel that is compiled meanwhile
    :param finished: called when it is compiled
    """
    listener = (started, finished)
    _listeners.append(listener)
    try:
        yield
    finally:
        _listeners.remove(listener)


def code_hash(function: FunctionType) -> str:
    """Hash of what a kernel is compiled from; comments, docstrings and lines do not count."""
    digest = hashlib.sha256(_INTRINSICS_HASH)
    _add_function(digest, function, set())
    return digest.hexdigest()[:16]


def _add_function(digest: Any, function: FunctionType, seen: set[int]) -> None:
    if id(function) in seen:
        return
    seen.add(id(function))
    # Functions of a library do not change between two runs.
    own = {_package(function), __name__.partition('.')[0]}
    # The machine code names the module in which a function was compiled.
    digest.update(function.__module__.encode())
    _add_code(digest, function.__code__)
    cells = {name: cell.cell_contents for name, cell
             in zip(function.__code__.co_freevars, function.__closure__ or ())}
    for name in sorted(_global_names(function.__code__)):
        if name in function.__globals__:
            digest.update(name.encode())
            _add_value(digest, function.__globals__[name], seen, own)
    for name, value in cells.items():
        digest.update(name.encode())
        _add_value(digest, value, seen, own)


def _package(function: FunctionType) -> str:
    return function.__module__.partition('.')[0]


def _add_code(digest: Any, code: CodeType) -> None:
    digest.update(code.co_code)
    digest.update(repr((code.co_names, code.co_varnames, code.co_freevars)).encode())
    # The first constant of a function is its docstring or None; <lambda>, <listcomp> have none.
    is_function = bool(code.co_flags & inspect.CO_NEWLOCALS) and code.co_name[0] != '<'
    for constant in code.co_consts[1:] if is_function else code.co_consts:
        if isinstance(constant, CodeType):
            _add_code(digest, constant)
        else:
            digest.update(repr(constant).encode())


def _global_names(code: CodeType) -> set[str]:
    names = {instruction.argval for instruction in dis.get_instructions(code)
             if instruction.opname in ('LOAD_GLOBAL', 'LOAD_NAME')}
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            names |= _global_names(constant)
    return names


def _add_value(digest: Any, value: Any, seen: set[int], own: set[str]) -> None:
    """Add the value of a global that a kernel uses: another kernel, a constant, a type."""
    if isinstance(value, Dispatcher):
        _add_function(digest, value.py_func, seen)
    elif isinstance(value, FunctionType) and _package(value) in own:
        _add_function(digest, value, seen)
    elif isinstance(value, np.ndarray):
        digest.update(str(value.dtype).encode() + value.tobytes())
    elif isinstance(value, (bool, int, float, str, tuple, frozenset, np.dtype)):
        digest.update(repr(value).encode())
    elif isinstance(value, type):
        digest.update(f'{value.__name__}{getattr(value, "_fields", "")}'.encode())
    else:  # a module or a function of a library, or an intrinsic
        digest.update(getattr(value, '__name__', type(value).__name__).encode())


def _intrinsics_hash() -> bytes:
    digest = hashlib.sha256()
    _add_code(digest, compile(inspect.getsource(intrinsics), 'intrinsics', 'exec'))
    return digest.digest()


_INTRINSICS_HASH = _intrinsics_hash()


class _Locator(_CacheLocator):
    """One folder per module, one file per kernel and hash."""

    def __init__(self, function: FunctionType):
        self._module = function.__module__
        self._stamp = code_hash(function)

    @classmethod
    def from_function(cls, py_func: FunctionType, py_file: str) -> _Locator:
        return cls(py_func)

    def get_cache_path(self) -> str:
        return str(cache_folder() / self._module)

    def get_source_stamp(self) -> str:
        return self._stamp

    def get_disambiguator(self) -> str:
        return self._stamp


class _Implementation(CompileResultCacheImpl):
    _locator_classes: list[Any] = [_Locator]


class _FileCache(FunctionCache):
    _impl_class = _Implementation


class KernelCache(_Cache):
    """
    Cache of one kernel, opened when the kernel is first called.

    Only then are all functions that it calls defined.
    """

    def __init__(self, function: FunctionType):
        self._function = function
        self._opened: _FileCache | None = None

    @property
    def _files(self) -> _FileCache:
        if self._opened is None:
            self._opened = _FileCache(self._function)
        return self._opened

    @property
    def cache_path(self) -> str:
        return str(self._files.cache_path)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        try:
            result = self._files.load_overload(sig, target_context)
        except (AttributeError, ImportError):
            # Of a version in which the type of an argument was in another module.
            self._files.flush()
            result = None
        if result is None:
            module = self._function.__module__.removeprefix('gdmp_ros.')
            for started, _ in _listeners:
                started(f'{module}.{self._function.__name__}')
        return result

    def save_overload(self, sig: Any, data: Any) -> None:
        self._files.save_overload(sig, data)
        self._remove_older()
        for _, finished in _listeners:
            finished()

    def _remove_older(self) -> None:
        """Keep the newest versions of this kernel only."""
        module = self._function.__module__.rpartition('.')[2]
        pattern = f'{module}.{self._function.__qualname__}-*'
        files = sorted(Path(self.cache_path).glob(f'{pattern}.nbi'), key=_age)
        for index in files[_KEPT_VERSIONS:]:
            for path in index.parent.glob(f'{index.stem}*'):
                path.unlink(missing_ok=True)

    def enable(self) -> None:
        self._files.enable()

    def disable(self) -> None:
        self._files.disable()

    def flush(self) -> None:
        self._files.flush()


Function = TypeVar('Function', bound=Callable[..., object])


def kernel(function: Function, **options: Any) -> Function:
    """
    Compile ``function`` on its first call and keep the machine code on disk.

    Arrays are not counted in it: it neither makes nor returns one (`allocating`). Otherwise each
    view would be counted with two calls, more than a 3×3 product costs.
    """
    compile_lazily: Any = numba.njit
    counted = {'_nrt': False, **options}
    compiled = compile_lazily(nogil=True, error_model='numpy', no_cfunc_wrapper=True,
                              **counted)(function)
    cache = KernelCache(cast(FunctionType, function))
    compiled._cache = cache  # noqa: SLF001  Numba has no public name for it
    return cast(Function, compiled)


def allocating(function: Function) -> Function:
    """
    Compile ``function`` as `kernel` does; it may make and return arrays.

    Only such functions may use the arrays that it returns.
    """
    return kernel(function, _nrt=True)


def always_inline(function: Function) -> Function:
    """
    Compile ``function`` as `kernel` does, and copy its machine code into that of its callers.

    For short functions: a call with array arguments costs 20 ns.
    """
    return kernel(function, forceinline=True)


def inlined(function: Function) -> Function:
    """
    Make ``function`` part of every kernel that calls it, before it is typed and optimised.

    A kernel is optimised together with all that it calls, once more for each kernel above it: a
    large function with one caller compiles several times faster as part of that caller.
    """
    compile_lazily: Any = numba.njit
    return cast(Function, compile_lazily(inline='always', error_model='numpy')(function))


def jitable(function: Function) -> Function:
    """Let kernels call ``function`` too; called from Python it is not compiled."""
    register: Any = register_jitable
    return cast(Function, register(function))
