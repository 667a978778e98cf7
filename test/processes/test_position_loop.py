"""The loop of an arm that takes joint positions, over real DDS; no result depends on time."""
import threading
import time

from gdmp_msgs.msg import Reference, RobotState
from geometry_msgs.msg import WrenchStamped
import numpy as np
import pytest
import rclpy
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, Float64MultiArray

from gdmp_ros.control.arm_states import State
from gdmp_ros.control.modes import StreamMode
from gdmp_ros.control.target import resting_target, STIFFNESS
from gdmp_ros.ros import dds
from gdmp_ros.ros.arm import position_arm
from gdmp_ros.ros.messages import fill_reference, stamp_of
from gdmp_ros.ros.middleware import DEEP, latched, reliable
from gdmp_ros.sim.arm import Arm
from test.processes.loop_bed import LoopBed

NAME, RUNNING = 'position_arm', '/running'
#: Nothing that this test does in time is late for the arm.
PATIENT = [('stamp_tolerance', 10.0), ('reference_timeout', 1.0), ('measured_timeout', 1.0),
           ('following_error', 1.0), ('running_topic', RUNNING)]


class Robot:
    """
    An arm that is where it was told to be, and says so, in a thread of its own.

    :ivar names: of the joints, in the order of its messages; a finger comes first
    :ivar position: by name
    :ivar wrench: that its sensor measures
    :ivar commands: that it has taken
    """

    def __init__(self):
        self.participant, self.arm = dds.Dds().client('robot'), Arm('ur5e')
        self.names = ['finger', *reversed(self.arm.names)]
        self.position = dict(zip(self.arm.names, self.arm.home.tolist())) | {'finger': 0.01}
        self.wrench, self.commands, self.velocities = np.zeros(6), 0, True
        made = self.participant.publisher
        self._joints = made(JointState, '/joint_states', reliable(1))
        self._felt = made(WrenchStamped, '/force_torque_sensor_broadcaster/wrench', reliable(1))
        self.running = made(Bool, RUNNING, latched(1))
        self._taken = self.participant.subscription(
            Float64MultiArray, '/forward_position_controller/commands', reliable(10))
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._live)
        self._thread.start()

    def _live(self):
        while not self._ended.wait(0.002):
            message = self._taken.newest_message()
            if message is not None:
                self.commands += 1
                self.position.update(zip(self.arm.names, message.data))
            stamp = stamp_of(time.time_ns())
            state = JointState(name=self.names, position=[self.position[n] for n in self.names])
            if self.velocities:
                state.velocity = [0.0] * len(self.names)
            felt = WrenchStamped()
            felt.header.frame_id = 'tool0'
            (felt.wrench.force.x, felt.wrench.force.y, felt.wrench.force.z) = self.wrench[:3]
            for message, out in ((state, self._joints), (felt, self._felt)):
                message.header.stamp = stamp
                out.publish(message)

    @property
    def tool(self):
        """Where its tool is."""
        position = np.array([self.position[name] for name in self.arm.names])
        return self.arm.chain.pose_at(position, self.arm.end_pose)

    def close(self):
        self._ended.set()
        self._thread.join()
        self.participant.close()


class Bed(LoopBed):
    """An arm that takes joint positions, and its robot."""

    every_s = 0.05

    def __init__(self):
        rclpy.init(args=['--ros-args', *(word for name, value in PATIENT
                                         for word in ('-p', f'{name}:={value}'))])
        self.robot, self.node = Robot(), position_arm.node()
        self.client = self.robot
        assert self.node.trigger_configure().name == 'SUCCESS'
        self.backend, self.control = self.node.backend, self.node.control
        self.loop, self.out = self.backend.compiled, self.node.state_out
        participant = self.robot.participant
        self._sender = participant.publisher(Reference, '/trajectory_server/reference',
                                             reliable(DEEP))
        self.states = participant.subscription(RobotState, f'/{NAME}/state', reliable(DEEP))
        while not (self._sender.subscribers() and self.out.states.subscribers()):
            participant.spin(0.01)
        next(self.out.show(self.node.clock))  # it looks for subscribers
        self.node.active = True
        self.backend.begin()
        self.control.activate()
        self._sequence, self.cycles = 0, self.backend.cycles()

    def send(self, target):
        self._sequence += 1
        message = Reference(sequence=self._sequence, mode=int(StreamMode.STREAMING))
        message.header.frame_id = 'base_link'
        message.header.stamp = stamp_of(self.node.clock.wall())
        fill_reference(message, target)
        self._sender.publish(message)


