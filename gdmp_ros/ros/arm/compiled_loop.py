"""
The loop of a simulated arm without the interpreter: sleep, take references, tick, send the state.

It runs until Python is needed: for requests, for the beginning of a motion, for what
`gdmp_ros.sim.plain_tick` does not do. Python then makes that tick. After the last tick of a motion
or a stop Python is told.
"""
from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, ExitStack
from typing import NamedTuple

import numpy as np

from gdmp_ros.control.arm_control import ArmControl
from gdmp_ros.control.joint_path import CALLED
from gdmp_ros.control.plain_tick import controller_of, MADE, write_state
from gdmp_ros.control.stream import FOLLOWED, go_on, OTHER
from gdmp_ros.kernels import bytes_at, kernel
from gdmp_ros.realtime.native import (
    ATTENTION,
    clock_functions,
    CompiledLoop,
    LEFT,
    OWN,
    PERIOD,
    STAMP,
    wait,
    wall_ns,
)
from gdmp_ros.realtime.statistics import LatenessRecorder
from gdmp_ros.ros.arm.commands import MAX_REFERENCES
from gdmp_ros.ros.arm.state_publisher import StatePublisher
from gdmp_ros.ros.middleware import Subscription
from gdmp_ros.ros.rcl import (
    bytes_of,
    check_handle,
    is_alike,
    Outgoing,
    Outlet,
    rcl_functions,
    read_integer,
    read_numbers,
    read_stamp,
    send_message,
    SerializedMemory,
    take_message,
    write_integer,
    write_numbers,
    write_stamp,
)
from gdmp_ros.ros.serialized import Layout, ReferenceReader
from gdmp_ros.sim.closed_loop import SimulatedDriver
from gdmp_ros.sim.plain_tick import plain_tick, robot_of

#: Largest number of missed periods that are made up in one tick.
MAX_CATCH_UP = 10
#: What `run` returns beside what `plain_tick` does.
ASKED, MESSAGE = 30, 31

#: Its own numbers (`gdmp_ros.realtime.native.PERIOD`): that of the reference that is followed, and
#: the mode of the arm.
SEQUENCE, MODE, NUMBERS = range(OWN, OWN + 3)


class Links(NamedTuple):
    """
    How a loop is linked to topics.

    :ivar functions: `gdmp_ros.ros.rcl.rcl_functions`
    :ivar references: address of the subscription
    :ivar taken: a message that has come (`gdmp_ros.ros.rcl.SerializedMemory.numbers`)
    :ivar tool: what references of the tool are like
    :ivar joints: what references of the joints are like
    :ivar states: where they are sent
    :ivar joint_states: the same, with a reference of the joints
    :ivar parts: where parts of them are sent
    :ivar firsts: of the numbers of each part
    :ivar every: see `gdmp_ros.ros.arm.state_publisher.StatePublisher`, as ``wanted``
    """

    functions: np.ndarray
    references: np.ndarray
    taken: np.ndarray
    tool: Layout
    joints: Layout
    states: Outlet
    joint_states: Outlet
    parts: tuple[Outlet, Outlet, Outlet, Outlet]
    firsts: np.ndarray
    every: np.ndarray
    wanted: np.ndarray


class Scratch(NamedTuple):
    """
    Memory that a loop computes in; each array of bytes is the one before it.

    :ivar time: two integers
    :ivar written: see `gdmp_ros.ros.arm.state_publisher.StatePublisher`
    """

    time: np.ndarray
    target: np.ndarray
    target_bytes: np.ndarray
    joints: np.ndarray
    joints_bytes: np.ndarray
    state: np.ndarray
    state_bytes: np.ndarray
    written: np.ndarray


