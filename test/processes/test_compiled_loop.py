"""The loops without the interpreter, over real DDS; no result depends on time."""
from contextlib import contextmanager
import ctypes
import inspect
import sys
import threading

from gdmp_msgs.msg import Reference, RobotState
from geometry_msgs.msg import PoseStamped
import numpy as np
import pytest
import rclpy
from rclpy.executors import Executor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from gdmp_ros.control.arm_states import Request, State
from gdmp_ros.control.gripper import GripperCommand
from gdmp_ros.control.joint_motion import PostureMotion
from gdmp_ros.control.joint_target import resting_joints
from gdmp_ros.control.limits import LIMITS
from gdmp_ros.control.modes import StreamMode
from gdmp_ros.control.target import resting_target
from gdmp_ros.dmp.primitive import GripperEvent
from gdmp_ros.playback.gripper_sequence import GripperCommands, GripperSequence
from gdmp_ros.playback.objects import ObjectSettings
from gdmp_ros.realtime.loop import NS
from gdmp_ros.realtime.native import ATTENTION
from gdmp_ros.ros import dds
from gdmp_ros.ros.arm import compiled_loop, simulated_arm
from gdmp_ros.ros.messages import (
    fill_joint_reference,
    fill_reference,
    fill_robot_state,
    pose_message,
    ROBOT_STATE_FIXED,
    robot_state_numbers,
    stamp_of,
)
from gdmp_ros.ros.middleware import DEEP, reliable
from gdmp_ros.ros.rcl import Arrivals
from gdmp_ros.ros.server import compiled_loop as compiled_server
from gdmp_ros.ros.server.node import TrajectoryServer
from test.playback.hand import Hand
from test.processes.loop_bed import LoopBed

TOPIC = '/trajectory_server/reference'
#: Nothing that this test does in time is late for the arm.
PATIENT = ['--ros-args', '-p', 'stamp_tolerance:=10.0', '-p', 'reference_timeout:=1.0']


class Bed(LoopBed):
    """A simulated arm, and a client."""

    def __init__(self, *parameters):
        rclpy.init(args=[*PATIENT, *(word for one in parameters for word in ('-p', one))])
        self.client = dds.Dds().client('test')
        self.node = simulated_arm.node()
        assert self.node.trigger_configure().name == 'SUCCESS'
        self.backend, self.control = self.node.backend, self.node.control
        self.commands, self.loop = self.node.commands, self.node.backend.compiled
        self.out = self.node.state_out
        self._sender = self.client.publisher(Reference, TOPIC, reliable(DEEP))
        self.states = self.client.subscription(RobotState, '/panda_sim/state', reliable(DEEP))
        while not (self._sender.subscribers() and self.out.states.subscribers()):
            self.client.spin(0.01)
        next(self.out.show(self.node.clock))  # it looks for subscribers
        self.node.active = True
        self.backend.begin()
        self.control.activate()
        self._sequence, self.cycles = 0, self.backend.cycles()

    def send(self, mode=StreamMode.STREAMING, frame='panda_link0', joints=False, away=0.0):
        """Send the next reference of a stream, near the robot."""
        self._sequence += 1
        message = Reference(sequence=self._sequence, mode=int(mode))
        message.header.frame_id = frame
        message.header.stamp = stamp_of(self.node.clock.wall())
        measured = self.backend.model.measure()
        if joints:
            fill_joint_reference(message, resting_joints(measured.position, np.full(7, 100.0)))
        else:
            target = resting_target(measured.pose)
            target[0] += away
            fill_reference(message, target)
        self._sender.publish(message)

    def count_advances(self, monkeypatch):
        """A list that gets an item for each tick that Python makes from now on."""
        made, advance = [], self.backend._advance
        monkeypatch.setattr(self.backend, '_advance',
                            lambda *each: made.append(0) or advance(*each))
        return made


@pytest.fixture
def bed(domain):
    made = Bed()
    yield made
    made.close()


