"""
The loop of a Franka without the interpreter: wait for a state, take references, answer.

Where Python is to decide something, a thread of its own says so when it has got the interpreter,
which another thread may keep for long; the robot is answered until then. States are sent by a
thread of their own, too: to send takes several times as long as to answer.
"""
from __future__ import annotations

from contextlib import ExitStack
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
from rosgraph_msgs.msg import Clock as ClockMessage

from gdmp_ros.control.arm_control import ArmControl
from gdmp_ros.control.joint_path import CALLED
from gdmp_ros.control.plain_tick import controller_of, MADE, OTHER
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
from gdmp_ros.franka.plain_cycle import Link, link_of, plain_cycle
from gdmp_ros.kernels import kernel
from gdmp_ros.manifolds.linalg import copy_into
from gdmp_ros.realtime.loop import Clock, Loop, NS
from gdmp_ros.realtime.native import (
    ATTENTION,
    clock_functions,
    note,
    post,
    semaphore,
    semaphore_functions,
    steady_ns,
    thread_cpu_ns,
    wait_for_post,
    wall_ns,
)
from gdmp_ros.realtime.statistics import LatenessRecorder
from gdmp_ros.ros.arm.compiled_loop import (
    ArmLoop,
    ASKED,
    idle,
    MODE,
    note_state,
    NUMBERS,
    send_state,
    SEQUENCE,
    take_references,
)
from gdmp_ros.ros.arm.state_publisher import StatePublisher
from gdmp_ros.ros.middleware import Publisher, Subscription
from gdmp_ros.ros.rcl import bytes_of, Outgoing, Outlet, send_message, write_stamp
from gdmp_ros.ros.serialized import ReferenceReader, SerializedTemplate

#: Its own numbers: whether the robot's time is the clock; stamp [ns] and number of the last state
#: that was answered; states that were missed; CPU time of the thread at the last answer [ns];
#: when the message that was taken last was taken, if it is for Python, otherwise 0 [ns]; whether
#: Python is called.
CLOCKED, STAMPED, ANSWERED, MISSED, WORKED, UNDECIDED, CALLING, COUNT = range(
    NUMBERS, NUMBERS + 8)
#: Longest time that compiled code waits for a state [ms].
PATIENCE_MS = 100
#: States that wait to be sent; more are not sent. Numbers of an `Outbox`: states that were put
#: there, and taken from there.
WAITING, PUT, TAKEN = 256, 0, 1
#: Longest time until all are sent before Python sends others, and between two looks [ns].
FLUSH_NS, LOOK_NS = 2_000_000, 50_000
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


class Outbox(NamedTuple):
    """
    States on their way from the thread that answers to the one that sends.

    :ivar calls: functions of semaphores
    :ivar posted: semaphore
    :ivar counts: `PUT`, `TAKEN`
    :ivar states: numbers of states as bytes, shape ``(WAITING, 8 n)``
    :ivar parts: of each: stamp [ns], sequence, mode, tick, whether it has a reference of the
        joints; shape ``(WAITING, 5)``
    """

    calls: np.ndarray
    posted: np.ndarray
    counts: np.ndarray
    states: np.ndarray
    parts: np.ndarray


class Herald(NamedTuple):
    """
    How Python is called.

    :ivar calls: functions of semaphores
    :ivar posted: semaphore
    """

    calls: np.ndarray
    posted: np.ndarray


@kernel
def put(outbox, loop, scratch, stamp):
    """Let a state be sent."""
    count = outbox.counts[PUT]
    if count - outbox.counts[TAKEN] == WAITING:
        return
    state, parts = outbox.states[count % WAITING], outbox.parts[count % WAITING]
    copy_into(scratch.state_bytes, state)
    parts[0], parts[1], parts[2], parts[3], parts[4] = (
        stamp, loop[SEQUENCE], loop[MODE], scratch.written[0], scratch.written[3])
    outbox.counts[PUT] = count + 1
    post(outbox.calls, outbox.posted)


@kernel
def send_waiting(outbox, links, clock, clocked, clocks, spec, patience_ns):
    """
    Send what comes within a time.

    :param clock: where the robot's time is sent
    :param clocked: whether it is
    """
    deadline = steady_ns(clocks, spec) + patience_ns
    while wait_for_post(outbox.calls, outbox.posted, spec, deadline):
        count = outbox.counts[TAKEN]
        state, parts = outbox.states[count % WAITING], outbox.parts[count % WAITING]
        send_state(links, state, parts[0], parts[1], parts[2], parts[3], parts[4] != 0)
        if clocked:
            write_stamp(bytes_of(clock), clock.parts[0], parts[0])
            send_message(links.functions, clock)
        outbox.counts[TAKEN] = count + 1


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
def _call(loop, herald):
    """Let Python take over when it can."""
    if loop[CALLING] == 0:
        loop[CALLING] = 1
        post(herald.calls, herald.posted)


