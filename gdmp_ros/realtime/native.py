"""Clocks, sleep and deadlines of compiled loops, by addresses of functions of the C library."""
from __future__ import annotations

from collections.abc import Callable
import ctypes
import functools
from typing import TypeVar

import numpy as np

from gdmp_ros.errors import DataError
from gdmp_ros.kernels import ask_c, kernel
from gdmp_ros.realtime.loop import NS
from gdmp_ros.realtime.statistics import BEGIN

_CLOCK, _SLEEP = range(2)
_POST, _WAIT = range(2)
_REALTIME, _MONOTONIC, _THREAD, _ABSOLUTE = 0, 1, 3, 1
#: Size of a ``sem_t`` [B].
_SEMAPHORE_SIZE = 32
#: Numbers of a compiled loop, integers: period; deadline of the next tick, 0 before the first
#: wait; ticks that are left of this deadline; time of day of the deadline [ns]; whether Python is
#: needed. Those of its own follow.
PERIOD, DEADLINE, LEFT, STAMP, ATTENTION, OWN = range(6)


def addresses(library: ctypes.CDLL, *names: str) -> np.ndarray:
    """
    Addresses of functions of a library.

    :raises AttributeError: if it has not one of them
    """
    return np.array([ctypes.cast(getattr(library, name), ctypes.c_void_p).value or 0
                     for name in names])


@functools.cache
def clock_functions() -> np.ndarray:
    """Addresses of the functions that the kernels call."""
    return addresses(ctypes.CDLL(None), 'clock_gettime', 'clock_nanosleep')


@kernel
def steady_ns(functions, spec):
    """
    Steady time [ns].

    :param functions: see `clock_functions`
    :param spec: two integers, overwritten
    """
    ask_c(functions[_CLOCK], (np.int32(_MONOTONIC), spec))
    return spec[0] * NS + spec[1]


@kernel
def wall_ns(functions, spec):
    """Time of day [ns since 1970]; see `steady_ns`."""
    ask_c(functions[_CLOCK], (np.int32(_REALTIME), spec))
    return spec[0] * NS + spec[1]


@kernel
def thread_cpu_ns(functions, spec):
    """CPU time of the calling thread [ns]; see `steady_ns`."""
    ask_c(functions[_CLOCK], (np.int32(_THREAD), spec))
    return spec[0] * NS + spec[1]


@functools.cache
def semaphore_functions() -> np.ndarray:
    """Addresses of the functions of semaphores that the kernels call."""
    return addresses(ctypes.CDLL(None), 'sem_post', 'sem_clockwait')


def post_address() -> int:
    """Address of the function that posts the semaphore of which it gets the memory."""
    return int(semaphore_functions()[_POST])


def semaphore() -> np.ndarray:
    """Return the memory of a new semaphore, with nothing posted."""
    memory = np.zeros(_SEMAPHORE_SIZE // 8, dtype=np.int64)
    ctypes.CDLL(None).sem_init(ctypes.c_void_p(memory.ctypes.data), 0, 0)
    return memory


@kernel
def post(functions, memory):
    """
    Wake the thread that waits for a semaphore; what was written before is seen there.

    :param functions: see `semaphore_functions`
    :param memory: see `semaphore`
    """
    ask_c(functions[_POST], (memory,))


@kernel
def wait_for_post(functions, memory, spec, deadline):
    """
    Wait for a semaphore; see `post`.

    :param spec: two integers, overwritten
    :param deadline: steady time at which waiting ends [ns]
    :returns: whether it was posted
    """
    spec[0], spec[1] = deadline // NS, deadline % NS
    return ask_c(functions[_WAIT], (memory, np.int32(_MONOTONIC), spec)) == 0


@kernel
def note(lateness, deadline, late, missed):
    """
    Add a tick to a `gdmp_ros.realtime.statistics.LatenessRecorder`.

    :param lateness: its `numbers`
    :param late: time after the deadline [ns]
    :param missed: ticks that were not made before it
    """
    slot = BEGIN + 2 * (lateness[0] % ((lateness.size - BEGIN) // 2))
    lateness[0], lateness[1] = lateness[0] + 1, lateness[1] + missed
    lateness[2] = lateness[slot] = deadline
    lateness[slot + 1] = late


@kernel
def sleep_until(functions, spec, deadline):
    """Sleep until a steady time [ns]; return at once if it has passed."""
    spec[0], spec[1] = deadline // NS, deadline % NS
    ask_c(functions[_SLEEP], (np.int32(_MONOTONIC), np.int32(_ABSOLUTE), spec, np.int64(0)))


@kernel
def wait(loop, clocks, spec, lateness):
    """
    Wait for the next deadline, and find out how many ticks are to be made for it.

    The grid is that of `gdmp_ros.realtime.loop.periodic`.

    :param loop: see `PERIOD`
    :param clocks: see `clock_functions`
    :param lateness: see `gdmp_ros.realtime.statistics.LatenessRecorder.numbers`
    """
    period, now = loop[PERIOD], steady_ns(clocks, spec)
    if loop[DEADLINE] == 0:
        loop[DEADLINE] = now
    loop[DEADLINE] += period * (1 + max((now - loop[DEADLINE]) // period, 0))
    sleep_until(clocks, spec, loop[DEADLINE])
    now = steady_ns(clocks, spec)
    # Rounded: a loop may move its deadlines (`gdmp_ros.ros.arm.position_loop`).
    passed = (loop[DEADLINE] - lateness[2] + period // 2) // period
    loop[LEFT] = max(passed, 1) if lateness[0] != 0 else 1
    loop[STAMP] = wall_ns(clocks, spec) - (now - loop[DEADLINE])
    note(lateness, loop[DEADLINE], now - loop[DEADLINE], loop[LEFT] - 1)


class CompiledLoop:
    """
    A loop that needs no interpreter until Python is to do something; one thread runs it.

    :ivar numbers: see `PERIOD`
    """

    def __init__(self, size: int):
        """:param size: number of `numbers`"""
        self.numbers = np.zeros(size, dtype=np.int64)

    def begin(self, period_ns: int) -> None:
        """Begin with a new grid of deadlines, and a new `LatenessRecorder`."""
        self.numbers[:OWN] = 0
        self.numbers[PERIOD] = period_ns

    def call(self) -> None:
        """Let the loop return to Python before its next tick; any thread may call it."""
        self.numbers[ATTENTION] = 1

    def may_go_on(self, only_goes_on: Callable[[], bool]) -> bool:
        """Forget the calls until now, and find out whether the next tick needs Python."""
        # In this order: a call that comes meanwhile counts.
        self.numbers[ATTENTION] = 0
        result = only_goes_on()
        if not result:
            self.call()
        return result


Made = TypeVar('Made', bound=CompiledLoop)


def prepared(make: Callable[[], Made], log: Callable[[str], object]) -> Made | None:
    """
    Make a loop, if what it calls has addresses; otherwise say why not.

    :param make: makes it, or raises a `DataError`, or what `ctypes` raises
    """
    try:
        return make()
    except (DataError, OSError, AttributeError) as error:
        log(f'every tick is made by the interpreter: {error}')
        return None
