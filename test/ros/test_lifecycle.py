"""Transitions of the lifecycle, and simulated time: a recorded goal switch is replayed."""

from gdmp_msgs.msg import Reference
from geometry_msgs.msg import PoseStamped
import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger

from gdmp_ros.data.bags import BagWriter, opened, reference_target
from gdmp_ros.ros import messages
from gdmp_ros.ros.clients.testbed import ARM, SERVER
from gdmp_ros.ros.recorder.record import definition
from test.ros.nodes import ACTIVATE, CLEANUP, CONFIGURE, DEACTIVATE, FRAME, open_testbed


@pytest.fixture(scope='module')
def unconfigured_nodes(tmp_path_factory, skill_file):
    with open_testbed(tmp_path_factory.mktemp('nodes'), skill_file) as made:
        made.start_arm(autostart=False)
        made.start_server(autostart=False)
        yield made
        for node in (SERVER, ARM):
            assert made.children.stop(node) == 0


@pytest.fixture
def unconfigured(unconfigured_nodes):
    """Arm and server that are not configured, with their parameters as at the start."""
    yield unconfigured_nodes
    unconfigured_nodes.unconfigure()
    unconfigured_nodes.forget()


def test_nodes_go_through_their_lifecycle(unconfigured):
    nodes = unconfigured
    for node in (ARM, SERVER):
        assert nodes.lifecycle_state(node) == 'unconfigured'
        assert nodes.transition(node, CONFIGURE)
        assert nodes.lifecycle_state(node) == 'inactive'
        assert nodes.transition(node, ACTIVATE)
        assert nodes.lifecycle_state(node) == 'active'
    nodes.client.wait_status('holding', 60.0)
    nodes.listen()
    nodes.wait('references', lambda: len(nodes.references) > 100)
    for node in (SERVER, ARM):
        assert nodes.transition(node, DEACTIVATE)
        assert nodes.lifecycle_state(node) == 'inactive'
    nodes.wait_quiet(nodes.references)
    stopped = len(nodes.references)
    # Where the arm is now is not known before it reports.
    nodes.spend(0.7)
    assert nodes.transition(SERVER, ACTIVATE)
    nodes.spend(0.5)
    assert len(nodes.references) == stopped
    assert nodes.transition(ARM, ACTIVATE)
    nodes.wait('references again', lambda: len(nodes.references) > stopped + 100)
    assert nodes.transition(SERVER, DEACTIVATE, CLEANUP)
    assert nodes.lifecycle_state(SERVER) == 'unconfigured'
    assert nodes.transition(SERVER, CONFIGURE)


def test_a_failed_configuration_says_why_and_can_be_repeated(unconfigured, tmp_path):
    for node, name, good in ((SERVER, 'skill', str(unconfigured.skill_file)), (ARM, 'model', '')):
        missing = str(tmp_path / f'missing_{name}')
        assert unconfigured.set_parameters(node, **{name: missing}).successful
        assert not unconfigured.transition(node, CONFIGURE)
        assert unconfigured.lifecycle_state(node) == 'unconfigured'
        unconfigured.wait('the reason', lambda node=node, missing=missing: (
            f'configure: {missing}' in unconfigured.log(node)))
        assert unconfigured.set_parameters(node, **{name: good}).successful
        assert unconfigured.transition(node, CONFIGURE)


def test_a_failed_activation_leaves_nothing_running(unconfigured):
    unconfigured.listen()
    assert unconfigured.set_parameters(SERVER, execute_on_activate=True).successful
    assert unconfigured.transition(SERVER, CONFIGURE)
    assert not unconfigured.transition(SERVER, ACTIVATE)
    assert unconfigured.lifecycle_state(SERVER) == 'inactive'
    unconfigured.wait('the reason',
                      lambda: 'no measured pose has arrived' in unconfigured.log(SERVER))
    reply = unconfigured.call(Trigger, f'{SERVER}/start')
    assert not reply.success
    unconfigured.wait_quiet(unconfigured.references)
    assert not unconfigured.references
    assert unconfigured.transition(SERVER, CLEANUP)
    assert unconfigured.set_parameters(SERVER, execute_on_activate=False).successful


