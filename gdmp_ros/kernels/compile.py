"""How kernels are compiled: without the GIL, without exceptions, kept on disk."""
from __future__ import annotations

from collections.abc import Callable
from types import FunctionType
from typing import Any, cast, TypeVar

import numba
from numba.extending import register_jitable

from gdmp_ros.kernels.cache import KernelCache

Function = TypeVar('Function', bound=Callable[..., object])


def kernel(function: Function, **options: Any) -> Function:
    """Compile ``function`` on its first call and keep the machine code on disk."""
    compile_lazily: Any = numba.njit
    compiled = compile_lazily(nogil=True, error_model='numpy', no_cfunc_wrapper=True,
                              **options)(function)
    cache = KernelCache(cast(FunctionType, function))
    compiled._cache = cache  # noqa: SLF001  Numba has no public name for it
    return cast(Function, compiled)


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
