"""
Nodes as processes over DDS: how they start, are found, and end.

What nodes do is tested in lockstep. Here nothing depends on how fast the machine is.
"""
from functools import partial
import os
from pathlib import Path
import re
import signal
import subprocess
import sys
import time

from gdmp_msgs.action import ExecuteSkill
from gdmp_msgs.msg import RecorderState, Reference, ServerState
from geometry_msgs.msg import PoseStamped, TransformStamped
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
import numpy as np
import pytest
from rcl_interfaces.srv import GetParameters
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import String
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage

from gdmp_ros import Demonstration, Skill
from gdmp_ros.data import bags, runs
from gdmp_ros.ros.clients.server_client import ServerClient
from gdmp_ros.ros.clients.testbed import ARM, MODULES, SERVER, TAKE_RECORDER
from gdmp_ros.ros.messages import pose_numbers, set_transform, stamp_of
from gdmp_ros.ros.middleware import best_effort, reliable
from gdmp_ros.util.dds_network import Domain
from gdmp_ros.util.processes import ChildProcesses
from test.commands import GDMP, gdmp_process
from test.ros.nodes import ACTIVATE, CLEANUP, CONFIGURE, DEACTIVATE, FRAME

PRESETS = Path(__file__).parents[2] / 'config' / 'presets'


def at_the_goal(result):
    """Whether the robot is at the goal; otherwise a busy machine has kept it from there."""
    assert result.error_code in (result.SUCCESSFUL, result.GOAL_TOLERANCE_VIOLATED,
                                 result.BLOCKED), result.error_string
    return result.error_code == result.SUCCESSFUL


def test_a_node_that_cannot_start_ends_with_1_and_one_that_was_shut_down_ends(nodes):
    for name, parameters, reason in (('no display', {'headless': False}, 'use headless: true'),
                                     ('no model', {'model': 'nowhere.xml'}, 'no such file')):
        if name == 'no display' and any(map(os.environ.get, ('DISPLAY', 'WAYLAND_DISPLAY'))):
            continue  # a window would open
        nodes.children.start_node(name, MODULES[ARM], parameters)
        assert nodes.children.processes[name].wait(60.0) == 1
        assert reason in nodes.log(name)
        nodes.may_end.add(name)
    nodes.children.start_node(ARM, MODULES[ARM], {})
    request = ChangeState.Request()
    nodes.wait_log(ARM, 'the arm follows', 60.0)
    request.transition.id = Transition.TRANSITION_ACTIVE_SHUTDOWN
    nodes.may_end.add(ARM)
    assert nodes.call(ChangeState, f'{ARM}/change_state', transition=request.transition).success
    assert nodes.children.processes[ARM].wait(10.0) == 0


def test_every_node_starts_goes_through_its_lifecycle_and_ends_at_sigterm(nodes, tmp_path):
    preset = ['--params-file', str(PRESETS / 'crisp.yaml')]
    for name, module, parameters, extra in (
            (SERVER, MODULES[SERVER], {}, []), (ARM, MODULES[ARM], {}, []),
            ('visualizer', 'gdmp_ros.ros.visualizer.node', {}, []),
            ('adapter', 'gdmp_ros.ros.adapter', {}, preset),
            (TAKE_RECORDER, MODULES[TAKE_RECORDER], {'folder': str(tmp_path / 'takes')}, [])):
        nodes.children.start_node(name, module, {**parameters, 'autostart': False}, extra)
    names = list(nodes.children.processes)
    for name in names:
        nodes._states[name] = 'unconfigured'
        assert nodes.lifecycle_state(name) == 'unconfigured'
        assert not nodes.transition(name, ACTIVATE)
        assert nodes.transition(name, CONFIGURE, ACTIVATE)
        assert nodes.lifecycle_state(name) == 'active'
    for name in names:
        assert nodes.transition(name, DEACTIVATE, CLEANUP, CONFIGURE)
    for name in names:
        assert nodes.children.stop(name) == 0
        assert 'Traceback' not in nodes.log(name), nodes.log(name)


def test_the_main_job_recorded_while_the_goal_is_switched(nodes, skill):
    nodes.start()
    nodes.record()
    nodes.client.execute()
    nodes.wait_progress(0.33)
    goal = skill.goal[:7] + [0.03, -0.11, 0.04, 0, 0, 0, 0]
    nodes.client.goal_pose(goal, FRAME)
    reached = at_the_goal(nodes.client.result(60.0))
    nodes.spend(0.5)
    run = nodes.recorded()
    assert len(run.sequences) > 1000 and runs.lost(run) == 0
    assert np.linalg.norm(run.references[-1, :3] - goal[:3]) < 1e-3
    assert not reached or np.linalg.norm(run.poses[-1, :3] - goal[:3]) < 0.02
    assert (np.abs(run.torques) <= [87] * 4 + [12] * 3).all()