def test_every_tick_is_sent_once(bed, monkeypatch):
    by_python = []
    monkeypatch.setattr(bed.backend, '_advance', lambda *_: by_python.append(0))
    before = bed.out.written[0]
    bed.loop.numbers[ATTENTION] = 0
    threading.Timer(0.3, bed.loop.call).start()
    next(bed.cycles)
    assert len(by_python) == 1  # the one for which it was called
    found = bed.received()
    ticks = [one.tick for one in found]
    assert ticks == list(range(before + 1, bed.out.written[0] + 1)) and len(ticks) > 10
    stamps = np.array([one.header.stamp.sec * 10**9 + one.header.stamp.nanosec for one in found])
    assert (np.diff(stamps) > 0).all()
    last = RobotState()
    fill_robot_state(last, bed.out.numbers[:ROBOT_STATE_FIXED + 21])
    assert found[-1].position == last.position
    assert np.array_equal(found[-1].limited, last.limited)
    assert found[-1].mode == bed.control.states.state.mode


@pytest.mark.parametrize('by_python', [False, True], ids=['compiled', 'interpreter'])
def test_parts_of_the_state_are_sent_in_some_of_the_ticks(bed, by_python):
    topics = {'/panda_sim/measured_pose': PoseStamped,
              '/panda_sim/applied_stiffness': Float64MultiArray,
              '/panda_sim/requested_stiffness': Float64MultiArray, '/joint_states': JointState}
    parts = [bed.client.subscription(kind, topic, reliable(DEEP))
             for topic, kind in topics.items()]
    while not all(part.stream.publisher.subscribers() for part in bed.out.parts):
        bed.client.spin(0.01)
    bed.out._check()
    bed.out.every[0] = 7
    begins = int(bed.out.written[0])
    if by_python:
        for _ in range(100):
            bed.backend._advance(bed.node.clock.wall(), bed.node.clock.wall())
    else:
        bed.loop.numbers[ATTENTION] = 0
        while bed.out.written[0] < begins + 100:
            threading.Timer(0.1, bed.loop.call).start()
            next(bed.cycles)
    states = [one for one in bed.received() if one.tick > begins]
    expected = [[one for one in states if (one.tick - k) % 7 == 0] for k in range(4)]
    found = []
    for part, ticks in zip(parts, expected):
        messages = []
        while len(messages) < len(ticks):
            message = part.take_message()
            if message is not None:
                messages.append(message)
        assert part.take_message() is None
        found.append(messages)
    poses, applied, requested, joints = found
    for pose, state in zip(poses, expected[0], strict=True):
        assert pose.header.stamp == state.header.stamp and pose.pose == state.pose
    for one, state in zip(applied, expected[1], strict=True):
        assert list(one.data) == list(state.stiffness)
    for one, state in zip(requested, expected[2], strict=True):
        assert list(one.data) == list(state.requested_stiffness)
    for one, state in zip(joints, expected[3], strict=True):
        assert one.header.stamp == state.header.stamp
        assert list(one.position) == list(state.position)
        assert list(one.effort) == list(state.torque)


def test_it_needs_no_lock_of_the_interpreter(bed):
    sleep_with_the_lock = ctypes.PyDLL(None).usleep
    thread = threading.Thread(target=lambda: next(bed.cycles))
    bed.loop.numbers[ATTENTION] = 0
    thread.start()
    made, interval = 0, sys.getswitchinterval()
    try:
        # No other thread gets the lock between the two looks.
        sys.setswitchinterval(1000.0)
        while made < 20:
            before = bed.out.written[0]
            sleep_with_the_lock(20_000)
            made += bed.out.written[0] - before
    finally:
        sys.setswitchinterval(interval)
    bed.loop.call()
    thread.join()


def guide(bed):
    bed.control.do(Request.GUIDE)


def follow_joints(bed):
    assert bed.control.follow(resting_joints(bed.backend.model.measure().position,
                                             np.full(7, 100.0)))


@pytest.mark.parametrize('begin', [lambda bed: None, guide, follow_joints],
                         ids=['tool', 'guided', 'joints'])
