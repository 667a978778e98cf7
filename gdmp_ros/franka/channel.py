"""
The real-time channel of a Franka: each millisecond one packed state comes, and one command goes.

libfranka opens the channel with a robot, begins and ends motions, and explains what ended them.
In between its states are taken, and its commands are sent, by compiled code: libfranka's binding
holds the interpreter while it waits, and makes a list of each part of a state.

Source: version 10 of the robot's protocol, ``research_interface/robot/rbk_types.h`` of libfranka.
"""
from __future__ import annotations

import ctypes
import functools
import os
import socket
import stat
import time
from typing import NamedTuple

import numpy as np

from gdmp_ros.errors import DataError
from gdmp_ros.franka.settings import JOINTS
from gdmp_ros.kernels import ask_c, kernel
from gdmp_ros.realtime.native import addresses, clock_functions, steady_ns

_POLL, _RECEIVE, _SEND = range(3)
#: poll: data may be read, the socket is broken or closed; recvfrom: return at once.
_READABLE, _BROKEN, _AT_ONCE = 1, 0x38, 0x40
#: What `receive` returns: a state is there, or none has come in time.
CAME, SILENT = range(2)
#: Mode of a robot that makes a motion.
MOVES = 2
#: Time between two states [s].
CYCLE_S = 0.001
#: Parts of a state that are numbers, in their order, after the number of the message.
_NUMBERS = (
    ('O_T_EE', 16), ('O_T_EE_d', 16), ('F_T_EE', 16), ('EE_T_K', 16), ('F_T_NE', 16),
    ('NE_T_EE', 16), ('m_ee', 1), ('I_ee', 9), ('F_x_Cee', 3), ('m_load', 1), ('I_load', 9),
    ('F_x_Cload', 3), ('elbow', 2), ('elbow_d', 2), ('tau_J', 7), ('tau_J_d', 7), ('dtau_J', 7),
    ('q', 7), ('q_d', 7), ('dq', 7), ('dq_d', 7), ('ddq_d', 7), ('joint_contact', 7),
    ('cartesian_contact', 6), ('joint_collision', 7), ('cartesian_collision', 6),
    ('tau_ext_hat_filtered', 7), ('O_F_ext_hat_K', 6), ('K_F_ext_hat_K', 6), ('O_dP_EE_d', 6),
    ('O_ddP_O', 3), ('elbow_c', 2), ('delbow_c', 2), ('ddelbow_c', 2), ('O_T_EE_c', 16),
    ('O_dP_EE_c', 6), ('O_ddP_EE_c', 6), ('theta', 7), ('dtheta', 7), ('accelerometer_top', 18),
    ('accelerometer_bottom', 18))
_COUNT = sum(count for _, count in _NUMBERS)
_AT = dict(zip((name for name, _ in _NUMBERS),
               np.cumsum([0, *(count for _, count in _NUMBERS)]).tolist()))
_LENGTH = dict(_NUMBERS)
_POSITION, _VELOCITY, _EXTERNAL = _AT['q'], _AT['dq'], _AT['tau_ext_hat_filtered']
_TAKEN = _AT['tau_J_d']
#: Bytes of a state: number, numbers, modes of generator and controller, errors and reasons, mode
#: of the robot, success rate.
_MODE = 8 + 4 * _COUNT + 2 + 2 * 41
STATE_SIZE = _MODE + 1 + 4
#: Bytes of a command, and where its torque is: behind its number and that of a motion generator.
_TORQUE = 8 + 8 * (7 + 7 + 16 + 6 + 2) + 2
COMMAND_SIZE = _TORQUE + 8 * JOINTS + 1

#: Integers of a channel: its socket; number of the last state, and of the one before; when they
#: arrived, steady time [ns]; whether a kernel has taken a state that is left for Python; states
#: that have come one after the other without a gap, or tell of the last command.
SOCKET, NUMBER, BEFORE, ARRIVED, ARRIVED_BEFORE, UNREAD, IN_ORDER, INTEGERS = range(8)
#: A command is taken if the robot tells of the same torque [Nm]; states in order after which what
#: it tells is certain.
SAME_NM, CERTAIN = 1e-3, 20
#: Longest cycle that counts, on wall time [s].
LONGEST_S = 0.02


class Wire(NamedTuple):
    """
    A channel for kernels.

    :ivar functions: `_functions`
    :ivar integers: see `SOCKET`
    :ivar came: bytes of a state that has come
    :ivar came_number: its number, a part of its bytes
    :ivar state: bytes of the last state
    :ivar numbers: all its numbers, a part of its bytes, shape (320,)
    :ivar command: bytes of the last command
    :ivar sent_number: number of the command, a part of its bytes
    :ivar torque: of the last command [Nm]; ``torque_bytes`` is the same memory
    :ivar lowest: of the torques with which the robot may compare the next; ``highest`` the same
    :ivar rate: success rate of the last state; ``rate_bytes`` is the same memory
    :ivar address: of the robot, and its length
    """

    functions: np.ndarray
    clocks: np.ndarray
    integers: np.ndarray
    came: np.ndarray
    came_number: np.ndarray
    state: np.ndarray
    numbers: np.ndarray
    command: np.ndarray
    sent_number: np.ndarray
    torque: np.ndarray
    torque_bytes: np.ndarray
    lowest: np.ndarray
    highest: np.ndarray
    rate: np.ndarray
    rate_bytes: np.ndarray
    address: np.ndarray
    address_length: np.ndarray
    poll: np.ndarray
    time: np.ndarray


