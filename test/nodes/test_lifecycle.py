"""Transitions, parameters, simulated time, and replaying a recorded goal switch."""
import time

from gdmp_msgs.msg import Reference
from gdmp_msgs.srv import StepSimulation
from geometry_msgs.msg import PoseStamped
from lifecycle_msgs.msg import Transition
import numpy as np
import pytest
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import DescribeParameters, SetParameters
from rclpy.serialization import deserialize_message, serialize_message
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool, Trigger

from gdmp_ros.data.bags import BagWriter, opened
from gdmp_ros.ros import messages
from gdmp_ros.ros.lifecycle import reliable
from gdmp_ros.ros.recorder.record import definition
from gdmp_ros.ros.server.parameters import SPECS

FRAME = 'panda_link0'
SERVER, SIM = 'trajectory_server', 'panda_sim'


def test_nodes_go_through_their_lifecycle(world):
    world.start_sim(autostart=False)
    world.start_server(autostart=False)
    for node in (SIM, SERVER):
        assert world.lifecycle_state(node) == 'unconfigured'
        assert world.transition(node, Transition.TRANSITION_CONFIGURE)
        assert world.lifecycle_state(node) == 'inactive'
        assert world.transition(node, Transition.TRANSITION_ACTIVATE)
        assert world.lifecycle_state(node) == 'active'
    world.operator.wait_status('holding', 15.0)
    world.listen()
    world.wait('references', lambda: len(world.references) > 100)
    for node in (SERVER, SIM):
        assert world.transition(node, Transition.TRANSITION_DEACTIVATE)
        assert world.lifecycle_state(node) == 'inactive'
    count = len(world.references)
    world.spin(0.5)
    stopped = len(world.references)
    world.spin(0.5)
    assert len(world.references) == stopped < count + 500
    assert world.transition(SERVER, Transition.TRANSITION_ACTIVATE)
    world.wait('references again', lambda: len(world.references) > stopped + 100)
    assert world.transition(SERVER, Transition.TRANSITION_DEACTIVATE)
    assert world.transition(SERVER, Transition.TRANSITION_CLEANUP)
    assert world.lifecycle_state(SERVER) == 'unconfigured'
    assert world.transition(SERVER, Transition.TRANSITION_CONFIGURE)
    for node in (SERVER, SIM):
        assert world.children.stop(node) == 0


def test_a_failed_configuration_says_why_and_leaves_the_node_unconfigured(world, tmp_path):
    world.start_server(skill=str(tmp_path / 'none.json'), autostart=False)
    world.start_sim(model=str(tmp_path / 'none.xml'), autostart=False)
    for node, word in ((SERVER, 'none.json'), (SIM, 'none.xml')):
        assert not world.transition(node, Transition.TRANSITION_CONFIGURE)
        assert world.lifecycle_state(node) == 'unconfigured'
        assert word in world.log(node)


def test_a_failed_activation_leaves_nothing_running(world):
    world.listen()
    world.start_server(autostart=False, execute_on_activate=True)
    assert world.transition(SERVER, Transition.TRANSITION_CONFIGURE)
    assert not world.transition(SERVER, Transition.TRANSITION_ACTIVATE)
    assert world.lifecycle_state(SERVER) == 'inactive'
    assert 'no measured pose has arrived' in world.log(SERVER)
    reply = world.call(Trigger, f'{SERVER}/start')
    assert not reply.success and world.references == []
    assert world.transition(SERVER, Transition.TRANSITION_CLEANUP)
    assert world.children.stop(SERVER) == 0


def test_starting_without_a_measured_pose_is_refused_with_the_topic(world):
    world.start_server()
    reply = world.call(Trigger, f'{SERVER}/start')
    assert not reply.success
    assert 'no measured pose has arrived on /panda_sim/measured_pose' in reply.message


def test_parameters_have_descriptions_ranges_and_are_checked(world):
    world.start_server()
    described = world.call(DescribeParameters, f'{SERVER}/describe_parameters',
                           names=[spec.name for spec in SPECS]).descriptors
    assert all(d.description for d in described)
    ranged = {d.name: d for d in described}
    assert ranged['damping_ratio'].floating_point_range[0].to_value == 2.0
    assert '[Hz]' in ranged['rate_hz'].description

    def set_parameter(name, value):
        kind = {str: ParameterType.PARAMETER_STRING, float: ParameterType.PARAMETER_DOUBLE}
        field = {str: 'string_value', float: 'double_value'}[type(value)]
        message = Parameter(name=name, value=ParameterValue(type=kind[type(value)],
                                                            **{field: value}))
        return world.call(SetParameters, f'{SERVER}/set_parameters',
                          parameters=[message]).results[0]

    assert set_parameter('measured_pose_age', 0.3).successful
    refused = set_parameter('measured_pose_age', 99.0)
    assert not refused.successful
    refused = set_parameter('start_from', 'anywhere')
    assert not refused.successful and 'expected one of measured, skill' in refused.reason
    refused = set_parameter('connection', 'published')
    assert not refused.successful and 'while the node is configured' in refused.reason


def test_a_parameter_out_of_range_at_start_up_is_one_clear_line(world):
    world.children.start_node(SERVER, 'gdmp_ros.ros.server.node',
                              {'workspace_min': [0.0, 0.0]})
    process = world.children.processes.pop(SERVER)
    assert process.wait(60) != 0
    assert 'workspace_min has 2 entries, expected 3' in world.log(SERVER)