def test_the_arm_holds_when_the_server_is_killed_and_follows_the_next_one(nodes):
    nodes.start()
    nodes.client.execute()
    nodes.wait_progress(0.3)
    nodes.children.kill(SERVER)
    nodes.wait_rest()
    held = nodes.tool()
    nodes.client.state = None
    nodes.start_server('second_server')
    nodes.wait_holding()
    nodes.wait_rest()
    assert np.linalg.norm(nodes.tool()[:3] - held[:3]) < 1e-3
    nodes.client.execute()
    at_the_goal(nodes.client.result(60.0))


def test_nodes_find_each_other_in_any_order_and_a_command_finds_them(nodes, skill_file):
    """The server waits for its arm, and the terminal for the pose of the arm."""
    nodes.start_server()
    nodes.client.wait_status('idle', 60.0)
    executing = subprocess.Popen([*GDMP, 'run', str(skill_file),
                                  '--tempo', '0.2'],
                                 stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert executing.stdout.readline().startswith('waiting for the pose of the robot')
        nodes.start_arm()
        nodes.wait('a motion', lambda: (nodes.client.state.status == 'moving'
                                        or executing.poll() is not None), 60.0)
        assert executing.poll() is None, executing.communicate()
        executing.send_signal(signal.SIGINT)
        said, problem = executing.communicate(timeout=60)
        assert 'stopped' in said and executing.returncode == 130, problem
    finally:
        executing.kill()
        executing.wait()
    nodes.client.wait_status('holding', 20.0)


def test_qualities_of_service(nodes):
    """Best-effort and late subscribers are served; the history of a topic can be overridden."""
    override = f'qos_overrides./{SERVER}/reference.publisher.depth'
    nodes.start(server={override: 7})
    received = {'best effort': [], 'late': []}
    nodes.participant.subscription(
        PoseStamped, f'{ARM}/measured_pose',
        QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT),
        received['best effort'].append)
    nodes.subscribe(String, 'robot_description', received['late'].append, 1, late=True)
    nodes.wait('both', lambda: all(received.values()), 30.0)
    assert '<link name="panda_link0">' in received['late'][0].data
    found = nodes.call(GetParameters, f'{SERVER}/get_parameters', names=[override]).values
    assert found[0].integer_value == 7


def _see_and_look(nodes, publisher, board):
    """Send where a board is, and return whether the motion is done."""
    seen = TransformStamped(child_frame_id='board')
    seen.header.frame_id = FRAME
    seen.header.stamp = stamp_of(nodes.client.clock.wall())
    set_transform(seen.transform, board)
    publisher.publish(TFMessage(transforms=[seen]))
    return nodes.client.done()


def test_objects_on_tf_are_followed_whatever_their_quality(nodes, skill, tmp_path):
    path = skill.reproduce(0.02)
    Skill.learn(Demonstration(path.times, path.points, skill.manifold, frames={
        'start': skill.start[:7], 'board': skill.goal[:7]}), start_frame='start',
        goal_frame='board').save(tmp_path / 'among.json')
    # A busy machine may send late.
    nodes.start(server={'moving_objects': ['board'], 'object_age': 20.0})
    for quality, height in ((best_effort(10), 0.02), (reliable(10), 0.04)):
        publisher = nodes.participant.publisher(TFMessage, '/tf', quality)
        board = skill.goal[:7] + np.array([0.0, 0.0, height, 0.0, 0.0, 0.0, 0.0])
        look = partial(_see_and_look, nodes, publisher, board)
        nodes.wait('the publisher to be found', lambda publisher=publisher, look=look: (
            look() or publisher.subscribers()), 30.0)
        for _ in range(10):
            look()
            nodes.spend(0.05)
        nodes.client.execute(ExecuteSkill.Goal(skill=str(tmp_path / 'among.json')))
        for _ in range(10):
            look()
            nodes.spend(0.05)
        board += [0.0, 0.03, 0.0, 0.0, 0.0, 0.0, 0.0]
        nodes.wait('the end', look, 60.0)
        at_the_goal(nodes.client.result(10.0))
        nodes.wait('the goal to be there', lambda board=board: np.linalg.norm(
            pose_numbers(nodes.client.state.goal[0])[:3] - board[:3]) < 1e-3)


def test_parameters_come_from_the_command_line_and_from_files(nodes, tmp_path):
    path = tmp_path / 'parameters.yaml'
    path.write_text('/**/panda_sim:\n  ros__parameters:\n    speed: 0.7\n    frame_id: base\n')
    nodes.start_arm(extra=['--params-file', str(path), '-r', '__ns:=/left'], torque_share=0.5)
    values = nodes.call(GetParameters, f'/left/{ARM}/get_parameters',
                        names=['speed', 'frame_id', 'torque_share']).values
    assert (values[0].double_value, values[1].string_value, values[2].double_value) == (
        0.7, 'base', 0.5)
    cases = [('workspace_min', [0.0, 0.0], 'workspace_min has 2 entries, expected 3'),
             ('speed', 99.0, 'speed out of range')]
    started = [subprocess.Popen(
        [sys.executable, '-m', MODULES[ARM], '--ros-args', '-p', f'{name}:={value}'],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) for name, value, _ in cases]
    for process, (_, _, reason) in zip(started, cases):
        error = process.communicate(timeout=240)[1]
        assert process.returncode == 2 and 'Traceback' not in error
        last = error.strip().splitlines()[-1]
        assert last.startswith('error: ') and reason in last


