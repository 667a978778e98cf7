"""
The one place that talks to Numba: how kernels are compiled and where they are kept.

Numba stamps a cached function with its own source file only, so an edit to a kernel that it calls
in another file would go unnoticed. The cache folder is therefore named by a hash over Numba's
version and the source of every kernel: after any edit a new folder is used.
"""
from __future__ import annotations

from collections.abc import Callable
import hashlib
import os
from pathlib import Path
import tempfile
from typing import Any, cast, TypeVar

import numba
from numba.core import cgutils, config, types
from numba.extending import intrinsic, overload
from numba.np import arrayobj

Function = TypeVar('Function', bound=Callable[..., object])

#: Where kernels, and the constants they are compiled with, are kept.
KERNEL_SOURCES = ('compilation.py', 'manifolds/*.py', 'dmp/*.py', 'control/*.py',
                  'paper/baselines/*.py')


def _fingerprint() -> str:
    digest = hashlib.sha256(numba.__version__.encode())
    package = Path(__file__).parent
    for pattern in KERNEL_SOURCES:
        for path in sorted(package.glob(pattern)):
            digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def _writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(folder, os.W_OK)


def cache_folder() -> Path:
    """Folder of the compiled kernels: ``GDMP_CACHE``, the user's cache, or a temporary folder."""
    base = os.environ.get('GDMP_CACHE')
    home = os.environ.get('XDG_CACHE_HOME') or os.path.expanduser('~/.cache')
    folder = (Path(base) if base else Path(home) / 'gdmp_ros') / _fingerprint()
    if _writable(folder):
        return folder
    fallback = Path(tempfile.gettempdir()) / f'gdmp_ros-{os.getuid()}' / folder.name
    fallback.mkdir(parents=True, exist_ok=True)
    return fallback


_CACHE = str(cache_folder())


def compiled_before() -> bool:
    """Whether kernels have been compiled and kept before."""
    return any(Path(_CACHE).glob('*/*.nbi'))


def compiled(function: Function, forceinline: bool = False) -> Function:
    """Compile ``function`` on first call, without the GIL, and keep the machine code on disk."""
    settings = vars(config)
    previous = settings['CACHE_DIR']
    settings['CACHE_DIR'] = _CACHE
    try:
        kernel: Any = numba.njit(cache=True, nogil=True, error_model='numpy',
                                 forceinline=forceinline)(function)
    finally:
        settings['CACHE_DIR'] = previous
    return cast(Function, kernel)


def merged(function: Function) -> Function:
    """
    Compile ``function`` as `compiled` does, and merge its machine code into that of its callers.

    For functions that choose between short tasks: where the choice is known when the caller is
    compiled only the one task is left, and the call, 20 ns with its arrays, is saved.
    """
    return compiled(function, forceinline=True)


def inlined(function: Function) -> Function:
    """
    Make ``function`` part of every kernel that calls it.

    A kernel is optimised together with all that it calls, again for each kernel on the way: large
    functions that are called from one place compile several times faster as part of their caller.
    """
    part: Any = numba.njit(inline='always', error_model='numpy')(function)
    return cast(Function, part)


@intrinsic
def kept_apart(typing_context):  # type: ignore[no-untyped-def]
    """
    Said at the beginning of a large kernel: keep it out of its callers' machine code.

    Otherwise it may be copied into, and optimised anew in, every kernel above it, the more as
    `merged` passes on to what is first compiled for it: minutes instead of half a minute.
    """
    def build(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        builder.function.attributes.discard('alwaysinline')
        builder.function.attributes.add('noinline')
        return context.get_dummy_value()

    return types.none(), build


def matrix_of(array, at, rows, columns):  # type: ignore[no-untyped-def]
    """
    View ``rows × columns`` numbers of a flat array from ``at`` on as a matrix.

    In kernels the view has no checks and no reference count (`borrowed`).
    """
    return array[at:at + rows * columns].reshape(rows, columns)


def borrowed(array):  # type: ignore[no-untyped-def]
    """
    Give the same array without its reference count, for kernels that cut it into many pieces.

    Counting costs two locked instructions for every piece, more than a 3×3 product. The caller of
    the kernel holds the array for as long as the kernel runs.
    """
    return array


@intrinsic
def _matrix_of(typing_context, array, at, rows, columns):  # type: ignore[no-untyped-def]
    made_type = types.Array(array.dtype, 2, 'C')

    def build(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        flat = context.make_array(array)(context, builder, arguments[0])
        made = context.make_array(made_type)(context, builder)
        _, at, rows, columns = arguments
        arrayobj.populate_array(
            made, data=builder.gep(flat.data, [at]), shape=[rows, columns],
            strides=[builder.mul(columns, flat.itemsize), flat.itemsize],
            itemsize=flat.itemsize, meminfo=None)
        return made._getvalue()

    return made_type(array, types.intp, types.intp, types.intp), build


@intrinsic
def _borrowed(typing_context, array):  # type: ignore[no-untyped-def]
    def build(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        made = context.make_array(array)(context, builder, arguments[0])
        made.meminfo = cgutils.get_null_value(made.meminfo.type)
        made.parent = cgutils.get_null_value(made.parent.type)
        return made._getvalue()

    return array(array), build


@overload(matrix_of, inline='always')
def _overload_matrix_of(array, at, rows, columns):  # type: ignore[no-untyped-def]
    return lambda array, at, rows, columns: _matrix_of(array, at, rows, columns)


@overload(borrowed, inline='always')
def _overload_borrowed(array):  # type: ignore[no-untyped-def]
    return lambda array: _borrowed(array)
