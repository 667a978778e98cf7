"""The node of an arm that takes joint positions, with the topics of ros2_control; lockstep."""
import os
from pathlib import Path

from gdmp_msgs.msg import ArmStatus
import numpy as np
import pytest
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, Float64, Float64MultiArray
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory
import yaml

from gdmp_ros import Demonstration, Skill
from gdmp_ros.cli.main import main
from gdmp_ros.manifolds.poses import tool_manifold
from gdmp_ros.ros import messages
from gdmp_ros.ros.arm.parameters import POSITION
from gdmp_ros.ros.middleware import latched, reliable
from gdmp_ros.sim.arm import Arm
from gdmp_ros.util.profiles import minimum_jerk

ARMS = Path(__file__).parents[2] / 'config' / 'arms'
NAME, MODULE, ROBOT = 'position_arm', 'gdmp_ros.ros.arm.position_arm', 'servo_sim'
POSE = tool_manifold(None)


@pytest.fixture
def arc(tmp_path):
    """An arc of 0.2 m beside the home posture of the arm, in 3 s."""
    times = np.linspace(0.0, 3.0, 300)
    s = minimum_jerk(times / 3.0)
    points = np.tile([0.4919, 0.1333, 0.3845, 0.0, -np.sqrt(0.5), np.sqrt(0.5), 0.0], (300, 1))
    points[:, 0] -= 0.1 * np.sin(np.pi * s)
    points[:, 1] -= 0.2 * s
    Skill.learn(Demonstration(times, points, POSE)).save(tmp_path / 'arc.json')
    return tmp_path / 'arc.json'


def begin(nodes, arc, trajectory=False, **parameters):
    """Robot, arm and server; the arm holds."""
    output = 'joint_trajectory_controller' if trajectory else 'forward_position_controller'
    nodes.children.start_node(ROBOT, 'gdmp_ros.ros.arm.servo_sim', {
        'joint_prefix': 'left_', 'output': output})
    robot = nodes.children.node(ROBOT)
    nodes.wait('the robot', lambda: hasattr(robot, 'servo'), 10.0)
    hand = robot.servo.hand
    nodes.status = []
    nodes.subscribe(ArmStatus, f'/{NAME}/status', nodes.status.append)
    nodes.children.start_node(NAME, MODULE, {
        'payload_mass': hand.mass, 'payload_center': list(hand.center),
        'output': output, **parameters})
    nodes.start_server(skill=str(arc), frame_id='base_link', reach_model='ur5e',
                       measured_pose_topic=f'/{NAME}/measured_pose',
                       arm_status_topic=f'/{NAME}/status')
    nodes.wait_holding()
    return robot


def test_a_model_is_made_of_what_a_running_driver_describes(nodes, tmp_path, monkeypatch):
    monkeypatch.setattr(os, 'environ', dict(os.environ))  # discovery is restricted there
    nodes.children.start_node(ROBOT, 'gdmp_ros.ros.arm.servo_sim', {})
    own, home = Arm('ur5e'), [0.3, -1.4, 1.2, -1.3, -1.5, 0.2]
    assert main(['arm', 'model', '--topic', '/robot_description', '--tip', 'flange',
                 '--home', *map(str, home), '-o', str(tmp_path / 'ur.xml')]) == 0
    made = Arm(str(tmp_path / 'ur.xml'))
    assert made.names == own.names and (tmp_path / 'ur.urdf').is_file()
    flange = Arm('ur5e', 'flange')
    assert POSE.distance(made.pose_at(made.home), flange.pose_at(np.array(home))) < 1e-6


def test_a_model_is_made_of_one_description(tmp_path, capsys):
    assert main(['arm', 'model', '--tip', 'flange', '--home', '0', '-o',
                 str(tmp_path / 'ur.xml')]) != 0
    assert '--topic' in capsys.readouterr().err


def parameters_of(arm):
    """Those of a file in ``config/arms``."""
    document = yaml.safe_load((ARMS / f'{arm}.yaml').read_text())
    return document['/**/position_arm']['ros__parameters']


