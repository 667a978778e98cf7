"""
The loop that answers a Franka without the interpreter, over real sockets.

Instead of the functions of rcl it calls functions of the C library that return at once.
"""
import ctypes
import socket
import threading

import numpy as np
import pytest

from gdmp_ros.control.arm_states import State
from gdmp_ros.control.identification import FrictionIdentification
from gdmp_ros.control.joint_motion import PostureMotion
from gdmp_ros.control.plain_tick import controller_of, OTHER
from gdmp_ros.control.target import resting_target
from gdmp_ros.franka.channel import Channel, COMMAND_SIZE
from gdmp_ros.franka.plain_cycle import link_of
from gdmp_ros.realtime.loop import NS
from gdmp_ros.realtime.native import (
    addresses,
    ATTENTION,
    clock_functions,
    semaphore,
    semaphore_functions,
    wait_for_post,
)
from gdmp_ros.realtime.statistics import LatenessRecorder
from gdmp_ros.ros.arm import compiled_loop, franka_loop
from gdmp_ros.ros.arm.franka_loop import ANSWERED, Herald, Outbox, Times, UNDECIDED
from test.franka.test_channel import packed, POSITION

#: For `rcl_take_serialized_message`: nothing has come; the message in memory has come.
NOTHING, SOMETHING = 'getpid', 'sched_yield'


class Answering:
    """
    The loop in a thread of its own, and the robot, which the test plays.

    :ivar numbers: of the loop
    """

    def __init__(self, control, takes):
        self.control, self.driver = control, control.driver
        self._robot, own = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
        for one in (self._robot, own):
            one.bind(('127.0.0.1', 0))
            one.settimeout(5.0)
        self._own, self._position, self._number = own, self.driver.measured.position, 0
        self.driver.robot.channel = Channel(own.fileno())
        franka_loop.warm_up(control, link_of(self.driver))
        self.numbers, links, scratch = compiled_loop.idle(franka_loop.COUNT)
        self.numbers[ATTENTION] = 0
        self._junk = np.zeros(100, dtype=np.uint8)
        taken = np.array([self._junk.ctypes.data, len(self._junk)], dtype=np.int64)
        scratch = scratch._replace(
            state=np.zeros(500), written=np.zeros(5, dtype=np.int64), time=np.zeros(2, int))
        calls = semaphore_functions()
        self.herald = Herald(calls, semaphore())
        outbox = Outbox(calls, semaphore(), scratch.time, np.zeros((1, 8), dtype=np.uint8),
                        np.zeros((1, 5), dtype=np.int64))
        lateness, work = (np.frombuffer(LatenessRecorder(NS).numbers, dtype=np.int64)
                          for _ in range(2))
        arguments = (
            self.numbers, Times(clock_functions(), lateness, work),
            links._replace(functions=addresses(ctypes.CDLL(None), takes, NOTHING), taken=taken),
            scratch, outbox, self.herald, link_of(self.driver), controller_of(control), False)
        self._thread = threading.Thread(target=self._run, args=arguments)
        self._thread.start()

    def _run(self, *arguments):
        # A test that is held up is a robot that is silent.
        while franka_loop.run(*arguments) == OTHER:
            pass

    def _send(self):
        self._number += 1
        state = packed(self._number, [(POSITION, self._position)])
        self._robot.sendto(state, self._own.getsockname())

    def answers(self, count):
        """Send states; every one is answered."""
        for _ in range(count):
            self._send()
            assert len(self._robot.recv(2048)) == COMMAND_SIZE

    def is_called(self):
        """Whether Python was called since the last time."""
        return bool(wait_for_post(self.herald.calls, self.herald.posted, np.zeros(2, int), 0))

    def take_over(self):
        """Let the loop return before or after one more state."""
        self.numbers[ATTENTION] = 1
        self._send()
        self._thread.join()
        self.control.catch_up()

    def close(self):
        """End the loop."""
        self.numbers[ATTENTION] = 1
        self._thread.join()
        for one in (self._robot, self._own):
            one.close()


@pytest.fixture
def answering(loop):
    made = []

    def begin(takes=NOTHING):
        made.append(Answering(loop, takes))
        return made[-1]
    channel = loop.driver.robot.channel
    yield begin
    for one in made:
        one.close()
    loop.driver.robot.channel = channel


def test_a_robot_is_answered_while_python_is_to_decide(loop, answering):
    made = answering(SOMETHING)
    made.answers(50)
    assert made.numbers[UNDECIDED] > 0  # when it came
    # Once, however long it takes.
    assert made.is_called() and not made.is_called()
    made.take_over()
    assert made.numbers[ANSWERED] >= 50 and loop.states.state is State.HOLDING


def test_a_stream_that_is_lost_stops_before_python_knows_it(loop, answering):
    target = resting_target(loop.driver.measured.pose)
    target[8] = 0.05
    loop.controller.guard.arm()
    assert loop.follow(target)
    made = answering()
    made.answers(60)
    assert not made.is_called()
    made.answers(440)  # it was lost after 0.1 s, and has stopped after another 0.3 s
    assert made.is_called() and loop.states.state is State.FOLLOWING
    assert np.abs(loop.controller.guard.targets[0][7:13]).max() == 0.0
    made.take_over()
    assert loop.states.state is State.HOLDING
    assert 'no reference for 0.1 s' in loop.states.reason


@pytest.mark.parametrize('kind', ['posture', 'identification'])
def test_joints_that_have_arrived_stay_until_python_knows_it(loop, answering, kind):
    goal = loop.driver.measured.position.copy()
    if kind == 'posture':
        goal += 0.002
        motion = PostureMotion(loop.joints, goal[None], 1.0)
    else:
        motion = FrictionIdentification(loop.joints, loop.driver.chain, (0.3,), 0.02)
    loop.move(motion)
    loop.compute(loop.driver.measured, 0.001)
    before, made = loop.states.state, answering()
    while not motion.done:
        made.answers(100)
    made.answers(500)
    assert made.is_called() and loop.states.state is before
    np.testing.assert_array_equal(loop.controller.memory.wanted, goal)
    np.testing.assert_array_equal(loop.controller.memory.wanted_rate, 0.0)
    made.take_over()
    assert loop.states.state is State.HOLDING and not loop.joint_motion_problem