def test_the_state_of_a_kernel_is_that_of_the_interpreter(bed, begin):
    bed.run(lambda: bed.out.written[0] > 50)
    begin(bed)
    tick = bed.control.answer(bed.backend.driver.measure())
    expected = robot_state_numbers(tick)
    found = np.full(ROBOT_STATE_FIXED + 42, np.nan)
    found[99 + len(LIMITS):ROBOT_STATE_FIXED] = 0.0
    controller = compiled_loop.controller_of(bed.control)
    of_joints = compiled_loop.write_state(controller.numbers, controller.target, found)
    assert of_joints == (begin is follow_joints) == (len(expected) == len(found))
    np.testing.assert_array_equal(found[:len(expected)], expected)


@pytest.mark.parametrize('joints', [False, True], ids=['tool', 'joints'])
def test_a_stream_is_followed_without_the_interpreter(bed, monkeypatch, joints):
    offered, offer = [], bed.commands.offer
    monkeypatch.setattr(bed.commands, 'offer', lambda *each: offered.append(0) or offer(*each))
    bed.send(joints=joints)
    bed.run(lambda: bed.commands.sequence == 1)
    assert bed.control.states.state is State.FOLLOWING and len(offered) == 1
    for _ in range(30):
        bed.send(joints=joints)
    monkeypatch.setattr(bed.commands, 'take_references', lambda _: None)
    bed.run(lambda: bed.commands.sequence == 31)
    assert bed.control.states.state is State.FOLLOWING and len(offered) == 1
    # What is sent then says what is followed.
    state = bed.received()[-1]
    assert state.sequence == 31 and len(state.joint_reference) == joints
    if joints:
        np.testing.assert_allclose(state.joint_reference[0].position, state.position, atol=0.01)
        # From 200 Nm/rad towards the 100 that are wanted.
        assert 100.0 <= max(state.joint_reference[0].stiffness) < 200.0


@pytest.mark.parametrize('request_', [Request.GUIDE, Request.COMPLY])
def test_a_hand_moves_the_arm(bed, monkeypatch, request_):
    """Python reads where the hand is; the ticks in which it pulls need no interpreter."""
    answer = bed.commands.ask(request_)
    bed.run(lambda: answer.done)
    assert not answer.refusal
    place = bed.backend.model.measure().pose
    place[0] += 0.1
    message = PoseStamped(pose=pose_message(place))
    message.header.frame_id = 'panda_link0'
    by_python, before = bed.count_advances(monkeypatch), bed.out.written[0]
    while bed.backend.model.measure().pose[0] < place[0] - 0.08:
        bed.backend._on_hand(message)
        next(bed.cycles)  # the tick in which the message is read
        threading.Timer(0.05, bed.loop.call).start()
        next(bed.cycles)
    assert bed.backend.driver.hand.holds
    assert bed.out.written[0] - before > 5 * len(by_python)
    # Without messages it lets go.
    while bed.backend.driver.hand is not None:
        threading.Timer(0.05, bed.loop.call).start()
        next(bed.cycles)


def test_fingers_move_without_the_interpreter(domain, monkeypatch):
    """A command calls Python for one tick."""
    bed = Bed('gripper:=true')
    try:
        gripper = bed.backend.driver.gripper
        by_python, before = bed.count_advances(monkeypatch), bed.out.written[0]
        number = gripper.command(GripperCommand(0.02))
        while gripper.state.moving or gripper.state.commands < number:
            threading.Timer(0.1, bed.loop.call).start()
            next(bed.cycles)
        assert gripper.state.width == pytest.approx(0.02, abs=2e-3)
        assert bed.out.written[0] - before > 10 * len(by_python)
    finally:
        bed.close()


def test_joints_move_without_the_interpreter(bed, monkeypatch):
    """A stream that rests goes on meanwhile, and asks for nothing."""
    goal = bed.backend.model.measure().position + 0.05
    bed.commands.ask(Request.MOVE, PostureMotion(bed.control.joints, goal[None], 1.0))
    bed.run(lambda: bed.control.states.state is State.MOVING)
    advanced = bed.count_advances(monkeypatch)
    monkeypatch.setattr(bed.control.controller.guard, 'offer',
                        lambda *_: pytest.fail('a reference was decided in Python'))
    for _ in range(5):
        bed.send(StreamMode.HOLDING)
    bed.loop.numbers[ATTENTION] = 0
    while bed.control.states.state is State.MOVING:
        next(bed.cycles)  # until Python is needed
    assert not advanced and bed.control.joint_motion.done
    modes = [one.mode for one in bed.received()]
    assert modes.count(RobotState.MOVE) > 300
    assert np.abs(bed.backend.model.measure().position - goal).max() < 0.01