def test_the_simulation_pauses_steps_and_resets(world):
    world.start_sim()
    world.wait('the robot', lambda: len(world.robot) > 100, 60.0)
    refused = world.call(StepSimulation, f'{SIM}/step_simulation', steps=10)
    assert not refused.success and 'not paused' in refused.message
    assert world.call(SetBool, f'{SIM}/set_pause', data=True).success
    world.spin(0.3)
    count = len(world.robot)
    world.spin(0.3)
    assert len(world.robot) == count
    first = world.call(StepSimulation, f'{SIM}/step_simulation', steps=1)
    second = world.call(StepSimulation, f'{SIM}/step_simulation', steps=250)
    assert first.success and second.success
    assert second.time - first.time == pytest.approx(0.25, abs=1e-9)
    world.wait('251 states', lambda: len(world.robot) == count + 251)
    too_many = world.call(StepSimulation, f'{SIM}/step_simulation', steps=10**6)
    assert not too_many.success and 'expected 1 to 100000' in too_many.message
    assert world.call(SetBool, f'{SIM}/set_pause', data=False).success
    assert world.call(Trigger, f'{SIM}/reset_world').success
    world.wait('the robot again', lambda: len(world.robot) > count + 400)
    np.testing.assert_allclose(world.tool()[:3], [0.3069, 0, 0.4869], atol=1e-3)


def test_the_simulation_runs_as_fast_as_it_can_with_a_clock(world):
    clocks = []
    world.collect(Clock, '/clock', clocks)
    world.start_sim(pace='fast')
    world.wait('the clock', lambda: len(clocks) > 200, 60.0)
    stamps = np.array([m.clock.sec + m.clock.nanosec * 1e-9 for m in clocks])
    assert (np.diff(stamps) > 0.0).all()
    assert np.median(np.diff(stamps)) == pytest.approx(1e-3, abs=1e-6)


class Replay:
    """Drives a server by /clock in lock step: each tick waits for its reference."""

    def __init__(self, world):
        self.world, self.references = world, []
        node = world.node
        self.clock = node.create_publisher(Clock, '/clock', reliable(100))
        self.pose = node.create_publisher(PoseStamped, f'{SERVER}/goal_pose', reliable(10))
        self.matrix = node.create_publisher(Float64MultiArray, f'{SERVER}/goal_stiffness',
                                            reliable(10))
        world.collect(Reference, f'{SERVER}/reference', self.references)
        world.wait('the server', lambda: self.pose.get_subscription_count() > 0
                   and self.matrix.get_subscription_count() > 0
                   and self.clock.get_subscription_count() > 1, 60.0)

    def tick(self, message):
        count, ends = len(self.references), time.monotonic() + 5.0
        self.clock.publish(message)
        while len(self.references) == count:
            assert time.monotonic() < ends, 'a tick brought no reference'
            self.world._look()

    def settle(self):
        """Goals overtake no clock tick: give them time to arrive."""
        self.world.spin(0.2)


def start_replayed_server(world):
    world.start_server(start_from='skill', execute_on_activate=True, use_sim_time=True)
    world.operator.wait_status('moving', 60.0)
    return Replay(world)


def test_a_recorded_goal_switch_is_replayed_to_the_same_reference(world, skill, tmp_path):
    replay, bag = start_replayed_server(world), tmp_path / 'switch'
    goal = skill.goal[:7].copy()
    goal[:3] += [0.02, -0.1, 0.05]
    stiffness = np.diag([300.0, 700.0, 350.0])
    text = dict(zip(('definition', 'digest'), definition('gdmp_msgs/msg/Reference')))
    with BagWriter(bag) as writer:
        for k in range(1, 2600):
            stamp = k * 1_000_000
            if k == 900:
                message = PoseStamped()
                message.header.frame_id = FRAME
                messages.set_pose(message.pose, goal)
                matrix = Float64MultiArray(data=stiffness.reshape(-1).tolist())
                replay.pose.publish(message)
                replay.matrix.publish(matrix)
                replay.settle()
                writer.raw(f'/{SERVER}/goal_pose', 'geometry_msgs/msg/PoseStamped', stamp - 1,
                           serialize_message(message))
                writer.raw(f'/{SERVER}/goal_stiffness', 'std_msgs/msg/Float64MultiArray',
                           stamp - 1, serialize_message(matrix))
            clock = Clock(clock=messages.stamp_of(stamp))
            replay.tick(clock)
            writer.raw('/clock', 'rosgraph_msgs/msg/Clock', stamp, serialize_message(clock))
            writer.raw(f'/{SERVER}/reference', 'gdmp_msgs/msg/Reference', stamp + 1,
                       serialize_message(replay.references[-1]), **text)
    recorded = np.array([messages.reference_target(m) for m in replay.references])
    # The switch is real: the recorded path ends at the new goal and not at the skill's.
    assert np.linalg.norm(recorded[-1, :3] - goal[:3]) < 0.02

    assert world.children.stop(SERVER) == 0
    world.operator.state = None
    replay = start_replayed_server(world)
    kinds = {'/clock': Clock, f'/{SERVER}/goal_pose': PoseStamped,
             f'/{SERVER}/goal_stiffness': Float64MultiArray, f'/{SERVER}/reference': Reference}
    expected = []
    with opened(bag) as reader:
        for connection, _, raw in reader.messages():
            message = deserialize_message(raw, kinds[connection.topic])
            if connection.topic == '/clock':
                replay.tick(message)
            elif connection.topic.endswith('goal_pose'):
                replay.pose.publish(message)
            elif connection.topic.endswith('goal_stiffness'):
                replay.matrix.publish(message)
                replay.settle()
            else:
                expected.append(messages.reference_target(message))
    replayed = np.array([messages.reference_target(m) for m in replay.references])
    np.testing.assert_allclose(replayed, expected, rtol=0.0, atol=1e-9)