@functools.cache
def _functions() -> np.ndarray:
    return addresses(ctypes.CDLL(None), 'poll', 'recvfrom', 'sendto')


@kernel
def receive(wire, patience_ms):
    """
    Wait for a state that is newer than the last one; of several the newest counts.

    :param patience_ms: longest time to wait
    :returns: `CAME` or `SILENT`
    """
    integers, handle = wire.integers, np.int32(wire.integers[SOCKET])
    before = integers[NUMBER]
    while integers[NUMBER] == before:
        wire.poll[0], wire.poll[1] = handle, _READABLE
        if ask_c(wire.functions[_POLL], (wire.poll, np.int64(1), np.int32(patience_ms))) <= 0:
            return SILENT
        if (wire.poll[1] >> 16) & _BROKEN:
            return SILENT
        while True:
            wire.address_length[0] = wire.address.size
            size = ask_c(wire.functions[_RECEIVE], (
                handle, wire.came, np.int64(wire.came.size), np.int32(_AT_ONCE), wire.address,
                wire.address_length))
            if size < 0:
                break
            if size == STATE_SIZE and wire.came_number[0] > integers[NUMBER]:
                integers[NUMBER] = wire.came_number[0]
                for k in range(STATE_SIZE):
                    wire.state[k] = wire.came[k]
    integers[BEFORE], integers[ARRIVED_BEFORE] = before, integers[ARRIVED]
    integers[ARRIVED] = steady_ns(wire.clocks, wire.time)
    return CAME


@kernel
def send(wire, torque):
    """Answer the last state with a torque [Nm]."""
    for i in range(torque.size):
        wire.torque[i] = torque[i]
    for k in range(wire.torque_bytes.size):
        wire.command[_TORQUE + k] = wire.torque_bytes[k]
    wire.sent_number[0] = wire.integers[NUMBER]
    ask_c(wire.functions[_SEND], (
        np.int32(wire.integers[SOCKET]), wire.command, np.int64(COMMAND_SIZE), np.int32(0),
        wire.address, wire.address_length[0]))


@kernel
def passed(wire):
    """Cycles since the state before the last one."""
    return wire.integers[NUMBER] - wire.integers[BEFORE]


@kernel
def read_joints(wire, position, velocity, external):
    """Write positions [rad], velocities [rad/s] and external torques [Nm] of the last state."""
    for i in range(position.size):
        position[i] = wire.numbers[_POSITION + i]
        velocity[i] = wire.numbers[_VELOCITY + i]
        external[i] = wire.numbers[_EXTERNAL + i]


@kernel
def read_taken(wire, taken):
    """
    Write the torques with which the robot may compare the next; call it once for each state.

    That is the last one that it took in time. It tells of that one too late, and a command that
    was late may have been taken or not. So all count that were sent since the last one that was
    certainly taken: the robot tells of it in the very next state.

    :param taken: written: lowest and highest [Nm], shape (2, 7)
    """
    integers, same = wire.integers, True
    for i in range(JOINTS):
        same = same and abs(wire.numbers[_TAKEN + i] - wire.torque[i]) < SAME_NM
    integers[IN_ORDER] = integers[IN_ORDER] + 1 if same or passed(wire) == 1 else 0
    if (same and passed(wire) == 1) or integers[IN_ORDER] >= CERTAIN:
        for i in range(JOINTS):
            wire.lowest[i] = wire.highest[i] = wire.numbers[_TAKEN + i]
    for i in range(JOINTS):
        told, sent = wire.numbers[_TAKEN + i], wire.torque[i]
        wire.lowest[i] = min(wire.lowest[i], told, sent)
        wire.highest[i] = max(wire.highest[i], told, sent)
        taken[0, i], taken[1, i] = wire.lowest[i], wire.highest[i]


@kernel
def moves(wire):
    """Whether the robot makes a motion, by the last state."""
    return wire.state[_MODE] == MOVES


@kernel
def in_time(wire):
    """Share of the last hundred commands that arrived in time."""
    # It is not aligned.
    for k in range(wire.rate_bytes.size):
        wire.rate_bytes[k] = wire.state[_MODE + 1 + k]
    return wire.rate[0]


@kernel
def between_arrivals(wire):
    """Time between the last two states on this machine [s]."""
    return min(1e-9 * (wire.integers[ARRIVED] - wire.integers[ARRIVED_BEFORE]), LONGEST_S)