@pytest.mark.parametrize(('sent', 'why'), [
    ({'frame': 'another'}, "frame is 'another'"), ({'away': 0.3}, 'the motion begins'),
    ({'joints': True}, '')], ids=['frame', 'far', 'joints'])
def test_other_references_are_decided_in_python(bed, sent, why):
    bed.send(**sent)
    guard = bed.control.controller.guard
    bed.run(lambda: guard.refused > 0 or guard.following)
    assert (why in guard.last_refusal) and guard.following == (not why)


@pytest.mark.parametrize('size', [3, 100, 20_000])
def test_what_is_no_reference_is_refused(bed, size):
    bed._sender.send(b'\x00\x01\x00\x00' + bytes(size))
    guard = bed.control.controller.guard
    bed.run(lambda: guard.refused > 0)
    assert guard.last_refusal and not guard.following


def test_what_is_destroyed_under_a_running_loop_is_kept_until_it_returns(bed):
    before = bed.out.written[0]
    bed.loop.numbers[ATTENTION] = 0
    failed = []

    def run():
        try:
            next(bed.cycles)
        except Exception as error:
            failed.append(type(error).__name__)
    thread = threading.Thread(target=run)
    thread.start()
    while bed.out.written[0] < before + 10:
        pass
    bed.node.release()
    reached = bed.out.written[0]
    while bed.out.written[0] < reached + 10:
        pass
    bed.loop.call()
    thread.join()
    # The tick that Python makes then has nothing to send with: the node reports that.
    assert failed == ['InvalidHandle']


def test_the_last_state_is_whole(bed, monkeypatch):
    out, asked = bed.out, []

    class Torn(np.ndarray):
        def copy(self):
            asked.append(0)
            # A tick is written meanwhile, the first time.
            out.written[0] += len(asked) == 1
            if len(asked) == 2:
                out.written[1] = out.written[0]
            return np.array(self)
    monkeypatch.setattr(out, 'numbers', out.numbers.view(Torn))
    out.last()
    assert len(asked) == 3


def test_without_handles_every_tick_is_made_by_the_interpreter(domain, monkeypatch):
    @contextmanager
    def hidden(made):
        yield 0
    monkeypatch.setattr(dds, '_in_use', hidden)
    bed = Bed()
    try:
        assert bed.loop is None
        before = bed.out.written[0]
        for _ in range(5):
            next(bed.cycles)
        bed.send()
        while not bed.control.controller.guard.following:
            next(bed.cycles)
        assert bed.received()[-1].tick >= before + 5
    finally:
        bed.cycles.close()
        bed.close()


@pytest.fixture
def server(domain, skill_file):
    """A server that is activated without its threads, and the references of its client."""
    rclpy.init(args=['--ros-args', '-p', f'skill:={skill_file}', '-p', 'start_from:=skill'])
    client, node = dds.Dds().client('test'), TrajectoryServer()
    assert node.trigger_configure().name == 'SUCCESS'
    references = client.subscription(Reference, TOPIC, reliable(DEEP))
    while not node._references.streams[0].publisher.subscribers():
        client.spin(0.01)
    node.streamer.activate(node._period_ns())
    yield node, references
    node.streamer.active = False
    node.take_down()
    node.destroy_node()
    client.close()
    rclpy.shutdown()


