"""
The hand of a Franka, through libfranka.

libfranka keeps the interpreter of the process while it waits for the hand: it needs a process of
its own, apart from that of the arm.
"""
from __future__ import annotations

from collections.abc import Callable
import threading
from typing import Any

from gdmp_ros.control.arm_driver import ArmStopped
from gdmp_ros.control.gripper import check_command, GripperCommand, GripperState, HELD_M
from gdmp_ros.franka.robot import FAILURES
from gdmp_ros.realtime.loop import Clock, Loop, SystemClock
from gdmp_ros.util.optional_imports import extra, optional_import

with optional_import(extra('franka')):
    import pylibfranka as libfranka

#: Largest force of the hand [N].
STRONGEST = 70.0
#: Time between two readings of the state [ns].
READ_NS = 50_000_000
#: Time between two attempts to connect [ns].
AGAIN_NS = 1_000_000_000


def opened(host: str) -> Any:
    """Connect to a hand."""
    return libfranka.Gripper(host)


class FrankaGripper:
    """
    One hand; a loop of its own talks to it. Any thread may use it.

    A hand that does not answer is reported in the state, and looked for until it does.
    """

    def __init__(self, host: str, homing: bool = False, clock: Clock | None = None,
                 opened: Callable[[str], Any] = opened):
        """
        Connect.

        :param homing: find the ends of the travel first: the fingers move
        :param clock: by default that of the system
        :param opened: connects to a hand
        :raises ArmStopped: if the hand does not answer
        """
        self._host, self._homing, self._opened = host, homing, opened
        self._clock = clock or SystemClock()
        self._next: tuple[GripperCommand, int] | None = None
        self._lock = threading.Lock()
        self._commands = 0
        self._wanted: GripperCommand | None = None
        self._problem = ''
        self._hand: Any = None
        self._state = GripperState(0.0, 0.0, False, False, 0)
        try:
            self._connect()
        except FAILURES as error:
            raise ArmStopped(f'{host}: the hand does not answer: {error}', False) from None
        self._running = self._clock.start(self._talk())

    @property
    def state(self) -> GripperState:
        """The newest state."""
        with self._lock:
            waits = self._next is not None
            return self._state._replace(moving=self._state.moving or waits,
                                        commands=self._commands)

    def command(self, command: GripperCommand) -> int:
        """Begin a command; see `gdmp_ros.control.gripper.Gripper`."""
        check_command(command, self._state.widest, STRONGEST)
        with self._lock:
            self._commands += 1
            self._next = command, self._commands
            return self._commands

    def close(self) -> None:
        """Disconnect; the hand stays as it is."""
        self._running.end()
        self._hand = None

    def _connect(self) -> None:
        self._hand = self._opened(self._host)
        if self._homing:
            self._hand.homing()
            self._homing = False
        self._problem = ''
        self._read()

    def _talk(self) -> Loop:
        while True:
            pause = READ_NS
            try:
                if self._hand is None:
                    self._connect()
                self._work()
            except FAILURES as error:
                self._hand, self._problem = None, f'the hand does not answer: {error}'
                with self._lock:
                    self._next = None
                    self._state = self._state._replace(moving=False, problem=self._problem)
                pause = AGAIN_NS
            yield self._clock.now() + pause

    def _work(self) -> None:
        """Carry out the next command, or read the state."""
        with self._lock:
            given, self._next = self._next, None
            if given is not None:
                self._state = self._state._replace(moving=True)
        if given is not None:
            self._wanted, self._problem = given[0], ''
            try:
                self._carry_out(given[0])
            except libfranka.CommandException as error:
                self._problem = str(error).removeprefix('libfranka gripper: ')
        self._read()

    def _carry_out(self, command: GripperCommand) -> None:
        if command.force:
            # Whatever is between the fingers is to be held: any width beyond the wanted one.
            held = self._hand.grasp(command.width, command.speed, command.force, HELD_M,
                                    self._state.widest)
            if not held:
                self._problem = 'there is nothing between the fingers'
        elif not self._hand.move(command.width, command.speed):
            self._problem = f'the fingers do not reach {command.width:.4f} m'

    def _read(self) -> None:
        read, target = self._hand.read_once(), self._wanted
        holding = bool(read.is_grasped and target is not None and target.force
                       and read.width > target.width + HELD_M)
        with self._lock:
            self._state = GripperState(float(read.width), float(read.max_width), False, holding,
                                       self._commands, self._problem)