@pytest.mark.parametrize('arm', [path.stem for path in ARMS.glob('*.yaml')])
def test_files_for_arms_have_parameters_that_the_node_takes(arm):
    known = {spec.name: spec for spec in POSITION}
    for name, value in parameters_of(arm).items():
        spec = known[name]
        assert isinstance(value, (int, float) if isinstance(spec.default, float)
                          else type(spec.default))
        assert not spec.choices or value in spec.choices
        for number in (value,) if isinstance(value, (int, float)) else ():
            assert (spec.low is None or number >= spec.low)
            assert (spec.high is None or number <= spec.high)


def test_the_file_of_universal_robots_moves_an_arm_like_theirs(nodes, arc):
    begin(nodes, arc, **parameters_of('universal_robots'))
    nodes.client.execute()
    result = nodes.client.result(30.0)
    assert (result.error_code, result.error_string) == (result.SUCCESSFUL, '')


@pytest.mark.parametrize('trajectory', [False, True], ids=['positions', 'trajectories'])
def test_it_follows_a_skill(nodes, arc, trajectory):
    robot = begin(nodes, arc, trajectory, horizon=0.02)
    sent = nodes.collect(JointTrajectory, '/joint_trajectory_controller/joint_trajectory')
    nodes.listen()
    nodes.client.execute()
    result = nodes.client.result(30.0)
    assert (result.error_code, result.error_string) == (result.SUCCESSFUL, '')
    nodes.spend(0.5)
    reference = messages.pose_numbers(nodes.references[-1].pose)
    assert np.linalg.norm(robot.servo.arm.site_pose('tcp')[:3] - reference[:3]) < 1e-3
    assert reference[1] == pytest.approx(-0.0667, abs=1e-3)
    assert robot.commands > 1000
    assert (len(sent) > 1000) == trajectory
    for message in sent:
        # As a joint_trajectory_controller takes a stream: it begins at once, with a velocity.
        stamp, (point,) = message.header.stamp, message.points
        assert (stamp.sec, stamp.nanosec) == (0, 0)
        assert list(message.joint_names) == list(robot.servo.arm.names)
        assert (point.time_from_start.sec, point.time_from_start.nanosec) == (0, 20_000_000)
        assert len(point.positions) == len(point.velocities) == 6
        assert not point.accelerations and not point.effort


def test_a_hand_moves_it(nodes, arc):
    robot = begin(nodes, arc)
    before = robot.servo.arm.site_pose('tcp')
    robot.push[:3] = [0.0, 20.0, 0.0]
    nodes.spend(5.0)
    moved = robot.servo.arm.site_pose('tcp')[1] - before[1]
    assert 0.01 < moved < 0.2
    robot.push[:] = 0.0
    nodes.spend(8.0)
    assert np.linalg.norm(robot.servo.arm.site_pose('tcp')[:3] - before[:3]) < 3e-3


@pytest.mark.parametrize(('what', 'reason'), [
    ('joints', 'no measured joints for'), ('wrench', 'no measured wrench for')])
def test_a_robot_that_says_nothing_any_more_is_left_alone_until_it_is_recovered(
        nodes, arc, what, reason):
    robot = begin(nodes, arc)
    nodes.client.execute()
    nodes.spend(1.5)
    robot.mute.add(what)
    nodes.wait('the fault', lambda: nodes.status[-1].state == 'fault', 5.0)
    assert reason in nodes.status[-1].reason
    nodes.spend(0.5)
    count = robot.commands
    nodes.spend(0.5)
    assert robot.commands == count
    assert not nodes.call(Trigger, f'{NAME}/recover').success
    robot.mute.clear()
    nodes.spend(0.2)
    at = robot.servo.arm.site_pose('tcp')
    assert nodes.call(Trigger, f'{NAME}/recover').success
    nodes.spend(1.0)
    assert np.linalg.norm(robot.servo.arm.site_pose('tcp')[:3] - at[:3]) < 1e-3
    assert nodes.status[-1].state == 'holding'