@kernel
def _follow(loop, data, layout, target, target_bytes, controller, last, now):
    """
    Follow a reference that has come; False if it is to be decided in Python.

    :param last: target of the guard
    """
    read_numbers(data, layout.places, target_bytes)
    stamp = read_stamp(data, layout.parts[0])
    sequence = read_integer(data, layout.parts[1], 8)
    done = go_on(controller.stream, last, controller.held, target, 1e-9 * (now - stamp),
                 1e-9 * stamp, float(sequence), float(data[layout.parts[2]]))
    if done == FOLLOWED:
        loop[SEQUENCE] = sequence
    return done != OTHER


@kernel
def take_references(loop, links, scratch, controller, now):
    """
    Follow the references that have come.

    :param now: wall time [ns]
    :returns: False if one is to be decided in Python; it is the message that was taken
    """
    for _ in range(MAX_REFERENCES):
        size = take_message(links.functions, links.references[0], links.taken)
        if size == 0:
            return True
        data, done = bytes_at(links.taken[0], size), False
        if is_alike(data, links.tool):
            done = _follow(loop, data, links.tool, scratch.target, scratch.target_bytes,
                           controller, controller.target, now)
        elif is_alike(data, links.joints):
            done = _follow(loop, data, links.joints, scratch.joints, scratch.joints_bytes,
                           controller, controller.joints, now)
        if not done:
            return False
    return True


@kernel
def note_state(links, scratch, controller, stamp):
    """Write down the state of the tick that was made; whether some of it is to be sent."""
    written = scratch.written
    written[0] += 1
    written[3] = write_state(controller.numbers, controller.target, scratch.state)
    written[1], written[2] = written[0], stamp
    return is_wanted(links, written[0])


@kernel
def is_wanted(links, tick):
    """Whether the state of a tick is to be sent, or a part of it."""
    result = links.wanted[0]
    for k in range(len(links.parts)):
        result = result or _is_due(links, k, tick)
    return result


@kernel
def _is_due(links, part, tick):
    return links.wanted[1 + part] and (tick - part) % links.every[0] == 0


@kernel
def send_state(links, numbers, stamp, sequence, mode, tick, of_joints):
    """
    Send what is wanted of a state.

    :param numbers: of the state, as bytes
    :param of_joints: whether it has a reference of the joints
    """
    if links.wanted[0] and of_joints:
        _send(links.functions, links.joint_states, numbers, stamp, sequence, mode, tick)
    elif links.wanted[0]:
        _send(links.functions, links.states, numbers, stamp, sequence, mode, tick)
    for k in range(len(links.parts)):
        if _is_due(links, k, tick):
            part = links.parts[k]
            write_numbers(part, numbers[8 * links.firsts[k]:])
            if part.parts.size > 0:
                write_stamp(bytes_of(part), part.parts[0], stamp)
            send_message(links.functions, part)


@kernel
def _send(functions, states, numbers, stamp, sequence, mode, tick):
    write_numbers(states, numbers)
    data, parts = bytes_of(states), states.parts
    write_stamp(data, parts[0], stamp)
    write_integer(data, parts[1], 8, sequence)
    write_integer(data, parts[2], 1, mode)
    write_integer(data, parts[3], 8, tick)
    send_message(functions, states)


@kernel
def run(loop, clocks, lateness, links, scratch, robot, controller, dt):
    """
    Make ticks until Python is needed for one.

    :returns: `CALLED`; or `ASKED`, `MESSAGE`, or what `plain_tick` returns: then the tick of the
        stamp ``STAMP - (LEFT - 1) PERIOD`` is to be made
    """
    while True:
        if loop[LEFT] == 0:
            wait(loop, clocks, scratch.time, lateness)
            # What was missed is made up at once; after more than that the grid goes on.
            loop[LEFT] = min(loop[LEFT], MAX_CATCH_UP)
        if loop[ATTENTION] != 0:
            return ASKED
        if not take_references(loop, links, scratch, controller, wall_ns(clocks, scratch.time)):
            return MESSAGE
        result = plain_tick(robot, controller, dt)
        if result not in (MADE, CALLED):
            return result
        stamp = loop[STAMP] - (loop[LEFT] - 1) * loop[PERIOD]
        if note_state(links, scratch, controller, stamp):
            send_state(links, scratch.state_bytes, stamp, loop[SEQUENCE], loop[MODE],
                       scratch.written[0], scratch.written[3] != 0)
        loop[LEFT] -= 1
        if result == CALLED:
            return CALLED