class Channel:
    """
    A channel of a robot.

    :ivar wire: for kernels
    """

    def __init__(self, handle: int = -1):
        """:param handle: of the socket"""
        integers = np.zeros(INTEGERS, dtype=np.int64)
        integers[SOCKET] = handle
        # The numbers of a state are aligned where the state is.
        came, state = np.zeros((2, STATE_SIZE + 7 - (STATE_SIZE + 7) % 8), dtype=np.uint8)
        command, torque = np.zeros(COMMAND_SIZE + 5, dtype=np.uint8), np.zeros(JOINTS)
        rate = np.zeros(1, dtype=np.float32)
        self.wire = Wire(
            _functions(), clock_functions(), integers, came, came[:8].view(np.int64), state,
            state[8:8 + 4 * _COUNT].view(np.float32), command, command[:8].view(np.int64), torque,
            torque.view(np.uint8), np.zeros(JOINTS), np.zeros(JOINTS), rate, rate.view(np.uint8),
            np.zeros(32, dtype=np.uint8), np.zeros(1, dtype=np.int32),
            np.zeros(2, dtype=np.int32), np.zeros(2, dtype=np.int64))

    def receive(self, patience_s: float) -> bool:
        """Wait for a new state; whether one has come, also before."""
        integers = self.wire.integers
        if integers[UNREAD]:
            integers[UNREAD] = 0
            return True
        return bool(receive(self.wire, round(1e3 * patience_s)) == CAME)

    def send(self, torque: np.ndarray) -> None:
        """Answer the last state with a torque [Nm]."""
        send(self.wire, torque)

    def begin(self) -> None:
        """Control begins, without a torque."""
        wire = self.wire
        wire.torque[:] = wire.lowest[:] = wire.highest[:] = 0.0
        wire.integers[IN_ORDER] = wire.integers[UNREAD] = 0

    def taken(self) -> np.ndarray:
        """Lowest and highest torque with which the robot may compare the next; `read_taken`."""
        result = np.empty((2, JOINTS))
        read_taken(self.wire, result)
        return result

    def part(self, name: str) -> np.ndarray:
        """Numbers of a part of the last state, by its name in libfranka."""
        return self.wire.numbers[_AT[name]:_AT[name] + _LENGTH[name]].astype(float)

    def put(self, name: str, numbers: np.ndarray) -> None:
        """Write a part of a state, as a robot does."""
        self.wire.numbers[_AT[name]:_AT[name] + _LENGTH[name]] = numbers

    @property
    def mode(self) -> int:
        """Mode of the robot."""
        return int(self.wire.state[_MODE])

    @mode.setter
    def mode(self, mode: int) -> None:
        self.wire.state[_MODE] = mode

    @property
    def success_rate(self) -> float:
        """Share of the last hundred commands that arrived in time."""
        return float(in_time(self.wire))

    @success_rate.setter
    def success_rate(self, rate: float) -> None:
        self.wire.state[_MODE + 1:STATE_SIZE] = np.array([rate], dtype=np.float32).view(np.uint8)

    @property
    def arrived(self) -> int:
        """When the last state arrived, steady time [ns]."""
        return int(self.wire.integers[ARRIVED])

    @property
    def number(self) -> int:
        """Number of the last state: the robot's time [ms]."""
        return int(self.wire.integers[NUMBER])

    @property
    def between_arrivals(self) -> float:
        """Time between the last two states on this machine [s]."""
        return float(between_arrivals(self.wire))

    @property
    def passed(self) -> int:
        """Cycles since the state before the last one."""
        return int(passed(self.wire))


def datagram_sockets() -> set[int]:
    """Handles of the sockets for datagrams that this process has."""
    found = set()
    for name in os.listdir('/proc/self/fd'):
        try:
            # A copy of what is no socket would never be closed.
            if not stat.S_ISSOCK(os.fstat(int(name)).st_mode):
                continue
            with socket.socket(fileno=os.dup(int(name))) as one:
                if one.family == socket.AF_INET and one.type == socket.SOCK_DGRAM:
                    found.add(int(name))
        except OSError:  # closed meanwhile
            continue
    return found


def channel_since(before: set[int], patience_s: float) -> Channel:
    """
    Return the channel that libfranka has opened: states come there.

    :param before: `datagram_sockets` before it connected; other libraries open some, too
    :param patience_s: longest time to wait for a state [s]
    :raises DataError: if none comes
    """
    ends = time.monotonic() + patience_s
    while time.monotonic() < ends:
        for handle in datagram_sockets() - before:
            with socket.socket(fileno=os.dup(handle)) as one:
                try:
                    came = one.recv(2 * STATE_SIZE, socket.MSG_PEEK | socket.MSG_DONTWAIT)
                except BlockingIOError:
                    continue
            if len(came) == STATE_SIZE:
                return Channel(handle)
        time.sleep(CYCLE_S)
    raise DataError(f'no state of the robot has come within {patience_s:g} s')
