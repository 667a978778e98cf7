"""Threads of the linear algebra library."""
from __future__ import annotations

from collections.abc import Callable
from functools import cache, wraps
from typing import cast, TypeVar

from threadpoolctl import ThreadpoolController

Function = TypeVar('Function', bound=Callable[..., object])


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
