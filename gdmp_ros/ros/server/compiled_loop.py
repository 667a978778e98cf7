"""
The loop of a server without the interpreter: sleep, advance the motion, send the reference.

It runs until Python is needed: for requests, and for what `gdmp_ros.playback.plain_tick` does not
do. Python then makes that tick.
"""
from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from typing import NamedTuple

import numpy as np

from gdmp_ros.control.target import POSE, STIFFNESS
from gdmp_ros.kernels import kernel
from gdmp_ros.playback.bounds import NOTHING
from gdmp_ros.playback.look_ahead import look_ahead_of
from gdmp_ros.playback.plain_tick import CHANGES, COUNTS, DUE, Motion, plain_tick
from gdmp_ros.playback.streamer import Streamer
from gdmp_ros.realtime.native import (
    ATTENTION,
    clock_functions,
    CompiledLoop,
    DEADLINE,
    LEFT,
    OWN,
    STAMP,
    wait,
)
from gdmp_ros.ros.lifecycle import check_subscribers
from gdmp_ros.ros.rcl import (
    Arrivals,
    bytes_of,
    Outgoing,
    Outlet,
    rcl_functions,
    send_message,
    write_integer,
    write_numbers,
    write_stamp,
)
from gdmp_ros.ros.server.reference_publisher import ReferencePublisher

#: Its own numbers (`gdmp_ros.realtime.native.PERIOD`): time of the last tick, 0 before the first,
#: its duration, and the longest one [ns]; number of the tick that was begun, and of the one that
#: is whole; number of the last reference; what the stream says of itself.
TICKED, PASSED, LONGEST, BEGUN, WHOLE, SEQUENCE, MODE, NUMBERS = range(OWN, OWN + 8)
#: Why `run` returns: a tick is to be made; one is to be ended (`Streamer.end_tick`) and sent; one
#: was sent, and a command for the gripper is due (`Streamer.command_gripper`).
ASKED, CHANGED, COMMANDED = range(3)


class Links(NamedTuple):
    """
    Where references are sent.

    :ivar functions: `gdmp_ros.ros.rcl.rcl_functions`
    :ivar wanted: whether the three topics have subscribers
    """

    functions: np.ndarray
    wanted: np.ndarray
    reference: Outlet
    pose: Outlet
    stiffness: Outlet


@kernel
def send(loop, links, target, stamp):
    """
    Send a reference on three topics.

    :param target: its numbers as bytes
    """
    if links.wanted[0]:
        write_numbers(links.reference, target)
        data, parts = bytes_of(links.reference), links.reference.parts
        write_stamp(data, parts[0], stamp)
        write_integer(data, parts[1], 8, loop[SEQUENCE])
        write_integer(data, parts[2], 1, loop[MODE])
        send_message(links.functions, links.reference)
    if links.wanted[1]:
        write_numbers(links.pose, target[8 * POSE:])
        write_stamp(bytes_of(links.pose), links.pose.parts[0], stamp)
        send_message(links.functions, links.pose)
    if links.wanted[2]:
        write_numbers(links.stiffness, target[8 * STIFFNESS:])
        send_message(links.functions, links.stiffness)


@kernel
def run(loop, clocks, time, lateness, links, motion, target):
    """
    Make ticks until Python is needed for one.

    :param target: bounded reference of the motion, as bytes
    :returns: `ASKED`, `CHANGED` or `COMMANDED`, and how many ticks were made
    """
    ticks = 0
    while True:
        if loop[LEFT] == 0:
            wait(loop, clocks, time, lateness)
        passed = loop[DEADLINE] - loop[TICKED]
        if loop[ATTENTION] != 0 or not 0 <= passed <= loop[LONGEST]:
            return ASKED, ticks
        loop[PASSED], loop[TICKED], loop[LEFT] = passed, loop[DEADLINE], 0
        loop[BEGUN] += 1
        ticks += 1
        result = plain_tick(motion, 1e-9 * passed)
        loop[WHOLE] = loop[BEGUN]
        if result == CHANGES:
            return CHANGED, ticks
        loop[SEQUENCE] += 1
        send(loop, links, target, loop[STAMP])
        if result == DUE:
            return COMMANDED, ticks


_NO_MOTION = Motion(np.zeros(COUNTS, dtype=np.int64), NOTHING, NOTHING, NOTHING,
                    np.zeros((1, 9), dtype=np.int64), NOTHING, np.zeros((2, 4)),
                    NOTHING, NOTHING, NOTHING, look_ahead_of(None))


def warm_up() -> None:
    """Compile `run`, or load it from the cache; no tick is made."""
    numbers, integers = np.zeros(NUMBERS, dtype=np.int64), np.zeros(1, dtype=np.int64)
    numbers[ATTENTION] = numbers[LEFT] = 1
    data, outlet = np.zeros(8, dtype=np.uint8), Outlet(*4 * [integers])
    Arrivals(()).wait_until(0)
    run(numbers, clock_functions(), integers, integers,
        Links(integers, np.zeros(3, dtype=np.bool_), *3 * [outlet]), _NO_MOTION, data)


class ServerLoop(CompiledLoop):
    """The loop of one server."""

    def __init__(self, references: ReferencePublisher, longest_s: float):
        """
        Prepare.

        :param longest_s: longest step [s]
        :raises DataError: if topics have no handles of rcl
        """
        super().__init__(NUMBERS)
        self._references = references
        self._outgoing = [Outgoing(stream.publisher, stream.template)
                          for stream in references.streams]
        self.numbers[LONGEST] = round(1e9 * longest_s)
        self._time = np.zeros(2, dtype=np.int64)
        self._wanted = np.zeros(3, dtype=np.bool_)
        self._links = Links(rcl_functions(), self._wanted,
                            *(one.outlet for one in self._outgoing))

    def begin(self, period_ns: int) -> None:
        super().begin(period_ns)
        self.numbers[TICKED] = 0

    @property
    def passed(self) -> float:
        """Duration of the last tick that `run` has made [s]."""
        return float(1e-9 * self.numbers[PASSED])

    def whole(self, read: Callable[[], np.ndarray | None]) -> np.ndarray | None:
        """Return a copy of what is read, not while a tick is made; any thread may call it."""
        while True:
            begun = self.numbers[WHOLE]
            found = read()
            result = None if found is None else found.copy()
            if self.numbers[BEGUN] == begun:
                return result

    def ticked(self) -> int:
        """Time of the last tick [ns]; any thread may call it."""
        return int(self.numbers[TICKED])

    def look(self) -> None:
        """Find out which topics have subscribers."""
        check_subscribers(*self._references.streams)
        self._wanted[:] = [stream.has_subscribers for stream in self._references.streams]

    def run(self, streamer: Streamer) -> int:
        """Make ticks until Python is needed; see `run`."""
        numbers, references = self.numbers, self._references
        goes_on = self.may_go_on(lambda: streamer.only_goes_on)
        motion = streamer.motion() if goes_on else _NO_MOTION
        numbers[SEQUENCE], numbers[MODE] = references.sequence, streamer.mode
        with ExitStack() as uses:
            for one in self._outgoing:
                uses.enter_context(one.in_use())
            why, ticks = run(numbers, clock_functions(), self._time,
                             np.frombuffer(streamer.lateness.numbers, dtype=np.int64),
                             self._links, motion, motion.bounded.view(np.uint8))
        if ticks:
            streamer.catch_up(motion, ticks, int(numbers[TICKED]))
            sent = ticks - (why == CHANGED)
            references.catch_up(motion.bounded, sent, int(numbers[STAMP]))
        return int(why)
