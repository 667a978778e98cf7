"""Clocks and sleep for compiled loops, by the addresses of the functions of the C library."""
from __future__ import annotations

import ctypes
import functools

import numpy as np

from gdmp_ros.kernels import ask_c, kernel

_CLOCK, _SLEEP = range(2)
_REALTIME, _MONOTONIC, _ABSOLUTE = 0, 1, 1
_NS = 1_000_000_000


@functools.cache
def clock_functions() -> np.ndarray:
    """Addresses of the functions that the kernels call."""
    library = ctypes.CDLL(None)
    return np.array([ctypes.cast(getattr(library, name), ctypes.c_void_p).value or 0
                     for name in ('clock_gettime', 'clock_nanosleep')])


@kernel
def steady_ns(functions, spec):
    """
    Steady time [ns].

    :param functions: see `clock_functions`
    :param spec: two integers, overwritten
    """
    ask_c(functions[_CLOCK], (np.int32(_MONOTONIC), spec))
    return spec[0] * _NS + spec[1]


@kernel
def wall_ns(functions, spec):
    """Time of day [ns since 1970]; see `steady_ns`."""
    ask_c(functions[_CLOCK], (np.int32(_REALTIME), spec))
    return spec[0] * _NS + spec[1]


@kernel
def sleep_until(functions, spec, deadline):
    """Sleep until a steady time [ns]; return at once if it has passed."""
    spec[0], spec[1] = deadline // _NS, deadline % _NS
    ask_c(functions[_SLEEP], (np.int32(_MONOTONIC), np.int32(_ABSOLUTE), spec, np.int64(0)))