def test_a_motion_is_streamed_without_the_interpreter(server, monkeypatch):
    node, references = server
    by_python, tick = [], node.streamer.tick_only
    monkeypatch.setattr(node.streamer, 'tick_only', lambda *each: by_python.append(0)
                        or tick(*each))
    cycles, loop = node._ticks(), node._compiled
    loop.look()
    node.streamer.begin()
    found, ended = [], threading.Event()

    def call():
        while not ended.wait(0.02):
            loop.call()
    thread = threading.Thread(target=call)
    thread.start()
    try:
        while len(found) < 500:
            next(cycles)
            while (message := references.take_message()) is not None:
                found.append(message)
    finally:
        ended.set()
        thread.join()
    sequences = np.array([one.sequence for one in found])
    assert (np.diff(sequences) == 1).all()
    stamps = np.array([one.header.stamp.sec * 10**9 + one.header.stamp.nanosec for one in found])
    steps = np.diff(stamps)
    assert (steps > 0).all() and len(by_python) < len(found)
    assert {one.mode for one in found} == {int(StreamMode.STREAMING)}
    assert found[-1].pose.position.x != found[0].pose.position.x


def test_a_message_wakes_the_thread_that_waits_for_it(server):
    """It waits without a limit that a test could reach, and is not woken for what it has taken."""
    node, references = server
    with Arrivals([references]) as arrivals:
        assert not arrivals.wait_until(0)
        stream = node._references.streams[0]
        for _ in range(3):
            stream.publish(np.zeros(stream.template.layout()[1].size), 1, 1, 1)
        taken = 0
        while taken < 3:
            assert arrivals.wait_until(node.clock.now() + 60 * NS)
            while references.take() is not None:
                taken += 1
        assert not arrivals.wait_until(node.clock.now() + NS // 100)
    stream.publish(np.zeros(stream.template.layout()[1].size), 1, 1, 1)
    assert not arrivals.wait_until(node.clock.now() + NS // 10)


@pytest.mark.parametrize('objects', [[], ['box']])
def test_a_goal_is_used_when_it_comes(server, objects):
    """Where the robot is, and the object, is looked for far more rarely here."""
    node, _ = server
    node.streamer.objects.settings = ObjectSettings(objects=objects)
    node._period_ns = lambda: 10 * NS
    looking, used = node._look_around(node._compiled), []
    poll = node._poll
    node._poll = lambda came: used.append(0) or poll(came)
    client = dds.Dds().client('goals')
    sender = client.publisher(Float64MultiArray, '/trajectory_server/goal_stiffness', reliable(1))
    while not sender.subscribers():
        client.spin(0.01)
    next(looking)
    sender.publish(Float64MultiArray(data=[100.0] * 5))
    while node.streamer.refusals.count == 0:
        assert next(looking) <= node.clock.now()  # it does not sleep before it uses the goal
    assert len(used) <= 2 and 'goal_stiffness' in node.streamer.refusals.last
    looking.close()
    client.close()


def test_goals_are_taken_only_when_some_have_come(server, monkeypatch):
    node, _ = server
    node._poll()
    taken, poll = [], node.goals.poll
    monkeypatch.setattr(node.goals, 'poll', lambda timeout: taken.append(0) or poll(timeout))
    node._poll(False)
    assert not taken
    # While a skill of the joints is played, they are taken elsewhere, and used afterwards.
    with monkeypatch.context() as meanwhile:
        meanwhile.setattr(type(node.streamer), 'joints', 7)
        node._poll(True)
        assert not taken
    node._poll(False)
    node._poll(False)
    assert len(taken) == 1
    # One that waits for its frame needs no other message.
    client = dds.Dds().client('goals')
    sender = client.publisher(PoseStamped, '/trajectory_server/goal_pose', reliable(1))
    while not sender.subscribers():
        client.spin(0.01)
    message = PoseStamped()
    message.header.frame_id = 'nowhere'
    sender.publish(message)
    while not node.goals.waiting:
        node._poll(True)
    taken.clear()
    while node.goals.waiting:
        node._poll(False)
    assert len(taken) > 1 and 'nowhere' in node.streamer.refusals.last
    client.close()


def test_commands_of_a_gripper_interrupt_the_ticks_without_the_interpreter(server, monkeypatch):
    node, references = server
    streamer, hand = node.streamer, Hand()
    streamer.gripper = GripperSequence(GripperCommands(hand))
    skill = streamer.player.tool.skill
    streamer.use(skill.with_events([GripperEvent(0.05, 0.02, 0.0, 0.1)]), 'grasp')
    by_python, tick = [], streamer.tick_only
    monkeypatch.setattr(streamer, 'tick_only', lambda *each: by_python.append(0) or tick(*each))
    cycles, loop, found = node._ticks(), node._compiled, []
    loop.look()
    streamer.begin()
    while not hand.sent:
        next(cycles)
    # The motion comes to rest behind the place of the command, and goes on when it is done.
    assert 0.05 <= streamer.player.rollout.progress < 0.1
    begun = len(by_python)
    while streamer.gripper.waits_for_more(streamer.player):
        next(cycles)
    awaited = len(by_python)
    assert awaited - begun >= hand.needs
    threading.Timer(0.2, loop.call).start()
    while (message := references.take_message()) is not None:
        found.append(message)
    next(cycles)
    while len(by_python) < awaited + 1:
        next(cycles)
    while not found or found[-1].sequence < node._references.sequence:
        message = references.take_message()
        if message is not None:
            found.append(message)
    assert (np.diff([one.sequence for one in found]) == 1).all()
    assert streamer.player.rollout.speed > 0.0


def test_objects_are_looked_for_more_often_than_the_robot(server):
    """Also where the ticks are rare: these last as long as 15 of the usual ones."""
    node, _ = server
    node.streamer.objects.settings = ObjectSettings(objects=['box'])
    node._period_ns = lambda: NS // 66
    looking, polls, looks = node._look_around(node._compiled), [], []
    poll, look = node._poll, node.streamer.look
    node._poll = lambda came: polls.append(0) or poll(came)
    node.streamer.look = lambda: looks.append(0) or look()
    for _ in range(50):
        next(looking)
        if len(polls) > len(looks):
            break
    looking.close()
    assert len(polls) > len(looks)


def test_time_passes_while_the_interpreter_makes_no_tick(server):
    """What waits for the robot, and goals for later, count it."""
    node, _ = server
    cycles, loop, streamer, ended = node._ticks(), node._compiled, node.streamer, []
    streamer.begin()

    def run():
        while not ended:
            next(cycles)
    thread = threading.Thread(target=run)
    thread.start()
    while streamer.player.rollout is None or not streamer.only_goes_on:
        pass
    before, begun, then = streamer.ticks, streamer.time, streamer.now
    # Nothing calls the loop: the interpreter makes no tick.
    while streamer.time < begun + 0.05:
        pass
    assert streamer.now - then >= 0.049
    ended.append(0)
    loop.call()
    thread.join()
    assert streamer.ticks > before


def test_a_place_is_not_read_while_it_is_written(server):
    loop, numbers, asked = server[0]._compiled, np.zeros(7), []

    def read():
        asked.append(0)
        # A tick is begun meanwhile, the first time.
        loop.numbers[compiled_server.BEGUN] += len(asked) == 1
        if len(asked) == 2:
            loop.numbers[compiled_server.WHOLE] = loop.numbers[compiled_server.BEGUN]
        return numbers
    found = loop.whole(read)
    assert len(asked) == 3 and found is not numbers


def test_this_rclpy_has_inside_what_is_used_of_it(domain):
    """If this fails after an update, `gdmp_ros.ros.dds` is the file to look at."""
    rclpy.init()
    node = LifecycleNode('version')
    publisher = node.create_publisher(Reference, 'a', 1)
    subscription = node.create_subscription(Reference, 'a', print, 1)
    assert publisher.handle.pointer and subscription.handle.pointer
    assert callable(publisher.handle.publish_raw) and callable(subscription.handle.take_message)
    assert callable(node._service_change_state.callback)
    names = list(inspect.signature(Executor._wait_for_ready_callbacks).parameters)
    assert names == ['self', 'timeout_sec', 'nodes', 'condition']
    assert 'wait_for_ready_callbacks' in vars(Executor)
    rclpy_implementation.WaitSet(1, 0, 0, 0, 0, 0, node.context.handle).clear_entities()
    node.destroy_node()
    dds.destroy_rest(node)
    rclpy.shutdown()
