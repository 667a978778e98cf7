"""The real-time channel of a Franka, over real sockets; the other end packs and unpacks itself."""
from contextlib import contextmanager
import os
import socket
import struct
import threading
import time

import numpy as np
import pytest

from gdmp_ros.control.arm_driver import ArmStopped
from gdmp_ros.control.memory import arm_view
from gdmp_ros.control.plain_tick import controller_of
from gdmp_ros.errors import DataError
from gdmp_ros.franka import greeting
from gdmp_ros.franka.channel import (
    BEFORE,
    CERTAIN,
    Channel,
    channel_since,
    COMMAND_SIZE,
    datagram_sockets,
    MOVES,
    NUMBER,
    STATE_SIZE,
    UNREAD,
)
from gdmp_ros.franka.plain_cycle import link_of, measure
from gdmp_ros.franka.robot import FrankaRobot
from gdmp_ros.franka.settings import FrankaSettings
from gdmp_ros.kernels import kernel
from gdmp_ros.sim.frames import ToolTransform

#: A state: number; 320 numbers; modes of generator and controller; errors and reasons; mode of the
#: robot and success rate.
STATE = struct.Struct('<Q320f2B41B41BBf')
#: Its numbers: q, dq, tau_J_d and tau_ext_hat_filtered.
POSITION, VELOCITY, TAKEN, EXTERNAL = 147, 161, 133, 208
#: A command: number; q, dq, pose, twist, elbow; two flags; torque; flag.
COMMAND = struct.Struct('<Q38d2B7dB')


def packed(number, numbers=(), rate=1.0, mode=MOVES):
    """A state; ``numbers`` are pairs of a position and values."""
    values = np.zeros(320)
    for at, some in numbers:
        values[at:at + len(some)] = some
    return STATE.pack(number, *values, 1, 2, *[0] * 82, mode, rate)


@pytest.fixture
def ends():
    """A channel, and the socket of the robot with the address of the channel."""
    with (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as own,
          socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as robot):
        own.bind(('127.0.0.1', 0))
        robot.bind(('127.0.0.1', 0))
        robot.settimeout(1.0)
        yield Channel(own.fileno()), robot, own.getsockname()


def test_states_come_and_commands_go(ends):
    channel, robot, address = ends
    assert (STATE.size, COMMAND.size) == (STATE_SIZE, COMMAND_SIZE)
    q, dq, external = np.arange(7) / 8, -np.arange(7) / 4, np.arange(7) / 2
    robot.sendto(packed(5, [(POSITION, q), (VELOCITY, dq), (EXTERNAL, external)], 0.75), address)
    assert channel.receive(1.0)
    for name, expected in (('q', q), ('dq', dq), ('tau_ext_hat_filtered', external)):
        np.testing.assert_array_equal(channel.part(name), expected)
    assert (channel.number, channel.mode, channel.success_rate) == (5, MOVES, 0.75)
    channel.send(np.arange(7) * 0.1)
    number, *command = COMMAND.unpack(robot.recv(2048))
    assert number == 5 and command[40:47] == pytest.approx(np.arange(7) * 0.1)
    assert not any(command[:40]) and command[47] == 0


def test_of_several_states_the_newest_counts_and_none_is_read_twice(ends):
    channel, robot, address = ends
    for number in (7, 9, 8):
        robot.sendto(packed(number, [(POSITION, [number])]), address)
    robot.sendto(b'not a state', address)
    assert channel.receive(1.0)
    assert channel.number == 9 and channel.part('q')[0] == 9.0
    robot.sendto(packed(9), address)
    assert not channel.receive(0.05)
    robot.sendto(packed(11), address)
    assert channel.receive(1.0) and channel.passed == 2


def test_a_state_that_a_kernel_has_left_is_read(ends):
    channel, robot, address = ends
    robot.sendto(packed(3), address)
    assert channel.receive(1.0)
    channel.wire.integers[UNREAD] = 1
    assert channel.receive(0.0) and channel.number == 3
    assert not channel.receive(0.01)


def test_a_socket_that_is_closed_is_silent():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as own:
        handle = own.fileno()
    assert not Channel(handle).receive(10.0)


def test_to_look_for_sockets_leaves_nothing_open():
    before = len(os.listdir('/proc/self/fd'))
    for _ in range(3):
        datagram_sockets()
    assert len(os.listdir('/proc/self/fd')) == before