def test_one_process_streams_for_two_robots(nodes, skill_file):
    nodes.children.start('both', MODULES[SERVER], [
        '--robots', 'left', 'right', '--ros-args', '-p', f"skill:='{skill_file}'",
        '-p', 'start_from:=skill'])
    streams, states = {}, {}
    for name in ('left', 'right'):
        streams[name] = nodes.collect(Reference, f'/{name}/{SERVER}/reference')
        nodes.subscribe(ServerState, f'/{name}/{SERVER}/state',
                        lambda message, name=name: states.__setitem__(name, message))
    nodes.wait('both servers', lambda: len(states) == 2, 60.0)
    for name in ('left', 'right'):
        assert nodes.call(Trigger, f'/{name}/{SERVER}/start').success
        nodes.wait(f'the {name} stream', lambda name=name: len(streams[name]) > 500, 30.0)
    assert nodes.call(Trigger, f'/left/{SERVER}/stop').success
    nodes.wait('the left one to stop', lambda: states['left'].status == 'holding', 20.0)
    before = len(streams['right'])
    nodes.wait('the right one to continue', lambda: len(streams['right']) > before + 300, 20.0)


def test_several_nodes_in_one_process_with_simulated_time(nodes, skill_file):
    """The arm makes /clock, as fast as it can; the server makes a reference for each message."""
    nodes.children.start('composed', 'gdmp_ros.ros.composed', [
        SERVER, ARM, 'visualizer', '--ros-args', '-p', f"{SERVER}:skill:='{skill_file}'",
        '-p', f'{SERVER}:measured_pose_topic:=/{ARM}/measured_pose', '-p', f'{ARM}:pace:=fast',
        '-p', f'{SERVER}:use_sim_time:=true'])
    nodes.listen()
    nodes.client.wait_status('holding', 120.0)
    nodes.client.execute()
    at_the_goal(nodes.client.result(120.0))
    stamps = np.array([m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec
                       for m in nodes.references])
    assert stamps[0] < 1e6 and np.median(np.diff(stamps)) == pytest.approx(1e-3, abs=1e-6)
    assert '/visualizer' in nodes.participant.nodes()
    assert nodes.children.stop('composed', timeout=20.0) == 0


def test_a_take_is_kept_when_the_recorder_is_ended_in_the_middle_of_it(nodes, tmp_path):
    states, folder = [], tmp_path / 'takes'
    nodes.subscribe(RecorderState, f'{TAKE_RECORDER}/state', states.append)
    nodes.start_arm()
    nodes.children.start_node(TAKE_RECORDER, MODULES[TAKE_RECORDER], {
        'folder': str(folder), 'storage': 'sqlite3'})
    nodes.wait('the recorder', lambda: states and states[-1].status == 'ready', 60.0)
    assert nodes.call(Trigger, f'{TAKE_RECORDER}/start').success
    nodes.wait('messages', lambda: states[-1].messages > 20, 30.0)
    assert nodes.children.stop(TAKE_RECORDER) == 0
    found = {topic: count for topic, _, count in bags.topics(folder / 'take_001')}
    assert found[f'/{ARM}/measured_pose'] > 20


def test_ctrl_c_ends_a_node_that_is_being_configured(tmp_path):
    """Its kernels are compiled meanwhile, which takes much longer than what `launch` waits."""
    with Domain() as domain, ChildProcesses({
            **domain.environment(), 'GDMP_CACHE': str(tmp_path / 'cache')},
            tmp_path / 'logs') as children:
        children.start_node(ARM, MODULES[ARM], {})
        process, ends = children.processes[ARM], time.monotonic() + 120.0
        while not list((tmp_path / 'cache').rglob('*.nb*')):
            assert process.poll() is None and time.monotonic() < ends
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        assert process.wait(60.0) == 0
        assert 'ended while it was being configured' in children.log(ARM).read_text()


def test_two_clients_are_served_at_once(nodes):
    nodes.start()
    other = ServerClient()
    try:
        other.wait_status('holding', 30.0)
        nodes.client.execute()
        other.wait_status('moving', 30.0)
        other.execute()
        assert nodes.client.result(30.0).error_code == nodes.client.result(1.0).PREEMPTED
        assert other.cancel()
        assert re.match('stopped on request', other.result(30.0).error_string)
    finally:
        other.close()


@pytest.mark.long
def test_a_teaching_session_at_the_terminal(nodes, tmp_path):
    """Start and stop a take, discard it, ask for help, discard again, end."""
    folder = tmp_path / 'takes'
    done = gdmp_process('record', '-o', folder, '--by-hand', '--no-window',
                        given='\n\nd\nx\nd\nq\n')
    assert done.returncode == 0, done.stderr
    assert 'recording take_001' in done.stdout and 'dropped/take_001' in done.stdout
    assert 'no take of this session' in done.stdout and 'Enter: start a take' in done.stdout
    assert not list(folder.glob('take_*'))
