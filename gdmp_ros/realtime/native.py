"""Clocks, sleep and deadlines of compiled loops, by addresses of functions of the C library."""
from __future__ import annotations

import ctypes
import functools

import numpy as np

from gdmp_ros.kernels import ask_c, kernel

_CLOCK, _SLEEP = range(2)
_REALTIME, _MONOTONIC, _ABSOLUTE = 0, 1, 1
_NS = 1_000_000_000
#: Numbers of the deadlines of a loop, integers: period; deadline of the next tick, 0 before the
#: first wait; that of the last tick, 0 before the first; ticks that are left of this deadline;
#: time of day of the deadline [ns].
PERIOD, DEADLINE, LAST, LEFT, STAMP, PACE_SIZE = range(6)
#: Numbers of a `gdmp_ros.realtime.statistics.LatenessRecorder` before those of the ticks.
_BEGIN = 3


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


@kernel
def wait(pace, clocks, spec, lateness):
    """
    Wait for the next deadline, and find out how many ticks are to be made for it.

    The grid is that of `gdmp_ros.realtime.loop.periodic`.

    :param pace: see `PERIOD`
    :param clocks: see `clock_functions`
    :param lateness: see `gdmp_ros.realtime.statistics.LatenessRecorder.numbers`
    """
    period, now = pace[PERIOD], steady_ns(clocks, spec)
    if pace[DEADLINE] == 0:
        pace[DEADLINE] = now
    pace[DEADLINE] += period * (1 + max((now - pace[DEADLINE]) // period, 0))
    sleep_until(clocks, spec, pace[DEADLINE])
    now = steady_ns(clocks, spec)
    pace[LEFT] = (pace[DEADLINE] - pace[LAST]) // period if pace[LAST] != 0 else 1
    pace[LAST] = pace[DEADLINE]
    pace[STAMP] = wall_ns(clocks, spec) - (now - pace[DEADLINE])
    slot = _BEGIN + 2 * (lateness[0] % ((lateness.size - _BEGIN) // 2))
    lateness[0], lateness[1] = lateness[0] + 1, lateness[1] + pace[LEFT] - 1
    lateness[2] = lateness[slot] = pace[DEADLINE]
    lateness[slot + 1] = now - pace[DEADLINE]
