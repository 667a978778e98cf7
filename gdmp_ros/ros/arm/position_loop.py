"""
The loop of an arm that takes joint positions without the interpreter.

It sleeps, takes what the arm measures and references, ticks, and sends command and state, until
Python is needed for a message or a tick.
"""
from __future__ import annotations

from contextlib import ExitStack
from typing import NamedTuple

import numpy as np

from gdmp_ros.control.arm_control import ArmControl
from gdmp_ros.control.joint_path import CALLED
from gdmp_ros.control.plain_tick import controller_of, MADE
from gdmp_ros.control.servo import SCALARS
from gdmp_ros.kernels import kernel, records_at
from gdmp_ros.manifolds.linalg import copy_into
from gdmp_ros.realtime.native import (
    ATTENTION,
    clock_functions,
    DEADLINE,
    LEFT,
    PERIOD,
    STAMP,
    wait,
    wall_ns,
)
from gdmp_ros.realtime.statistics import LatenessRecorder
from gdmp_ros.ros.arm.compiled_loop import (
    ArmLoop,
    ASKED,
    idle,
    is_wanted,
    MESSAGE,
    MODE,
    NUMBERS,
    send_state,
    SEQUENCE,
    take_references,
)
from gdmp_ros.ros.arm.position_link import command_numbers, TopicLink
from gdmp_ros.ros.arm.state_publisher import StatePublisher
from gdmp_ros.ros.middleware import Subscription
from gdmp_ros.ros.rcl import (
    FOREIGN,
    Incoming,
    Inlet,
    NO_INLET,
    Outgoing,
    Outlet,
    send_message,
    take_newest,
    write_numbers,
)
from gdmp_ros.ros.serialized import ReferenceReader
from gdmp_ros.sim.position_driver import PositionDriver
from gdmp_ros.sim.position_tick import plain_tick, PositionArmView, view_of, write_arm

#: Ticks that are late pass as one, up to this many.
MOST_LATE = 10
#: Ticks are synchronised with the joint states of the arm: they come this part of a period after
#: a message, so that a command arrives before the next cycle of the arm. Gain of the correction in
#: each tick, and its largest step [periods].
PHASE, PHASE_GAIN, PHASE_STEP = 0.25, 0.02, 0.01
#: What `run` returns beside what others do: a message of a topic is for Python.
JOINTS, WRENCH, RUNNING = 32, 33, 34


class Topics(NamedTuple):
    """
    Where an arm is heard, and told what to do.

    :ivar order: see `gdmp_ros.ros.arm.position_link.command_numbers`
    :ivar horizon: the same, shape (1,)
    :ivar sent: numbers of a command
    :ivar sent_bytes: the same
    """

    joints: Inlet
    wrench: Inlet
    running: Inlet
    commands: Outlet
    order: np.ndarray
    horizon: np.ndarray
    sent: np.ndarray
    sent_bytes: np.ndarray


@kernel
def hear(functions, topics, heard, servo, now):
    """
    Take what the arm has said until now.

    :returns: `MADE`, or which topic has a message for Python
    """
    if take_newest(functions, topics.joints, now) == FOREIGN:
        return JOINTS
    if take_newest(functions, topics.wrench, now) == FOREIGN:
        return WRENCH
    if take_newest(functions, topics.running, now) == FOREIGN:
        return RUNNING
    s = records_at(servo.numbers, 0, 1, SCALARS)[0]
    s.runs = heard.runs[0]
    s.age, s.wrench_age = 1e-9 * (now - heard.arrived[0]), 1e-9 * (now - heard.felt[0])
    for k in range(2):
        copy_into(heard.joints[k], servo.measured[k])
    if s.senses != 0.0:
        copy_into(heard.wrench, servo.felt)
    return MADE


@kernel
def keep_phase(loop, arrived):
    """
    Move the next deadline towards `PHASE` after the arm has said something.

    :param arrived: when that was, wall time [ns]
    """
    late = ((loop[STAMP] - arrived) % loop[PERIOD]) / loop[PERIOD] - PHASE
    if late > 0.5:
        late -= 1.0
    step = min(max(PHASE_GAIN * late, -PHASE_STEP), PHASE_STEP)
    loop[DEADLINE] -= np.int64(step * loop[PERIOD])