def idle(size: int) -> tuple[np.ndarray, Links, Scratch]:
    """
    What a loop needs to return at once, to be compiled.

    :param size: number of its own numbers, which come first
    """
    numbers, integers = np.zeros(size, dtype=np.int64), np.zeros(2, dtype=np.int64)
    numbers[ATTENTION] = numbers[LEFT] = 1
    doubles, data = np.zeros(1), np.zeros(8, dtype=np.uint8)
    layout = Layout(data, np.zeros((0, 2), dtype=np.int64), integers, integers)
    outlet = Outlet(integers, integers, integers, integers)
    return (numbers, Links(integers, integers, integers, layout, layout, outlet, outlet,
                           4 * (outlet,), integers, np.ones(1, dtype=np.int64),
                           np.zeros(5, dtype=np.bool_)),
            Scratch(integers, doubles, data, doubles, data, doubles, data, integers))


def warm_up(control: ArmControl, driver: SimulatedDriver) -> None:
    """Compile `run`, or load it from the cache; no tick is made."""
    numbers, links, scratch = idle(NUMBERS)
    run(numbers, clock_functions(), scratch.time, links, scratch, robot_of(driver),
        controller_of(control), driver.dt)


class ArmLoop(CompiledLoop):
    """A loop that follows references and sends states."""

    size = NUMBERS

    def __init__(self, references: Subscription, reader: ReferenceReader, out: StatePublisher):
        """
        Prepare.

        :raises DataError: if references and states have no handles of rcl
        """
        with references.in_use() as address:
            check_handle(address)
        super().__init__(self.size)
        self._references, self._taken = references, SerializedMemory()
        states = [Outgoing(out.states, one) for one in out.templates]
        parts = [Outgoing(part.stream.publisher, part.stream.template) for part in out.parts]
        self._states = [*states, *parts]
        pose, applied, requested, joints_part = (one.outlet for one in parts)
        self._links = Links(
            rcl_functions(), np.zeros(1, dtype=np.int64), self._taken.numbers, *reader.layouts,
            states[0].outlet, states[1].outlet, (pose, applied, requested, joints_part),
            np.array([part.first for part in out.parts]), out.every, out.wanted)
        tool, joints = (np.zeros(len(layout.places)) for layout in reader.layouts)
        self._scratch = Scratch(np.zeros(2, dtype=np.int64), tool, tool.view(np.uint8), joints,
                                joints.view(np.uint8), out.numbers, out.numbers.view(np.uint8),
                                out.written)

    @property
    def message(self) -> bytes:
        """The reference that was taken last."""
        return self._taken.data

    @contextmanager
    def references_in_use(self) -> Iterator[None]:
        """Keep the subscription, and let the kernel know its address."""
        with self._references.in_use() as self._links.references[0]:
            yield

    @contextmanager
    def states_in_use(self) -> Iterator[None]:
        """Keep the publisher, and let the kernel know its address."""
        with ExitStack() as stack:
            for one in self._states:
                stack.enter_context(one.in_use())
            yield


class SimulatedLoop(ArmLoop):
    """The loop of one simulated arm."""

    def run(self, control: ArmControl, driver: SimulatedDriver, lateness: LatenessRecorder) -> int:
        """Make ticks until Python is needed; see `run`."""
        with self.references_in_use(), self.states_in_use():
            return int(run(self.numbers, clock_functions(),
                           np.frombuffer(lateness.numbers, dtype=np.int64), self._links,
                           self._scratch, robot_of(driver), controller_of(control),
                           driver.dt))