class Replay:
    """Drives a server by /clock in lock step: each tick waits for its reference."""

    def __init__(self, nodes):
        self.nodes = nodes
        self.clock = nodes.publisher(Clock, '/clock')
        self.pose = nodes.publisher(PoseStamped, f'{SERVER}/goal_pose')
        self.matrix = nodes.publisher(Float64MultiArray, f'{SERVER}/goal_stiffness')
        #: Of each tick, and all that came.
        self.references, self._streamed = [], nodes.collect(Reference, f'{SERVER}/reference')
        self.last, self.ticks = Clock(), 0
        nodes.wait('the server', lambda: self.clock.subscribers() > 0, 60.0)

    def tick(self, message):
        self._tick(message)
        self.references.append(self._streamed[-1])

    def _tick(self, message):
        count, self.last = len(self._streamed), message
        self.ticks += 1
        self.clock.publish(message)
        self.nodes.wait('the reference of a tick', lambda: len(self._streamed) > count)

    def switch(self, pose, matrix):
        """Publish goals; repeat the last tick, in which no time passes, until both are used."""
        self.nodes.wait('the present state', lambda: self.nodes.state.ticks == self.ticks)
        before = self.nodes.state.distance_to_goal[2]
        self.pose.publish(pose)
        self.matrix.publish(matrix)

        def used():
            self._tick(self.last)
            state = self.nodes.state
            return (messages.pose_numbers(state.goal[0])[:3] == pytest.approx(
                messages.pose_numbers(pose.pose)[:3])
                    and state.distance_to_goal[2] != before)
        self.nodes.wait('both goals to be used', used)


def start_replayed_server(nodes):
    nodes.start_server(start_from='skill', execute_on_activate=True, use_sim_time=True)
    nodes.client.wait_status('moving', 60.0)
    return Replay(nodes)


@pytest.mark.long
def test_a_recorded_goal_switch_is_replayed_to_the_same_reference(nodes, skill, tmp_path):
    replay, bag = start_replayed_server(nodes), tmp_path / 'switch'
    goal = skill.goal[:7].copy()
    goal[:3] += [0.02, -0.1, 0.05]
    text = dict(zip(('definition', 'digest'), definition('gdmp_msgs/msg/Reference')))
    pose = PoseStamped()
    pose.header.frame_id = FRAME
    messages.set_pose(pose.pose, goal)
    matrix = Float64MultiArray(data=np.diag([300.0, 700.0, 350.0]).reshape(-1).tolist())
    kinds = {'/clock': Clock, f'/{SERVER}/goal_pose': PoseStamped,
             f'/{SERVER}/goal_stiffness': Float64MultiArray, f'/{SERVER}/reference': Reference}
    names = {topic: f'{kind.__module__.split(".")[0]}/msg/{kind.__name__}'
             for topic, kind in kinds.items()}
    with BagWriter(bag) as writer:
        def write(topic, stamp, message, **extra):
            writer.raw(topic, names[topic], stamp, serialize_message(message), **extra)

        for k in range(1, 800):
            stamp = k * 4_000_000
            if k == 225:
                replay.switch(pose, matrix)
                write(f'/{SERVER}/goal_pose', stamp - 2, pose)
                write(f'/{SERVER}/goal_stiffness', stamp - 1, matrix)
            replay.tick(Clock(clock=messages.stamp_of(stamp)))
            write('/clock', stamp, replay.last)
            write(f'/{SERVER}/reference', stamp + 1, replay.references[-1], **text)
    recorded = np.array([reference_target(m) for m in replay.references])
    # The recorded path ends at the new goal, not at that of the skill.
    assert np.linalg.norm(recorded[-1, :3] - goal[:3]) < 0.02

    assert nodes.children.stop(SERVER) == 0
    nodes.forget()
    nodes.spend(0.2)  # discard states of the first server
    nodes.client.state = None
    replay = start_replayed_server(nodes)
    expected = []
    with opened(bag) as reader:
        for connection, _, raw in reader.messages():
            message = deserialize_message(raw, kinds[connection.topic])
            if connection.topic == '/clock':
                replay.tick(message)
            elif connection.topic.endswith('goal_pose'):
                pose = message
            elif connection.topic.endswith('goal_stiffness'):
                replay.switch(pose, message)
            else:
                expected.append(reference_target(message))
    replayed = np.array([reference_target(m) for m in replay.references])
    np.testing.assert_allclose(replayed, expected, rtol=0.0, atol=1e-9)