@kernel
def run(loop, clocks, lateness, links, topics, heard, scratch, view, controller):
    """
    Make ticks until Python is needed.

    :returns: `CALLED`, `ASKED`, `MESSAGE`, `JOINTS`, `WRENCH`, `RUNNING`, or what `plain_tick`
        returns
    """
    scalars = records_at(view.servo.numbers, 0, 1, SCALARS)[0]
    while True:
        if loop[LEFT] == 0:
            wait(loop, clocks, scratch.time, lateness)
        if loop[ATTENTION] != 0:
            return ASKED
        now = wall_ns(clocks, scratch.time)
        result = hear(links.functions, topics, heard, view.servo, now)
        if result != MADE:
            return result
        if not take_references(loop, links, scratch, controller, now):
            return MESSAGE
        keep_phase(loop, heard.arrived[0])
        scalars.dt = 1e-9 * min(loop[LEFT], MOST_LATE) * loop[PERIOD]
        result = plain_tick(view, controller)
        if result not in (MADE, CALLED):
            return result
        command_numbers(view.servo.command[0], view.servo.virtual[1], topics.order,
                        topics.horizon[0], topics.sent)
        write_numbers(topics.commands, topics.sent_bytes)
        send_message(links.functions, topics.commands)
        written = scratch.written
        written[0] += 1
        written[3] = write_arm(view, controller, scratch.state)
        written[1], written[2] = written[0], now
        if is_wanted(links, written[0]):
            send_state(links, scratch.state_bytes, now, loop[SEQUENCE], loop[MODE], written[0],
                       written[3] != 0)
        loop[LEFT] = 0
        if result == CALLED:
            return CALLED


def warm_up(control: ArmControl, link: TopicLink, view: PositionArmView) -> None:
    """Compile the kernels, or load them from the cache; no tick is made."""
    numbers, links, scratch = idle(NUMBERS)
    topics = Topics(NO_INLET, NO_INLET, NO_INLET, links.states, link.order, np.zeros(1),
                    scratch.state, scratch.state_bytes)
    run(numbers, clock_functions(), scratch.time, links, topics, link.heard, scratch, view,
        controller_of(control))


class PositionArmLoop(ArmLoop):
    """The loop of one arm."""

    size = NUMBERS

    def __init__(self, references: Subscription, reader: ReferenceReader, out: StatePublisher,
                 link: TopicLink):
        """
        Prepare.

        :raises DataError: if topics have no handles of rcl
        """
        super().__init__(references, reader, out)
        heard, self._link = link.heard, link
        self._joints = Incoming(link.joints, heard.joints, heard.arrived)
        self._wrench = (None if link.wrenches is None
                        else Incoming(link.wrenches, heard.wrench, heard.felt))
        self._running = (None if link.running is None
                         else Incoming(link.running, np.zeros(1), np.zeros(1, dtype=np.int64)))
        self._commands = Outgoing(link.commands.publisher, link.commands.template)
        sent = np.zeros(len(self._commands.outlet.numbers))
        self._sent = link.order, np.array([link.horizon]), sent, sent.view(np.uint8)

    def run(self, control: ArmControl, driver: PositionDriver, lateness: LatenessRecorder) -> int:
        """Make ticks until Python is needed; see `run`."""
        incoming = self._joints, self._wrench, self._running
        self._joints.learn(self._link.joints_layout())
        if self._wrench is not None:
            self._wrench.learn(self._link.wrench_layout())
        joints, wrench, running = (NO_INLET if one is None else one.inlet for one in incoming)
        topics = Topics(joints, wrench, running, self._commands.outlet, *self._sent)
        with ExitStack() as stack:
            for one in (*incoming, self._commands, *self._states):
                if one is not None:
                    stack.enter_context(one.in_use())
            stack.enter_context(self.references_in_use())
            return int(run(self.numbers, clock_functions(),
                           np.frombuffer(lateness.numbers, dtype=np.int64), self._links, topics,
                           self._link.heard, self._scratch, view_of(driver),
                           controller_of(control)))

    def hand_over(self, topic: int, now: int) -> None:
        """Let Python take the message of a topic for which `run` has returned."""
        link = self._link
        for which, incoming, take in ((JOINTS, self._joints, link.take_joints),
                                      (WRENCH, self._wrench, link.take_wrench),
                                      (RUNNING, self._running, link.take_running)):
            if topic == which and incoming is not None:
                take(incoming.data, int(incoming.inlet.about[1]) or now)
