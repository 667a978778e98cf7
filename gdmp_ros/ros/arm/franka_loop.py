"""
The loop of a Franka without the interpreter: wait for a state, take references, answer, publish.

It runs until Python is needed, which then makes that cycle.
"""
from __future__ import annotations

from contextlib import nullcontext
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
from rosgraph_msgs.msg import Clock as ClockMessage

from gdmp_ros.control.arm_control import ArmControl
from gdmp_ros.control.plain_tick import controller_of, MADE, OTHER
from gdmp_ros.control.stream import is_plain
from gdmp_ros.franka.channel import (
    ARRIVED,
    between_arrivals,
    CAME,
    CYCLE_S,
    moves,
    NUMBER,
    passed,
    receive,
    UNREAD,
)
from gdmp_ros.franka.driver import FrankaDriver
from gdmp_ros.franka.plain_cycle import link_of, plain_cycle
from gdmp_ros.kernels import kernel
from gdmp_ros.realtime.loop import NS
from gdmp_ros.realtime.native import (
    ATTENTION,
    clock_functions,
    note,
    steady_ns,
    thread_cpu_ns,
    wall_ns,
)
from gdmp_ros.realtime.statistics import LatenessRecorder
from gdmp_ros.ros.arm.compiled_loop import (
    ArmLoop,
    ASKED,
    MESSAGE,
    NUMBERS,
    send_state,
    take_references,
)
from gdmp_ros.ros.arm.state_publisher import StatePublisher
from gdmp_ros.ros.middleware import Publisher, Subscription
from gdmp_ros.ros.rcl import bytes_of, Outgoing, Outlet, send_message, write_stamp
from gdmp_ros.ros.serialized import ReferenceReader, SerializedTemplate

#: Its own numbers: whether the robot's time is the clock; stamp [ns] and number of the last state
#: that was answered; states that were missed; CPU time of the thread at the last answer [ns].
CLOCKED, STAMPED, ANSWERED, MISSED, WORKED, COUNT = range(NUMBERS, NUMBERS + 6)
#: Longest time that compiled code waits for a state [ms].
PATIENCE_MS = 100
_CYCLE_NS = round(CYCLE_S * NS)


class Times(NamedTuple):
    """
    What is noted of the time.

    :ivar lateness: see `gdmp_ros.realtime.statistics.LatenessRecorder.numbers`
    :ivar work: the same, of CPU times
    """

    clocks: np.ndarray
    lateness: np.ndarray
    work: np.ndarray


@kernel
def robot_stamp(stamp, answered, number):
    """
    Stamp of a state by the time of its robot [ns].

    :param stamp: of the last state that was answered [ns]
    :param answered: its number
    """
    # A robot that was restarted counts from the beginning.
    steps = number - answered
    return stamp + (steps * _CYCLE_NS if 0 < steps < 1000 else _CYCLE_NS)


@kernel
def run(loop, times, links, scratch, clock, link, controller, by_wall_time):
    """
    Answer states until Python is needed for one.

    :param clock: where the robot's time is sent
    :param by_wall_time: whether a cycle lasts until the next state arrives
    :returns: `ASKED`; or what was not done for the state that is `UNREAD`: `MESSAGE`, `OTHER`; or
        an event of the law
    """
    wire, clocks, spec = link.wire, times.clocks, scratch.time
    while True:
        if loop[ATTENTION] != 0:
            return ASKED
        if receive(wire, PATIENCE_MS) != CAME:
            return ASKED
        wire.integers[UNREAD] = 1
        if not (moves(wire) and is_plain(controller.stream)):
            return OTHER
        stamp = (robot_stamp(loop[STAMPED], loop[ANSWERED], wire.integers[NUMBER])
                 if loop[CLOCKED] != 0 else wall_ns(clocks, spec))
        if not take_references(loop, links, scratch, controller, stamp):
            return MESSAGE
        dt = between_arrivals(wire) if by_wall_time else passed(wire) * CYCLE_S
        result = plain_cycle(link, controller, dt, CYCLE_S)
        if result == OTHER:
            return OTHER
        wire.integers[UNREAD] = 0
        loop[MISSED] += passed(wire) - 1
        loop[STAMPED], loop[ANSWERED] = stamp, wire.integers[NUMBER]
        if result != MADE:
            return result
        send_state(loop, links, scratch, controller, stamp)
        if loop[CLOCKED] != 0:
            write_stamp(bytes_of(clock), clock.parts[0], stamp)
            send_message(links.functions, clock)
        robot_ns = wire.integers[NUMBER] * _CYCLE_NS
        note(times.lateness, robot_ns, steady_ns(clocks, spec) - wire.integers[ARRIVED], 0)
        last, loop[WORKED] = loop[WORKED], thread_cpu_ns(clocks, spec)
        note(times.work, last, loop[WORKED] - last, 0)


def _clock_template() -> SerializedTemplate:
    message = ClockMessage()
    return SerializedTemplate(message, 0, lambda *_: None, [SimpleNamespace(stamp=message.clock)])


def _numbers(recorder: LatenessRecorder) -> np.ndarray:
    return np.frombuffer(recorder.numbers, dtype=np.int64)


class FrankaLoop(ArmLoop):
    """The loop of one Franka."""

    size = COUNT

    def __init__(self, references: Subscription, reader: ReferenceReader, out: StatePublisher,
                 clock: Publisher | None):
        """
        Prepare.

        :param clock: where the robot's time is sent, if it is
        :raises DataError: if references and states have no handles of rcl
        """
        super().__init__(references, reader, out)
        self._clock = None if clock is None else Outgoing(clock, _clock_template())
        nothing = np.zeros(1, dtype=np.int64)
        self._clock_outlet = (Outlet(nothing, nothing, nothing, nothing) if self._clock is None
                              else self._clock.outlet)
        self.numbers[CLOCKED] = self._clock is not None

    def answer(self, control: ArmControl, driver: FrankaDriver, lateness: LatenessRecorder,
               work: LatenessRecorder) -> int:
        """Answer states until Python is needed; see `run`."""
        times = Times(clock_functions(), _numbers(lateness), _numbers(work))
        with self.in_use(), nullcontext() if self._clock is None else self._clock.in_use():
            return self._run(times, driver, control)

    def warm_up(self, control: ArmControl, driver: FrankaDriver) -> None:
        """Compile `run`, or load it from the cache; no cycle is made."""
        self.numbers[ATTENTION] = 1
        recorder = _numbers(LatenessRecorder(NS, 1))
        self._run(Times(clock_functions(), recorder, recorder), driver, control)

    def _run(self, times: Times, driver: FrankaDriver, control: ArmControl) -> int:
        return int(run(self.numbers, times, self._links, self._scratch, self._clock_outlet,
                       link_of(driver), controller_of(control), driver.wall_time))