def test_the_channel_is_the_socket_to_which_states_come():
    before = datagram_sockets()
    with (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other,
          socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as own):
        for one in (other, own):
            one.bind(('127.0.0.1', 0))
        other.sendto(b'something else', other.getsockname())
        with pytest.raises(DataError, match='no state of the robot'):
            channel_since(before, 0.05)
        other.sendto(packed(4), own.getsockname())
        channel = channel_since(before, 1.0)
        assert channel.receive(1.0) and channel.number == 4


def told(channel, number, torque):
    """Both ends of the torques that count, after a state."""
    integers = channel.wire.integers
    integers[BEFORE], integers[NUMBER] = integers[NUMBER], number
    channel.put('tau_J_d', torque)
    return channel.taken()[:, 0].tolist()


def test_with_what_the_robot_compares_a_torque():
    channel = Channel()
    channel.begin()
    channel.wire.integers[NUMBER] = 1
    assert told(channel, 2, 0.0) == [0.0, 0.0]
    channel.send(np.full(7, 0.5))
    assert told(channel, 3, 0.5) == [0.5, 0.5]
    # A command that may have been late: either of them was taken.
    channel.send(np.full(7, 1.0))
    assert told(channel, 5, 0.5) == [0.5, 1.0]
    channel.send(np.full(7, 0.75))
    assert told(channel, 6, 1.0) == [0.5, 1.0]
    channel.send(np.full(7, 0.875))
    assert told(channel, 7, 0.875) == [0.875, 0.875]
    # A robot that never tells what was sent is believed after some states.
    channel.send(np.full(7, 1.5))
    for number in range(9, 9 + CERTAIN):
        assert told(channel, number, 1.0) == [0.875, 1.5]
    assert told(channel, 9 + CERTAIN, 1.0) == [1.0, 1.5]


@kernel
def look_at(link, numbers):
    measure(link, arm_view(numbers))


def test_a_kernel_measures_as_python_does(loop, rng):
    driver, channel = loop.driver, loop.driver.robot.channel
    driver.use_tool(ToolTransform((0.02, 0.0, 0.1)))
    channel.put('q', driver.measured.position + rng.uniform(-0.3, 0.3, 7))
    channel.put('dq', rng.uniform(-1.0, 1.0, 7))
    channel.put('tau_ext_hat_filtered', rng.uniform(-1.0, 1.0, 7))
    driver.catch_up(np.zeros(7))
    look_at(link_of(driver), controller_of(loop).numbers)
    arm = loop.controller.memory
    for name in ('position', 'velocity', 'pose', 'jacobian', 'inertia', 'bias', 'external'):
        np.testing.assert_allclose(getattr(arm, name), getattr(driver.measured, name), atol=1e-12)
    np.testing.assert_allclose(arm.acceleration, driver.measured.jdot_qdot, atol=1e-12)
    assert arm.scalars.potential == 0.0


@contextmanager
def answering(monkeypatch, answer):
    """A server at the port of a robot that gives one answer, None for silence."""
    with socket.create_server(('127.0.0.1', 0)) as server:
        monkeypatch.setattr(greeting, 'PORT', server.getsockname()[1])

        def serve():
            client, _ = server.accept()
            with client:
                client.recv(1024)
                if answer is not None:
                    client.sendall(answer)
                client.recv(1024)
        thread = threading.Thread(target=serve)
        thread.start()
        yield
        thread.join()


@pytest.mark.parametrize('answer, why', [
    (None, 'does not answer: timed out'),
    (b'HTTP/1.1 400 Bad Request', 'does not speak the protocol of a Franka'),
    (struct.pack('<IIIBH', 0, 1, 15, 1, 5), 'version 5 of the protocol, .*older Panda'),
    (struct.pack('<IIIBH', 0, 1, 15, 1, 11), 'version 11 .* update pylibfranka')])
def test_who_is_no_robot_that_is_understood_is_said_at_once(monkeypatch, answer, why):
    begun = time.monotonic()
    with answering(monkeypatch, answer), pytest.raises(ArmStopped, match=why):
        FrankaRobot(FrankaSettings(host='127.0.0.1'))
    assert time.monotonic() - begun < 3.0