@kernel
def run(loop, times, links, scratch, outbox, herald, link, controller, by_wall_time):
    """
    Answer states until Python takes over, or is needed for one.

    :param herald: see `Herald`
    :param by_wall_time: whether a cycle lasts until the next state arrives
    :returns: `ASKED`; `OTHER`: Python is to make the next cycle, of a state that is `UNREAD` if it
        has come; or an event of the law
    """
    wire, clocks, spec = link.wire, times.clocks, scratch.time
    while True:
        if loop[ATTENTION] != 0:
            return ASKED
        if receive(wire, PATIENCE_MS) != CAME:
            return OTHER
        wire.integers[UNREAD] = 1
        if not moves(wire):
            return OTHER
        stamp = (robot_stamp(loop[STAMPED], loop[ANSWERED], wire.integers[NUMBER])
                 if loop[CLOCKED] != 0 else wall_ns(clocks, spec))
        # Those behind a message that Python is to decide wait for it.
        if loop[UNDECIDED] == 0 and not take_references(loop, links, scratch, controller, stamp):
            loop[UNDECIDED] = stamp
            _call(loop, herald)
        dt = between_arrivals(wire) if by_wall_time else passed(wire) * CYCLE_S
        result = plain_cycle(link, controller, dt, CYCLE_S)
        if result == OTHER:
            return OTHER
        wire.integers[UNREAD] = 0
        loop[MISSED] += passed(wire) - 1
        loop[STAMPED], loop[ANSWERED] = stamp, wire.integers[NUMBER]
        if result == CALLED:
            _call(loop, herald)
        elif result != MADE:
            return result
        if note_state(links, scratch, controller, stamp) or loop[CLOCKED] != 0:
            put(outbox, loop, scratch, stamp)
        robot_ns = wire.integers[NUMBER] * _CYCLE_NS
        note(times.lateness, robot_ns, steady_ns(clocks, spec) - wire.integers[ARRIVED], 0)
        last, loop[WORKED] = loop[WORKED], thread_cpu_ns(clocks, spec)
        note(times.work, last, loop[WORKED] - last, 0)


def warm_up(control: ArmControl, link: Link) -> None:
    """Compile the kernels, or load them from the cache; no cycle is made."""
    numbers, links, scratch = idle(COUNT)
    clocks, integers = clock_functions(), scratch.time
    outbox = Outbox(semaphore_functions(), semaphore(), integers,
                    np.zeros((WAITING, 8), dtype=np.uint8),
                    np.zeros((WAITING, 5), dtype=np.int64))
    run(numbers, Times(clocks, integers, integers), links, scratch, outbox,
        Herald(outbox.calls, outbox.posted), link, controller_of(control), False)
    send_waiting(outbox, links, links.states, False, clocks, integers, 0)
    wait_for_post(outbox.calls, outbox.posted, integers, 0)


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
        states = np.zeros((WAITING, 8 * len(out.numbers)), dtype=np.uint8)
        self._outbox = Outbox(semaphore_functions(), semaphore(), np.zeros(2, dtype=np.int64),
                              states, np.zeros((WAITING, 5), dtype=np.int64))
        self._herald = Herald(self._outbox.calls, semaphore())
        self._clock = None if clock is None else Outgoing(clock, _clock_template())
        nothing = np.zeros(1, dtype=np.int64)
        self._clock_outlet = (Outlet(nothing, nothing, nothing, nothing) if self._clock is None
                              else self._clock.outlet)
        self.numbers[CLOCKED] = self._clock is not None

    def answer(self, control: ArmControl, driver: FrankaDriver, lateness: LatenessRecorder,
               work: LatenessRecorder) -> int:
        """Answer states until Python is needed; see `run`."""
        self.numbers[UNDECIDED] = self.numbers[CALLING] = 0
        times = Times(clock_functions(), _numbers(lateness), _numbers(work))
        with self.references_in_use():
            return int(run(self.numbers, times, self._links, self._scratch, self._outbox,
                           self._herald, link_of(driver), controller_of(control),
                           driver.wall_time))

    def heralding(self, clock: Clock) -> Loop:
        """Let Python take over from compiled code that calls it."""
        spec, herald = np.zeros(2, dtype=np.int64), self._herald
        while True:
            now = clock.now()
            if wait_for_post(herald.calls, herald.posted, spec, now + PATIENCE_MS * 1_000_000):
                self.call()
            yield now

    def sending(self, clock: Clock) -> Loop:
        """Send the states of cycles that compiled code has made."""
        spec = np.zeros(2, dtype=np.int64)
        outgoing = self._states if self._clock is None else [*self._states, self._clock]
        while True:
            with ExitStack() as stack:
                for one in outgoing:
                    stack.enter_context(one.in_use())
                send_waiting(self._outbox, self._links, self._clock_outlet,
                             self._clock is not None, clock_functions(), spec,
                             PATIENCE_MS * 1_000_000)
            yield clock.now()

    def flush(self, clock: Clock) -> None:
        """Wait until the states of cycles that compiled code has made are sent."""
        counts, latest = self._outbox.counts, clock.now() + FLUSH_NS
        while counts[PUT] != counts[TAKEN] and clock.now() < latest:
            clock.sleep_until(clock.now() + LOOK_NS)

