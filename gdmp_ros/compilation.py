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
from numba.core import config

Function = TypeVar('Function', bound=Callable[..., object])

#: Folders of the package that hold kernels.
KERNEL_FOLDERS = ('manifolds', 'dmp', 'control')


def _fingerprint() -> str:
    digest = hashlib.sha256(numba.__version__.encode())
    package = Path(__file__).parent
    for folder in KERNEL_FOLDERS:
        for path in sorted((package / folder).glob('*.py')):
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


def compiled(function: Function) -> Function:
    """Compile ``function`` on first call, without the GIL, and keep the machine code on disk."""
    settings = vars(config)
    previous = settings['CACHE_DIR']
    settings['CACHE_DIR'] = _CACHE
    try:
        kernel: Any = numba.njit(cache=True, nogil=True, error_model='numpy')(function)
    finally:
        settings['CACHE_DIR'] = previous
    return cast(Function, kernel)


def inlined(function: Function) -> Function:
    """
    Make ``function`` part of every kernel that calls it.

    A kernel is optimised together with all that it calls, again for each kernel on the way: large
    functions that are called from one place compile several times faster as part of their caller.
    """
    part: Any = numba.njit(inline='always', error_model='numpy')(function)
    return cast(Function, part)