@pytest.fixture
def bed(domain):
    made = Bed()
    yield made
    made.close()


@pytest.fixture
def by_python(bed, monkeypatch):
    """Ticks that Python makes; they are made."""
    made, tick = [], bed.backend._tick
    monkeypatch.setattr(bed.backend, '_tick', lambda stamp: made.append(stamp) or tick(stamp))
    return made


def test_a_stream_is_followed_without_the_interpreter(bed, by_python):
    home, ticks = bed.robot.tool, bed.out.written[0]
    target = resting_target(home)
    target[STIFFNESS:STIFFNESS + 36] = np.diag([2000.0] * 3 + [50.0] * 3).ravel()
    for k in range(1, 31):
        target[1] = home[1] + 5e-4 * min(k, 10)
        bed.send(target)
        bed.run(lambda k=k: bed.node.commands.sequence == k)
    assert bed.control.states.state is State.FOLLOWING
    assert bed.robot.tool[1] - home[1] == pytest.approx(0.005, abs=1e-3)
    # Python makes those for which it was called: one in 50 ms, and one for each reference of the
    # test, which calls it.
    assert bed.out.written[0] - ticks > 2 * len(by_python)
    assert bed.robot.commands > 30
    found = bed.received()
    assert [one.tick for one in found] == list(range(1, len(found) + 1))
    # States have the joints of the robot, in the order of its model.
    assert found[-1].position == pytest.approx(
        [bed.robot.position[name] for name in bed.robot.arm.names], abs=2e-3)


def test_a_force_moves_it(bed, by_python):
    before = bed.robot.tool
    bed.robot.wrench[:] = [0.0, 0.0, 15.0, 0.0, 0.0, 0.0]
    bed.run(lambda: np.linalg.norm((bed.robot.tool - before)[:3]) > 0.01)
    # Along the axis of the flange, which points down.
    away = bed.robot.tool[:3] - before[:3]
    assert away[2] < -0.9 * np.linalg.norm(away)
    assert bed.out.written[0] > 2 * len(by_python)


def stop_the_program(bed):
    bed.robot.running.publish(Bool(data=False))


def break_the_sensor(bed):
    bed.robot.wrench[:] = np.nan


def fall_silent(bed):
    bed.robot._ended.set()


@pytest.mark.parametrize(('fault', 'reason'), [
    (stop_the_program, 'its own program does not run'),
    (break_the_sensor, 'the measured wrench is not finite'),
    (fall_silent, 'no measured')])
def test_what_it_cannot_trust_stops_it(bed, by_python, fault, reason):
    bed.run(lambda: bed.robot.commands > 20)
    fault(bed)
    # Nothing but the loop itself notices it.
    bed.every_s, by_python[:] = 1e3, []
    bed.run(lambda: bed.control.states.state is State.FAULT)
    assert reason in bed.control.states.reason and not by_python


def test_messages_that_change_are_read_by_python(bed, monkeypatch):
    """Another order of the joints, and then no velocities."""
    taken, take = [], bed.backend.link.take_joints
    monkeypatch.setattr(bed.backend.link, 'take_joints',
                        lambda *each: taken.append(0) or take(*each))

    def run_on():
        before = bed.out.written[0]
        bed.run(lambda: bed.out.written[0] > before + 50)
    run_on()
    taken.clear()
    bed.robot.names = sorted(bed.robot.names)
    run_on()
    assert 0 < len(taken) < 30 and bed.control.states.state is State.HOLDING
    taken.clear()
    bed.robot.velocities = False
    run_on()
    assert len(taken) > 30 and bed.control.states.state is State.HOLDING