def test_the_joints_of_others_on_the_same_topic_do_not_matter(nodes, arc):
    others = nodes.participant.publisher(JointState, '/joint_states', reliable(10))
    nodes._made.append(others)
    robot = begin(nodes, arc)
    wrong = [name.replace('joint', 'other') for name in robot.servo.arm.names]

    def speak():
        others.publish(JointState(name=['finger'], position=[0.02]))
        # As long as those of the arm.
        others.publish(JointState(name=[f'left_{name}' for name in wrong], position=[9.0] * 6,
                                  velocity=[0.0] * 6, effort=[0.0] * 6))
    nodes.every(0.011, speak)
    nodes.client.execute()
    result = nodes.client.result(30.0)
    assert (result.error_code, result.error_string) == (result.SUCCESSFUL, '')
    assert nodes.status[-1].refused == 0


def test_an_arm_whose_program_has_stopped_takes_no_commands(nodes, arc):
    program = nodes.participant.publisher(Bool, '/running', latched(1))
    nodes._made.append(program)
    program.publish(Bool(data=True))
    robot = begin(nodes, arc, running_topic='/running')
    program.publish(Bool(data=False))
    nodes.wait('the fault', lambda: nodes.status[-1].state == 'fault', 5.0)
    assert 'its own program does not run' in nodes.status[-1].reason
    assert not nodes.call(Trigger, f'{NAME}/recover').success
    program.publish(Bool(data=True))
    nodes.spend(0.2)
    assert nodes.call(Trigger, f'{NAME}/recover').success
    count = robot.commands
    nodes.spend(0.5)
    assert robot.commands > count


def test_a_motion_is_as_slow_as_the_arm_executes_commands(nodes, arc):
    speed = nodes.participant.publisher(Float64, '/speed', reliable(10))
    nodes._made.append(speed)
    begin(nodes, arc, speed_scaling_topic='/speed')
    nodes.client.execute()
    nodes.wait_progress(0.1)
    speed.publish(Float64(data=25.0))
    nodes.spend(0.8)
    assert nodes.status[-1].scale == 0.25
    before = nodes.state.progress
    nodes.spend(1.0)
    # The motion takes 3 s.
    assert nodes.state.progress - before == pytest.approx(0.25 / 3.0, abs=0.01)
    speed.publish(Float64(data=float('nan')))  # says nothing
    nodes.spend(0.5)
    assert nodes.status[-1].scale == 0.25
    speed.publish(Float64(data=100.0))
    nodes.spend(0.8)
    before = nodes.state.progress
    nodes.spend(0.5)
    assert nodes.state.progress - before == pytest.approx(0.5 / 3.0, abs=0.02)
    result = nodes.client.result(30.0)
    assert (result.error_code, result.error_string) == (result.SUCCESSFUL, '')


def test_without_joint_states_it_says_so(nodes):
    nodes.children.start_node(NAME, MODULE, {'rate_hz': 250})
    nodes.spend(16.0)
    log = nodes.log(NAME)
    assert 'no joint states have arrived on joint_states: is the arm on?' in log


def test_without_a_sensor_it_says_so_once(nodes, arc):
    begin(nodes, arc, wrench_topic='')
    log = nodes.log(NAME)
    assert log.count('there is no sensor (wrench_topic): the arm follows stiffly') == 1


def test_the_order_of_the_joints_is_that_of_the_controller(nodes, arc):
    robot = begin(nodes, arc)
    home, order = robot.servo.arm.data.qpos.copy(), robot.servo.arm.names[::-1]
    nodes.children.stop(NAME)
    nodes.children.start_node(NAME, MODULE, {'joint_names': order, 'command_topic': '/other'})
    other = nodes.collect(Float64MultiArray, '/other')
    nodes.wait('a command', lambda: bool(other), 10.0)
    np.testing.assert_allclose(other[-1].data, home[::-1], atol=1e-3)
