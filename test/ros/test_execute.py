"""`gdmp run` executes the skill of a running server from the terminal."""
import re

import numpy as np
import pytest

from gdmp_ros import Demonstration, Skill
from gdmp_ros.ros import messages
from gdmp_ros.ros.clients.server_client import ServerClient
from gdmp_ros.ros.clients.testbed import ARM, SERVER
from test.commands import gdmp
from test.ros.nodes import ACTIVATE, CONFIGURE
from test.ros.test_frames import static_broadcaster, transform


@pytest.fixture
def execute():
    """`gdmp run`: exit code and output."""
    return lambda *words: gdmp('run', *words)


def test_it_executes_switches_the_goal_and_prints_the_result(running, skill_file, execute):
    code, out, err = execute('--tempo', '2')
    assert code == 0, err
    assert 'the goal was reached; distance of the reference: position' in out
    assert re.search(r'of the robot: [0-9.]+ mm, [0-9.]+ rad', out)
    running.wait('this tempo', lambda: running.state.speed == pytest.approx(2.0, 0.05))
    goal = messages.pose_numbers(running.state.goal[0])[:3] + [0.0, 0.05, 0.03]
    numbers = [f'{value:.4f}' for value in goal]
    code, out, _ = execute(skill_file, '--goal-position', *numbers, '--switch-at', '0.3')
    assert code == 0 and 'the goal is switched to' in out
    running.wait('the tool to be there',
                 lambda: np.linalg.norm(running.tool()[:3] - goal) < 0.01)
    # The state is reported ten times a second.
    running.wait('the end to be reported', lambda: running.state.status == 'holding')
    motions = running.state.progress
    code, _, err = execute('--goal-position', '5', '0', '0.3', '--switch-at', '0.2')
    assert code == 1 and 'goal x is 5.000 m, outside the workspace' in err.splitlines()[-1]
    assert running.state.status == 'holding' and running.state.progress == motions
    # Later than the end of the motion: it goes on to the goal that was asked for.
    goal[1] -= 0.05
    code, out, _ = execute('--goal-position', *[f'{value:.4f}' for value in goal],
                           '--switch-at', '6')
    assert code == 0 and 'the goal is switched to' in out
    running.wait('the tool to be there',
                 lambda: np.linalg.norm(running.tool()[:3] - goal) < 0.01)
    code, _, err = execute('--tempo', '7')
    assert code == 2 and '--tempo: is 7, expected' in err
    code, _, err = execute('nowhere.json')
    assert code == 1 and 'nowhere.json: no such skill, sequence or bag' in err


def test_a_skill_among_objects_is_executed_where_they_are(running, skill_file, execute, tmp_path):
    letter = Skill.load(skill_file)
    path = letter.reproduce(0.02)
    among = Skill.learn(Demonstration(path.times, path.points, letter.manifold, frames={
        'start': letter.start[:7], 'goal': letter.goal[:7]}))
    among.save(tmp_path / 'among.json')
    board = letter.goal[:7].copy()
    board[:3] += [0.02, 0.03, 0.02]
    numbers = [f'{value:.6f}' for value in board]
    code, out, err = execute(tmp_path / 'among.json', '--tempo', '1', '--object', 'goal', *numbers)
    assert code == 0 and 'the goal was reached' in out, err
    assert np.linalg.norm(running.tool()[:3] - board[:3]) < 0.01
    board[1] -= 0.04
    code, out, err = execute(tmp_path / 'among.json', '--goal-position', *[
        f'{value:.6f}' for value in board[:3]], '--switch-at', '0.5')
    assert code == 0 and 'the goal is switched to' in out, err
    running.wait('the tool to be there',
                 lambda: np.linalg.norm(running.tool()[:3] - board[:3]) < 0.01)
    # The skill is loaded now; the objects come with the goal of the action.
    code, out, err = execute('--object', 'goal', *numbers)
    assert code == 0 and 'the goal was reached' in out, err
    assert np.linalg.norm(running.tool()[:3] - np.array(numbers[:3], dtype=float)) < 0.01
    for words, reason in ((['cup', *numbers], "frame 'cup': the skill has no such frame"),
                          (['goal', *numbers[:3], '0', '0', '0', '0'], 'quaternion')):
        code, _, err = execute('--object', *words)
        assert code == 1 and reason in err
    (tmp_path / 'steps.yaml').write_text('steps: []')
    code, _, err = execute(tmp_path / 'steps.yaml', '--object', 'goal', *numbers)
    assert code == 1 and 'looks the objects of a sequence up itself' in err


def test_objects_are_looked_up_in_tf_when_a_motion_begins(running, skill_file, execute, tmp_path):
    letter = Skill.load(skill_file)
    path = letter.reproduce(0.02)
    Skill.learn(Demonstration(path.times, path.points, letter.manifold, frames={
        'start': letter.start[:7], 'board': letter.goal[:7]}), start_frame='start',
        goal_frame='board').save(tmp_path / 'among.json')
    assert running.set_parameters(SERVER, objects=['board']).successful
    code, _, err = execute(tmp_path / 'among.json')
    assert code == 1 and "frame 'board' is not connected to 'panda_link0'" in err
    for offset in (0.03, -0.02):
        board = letter.goal[:7] + np.array([0.0, offset, 0.02, 0.0, 0.0, 0.0, 0.0])
        static_broadcaster(running, transform('panda_link0', 'board', board, messages.stamp_of(
            running.client.clock.wall())))
        running.client.spend(0.3)
        code, out, err = execute(tmp_path / 'among.json')
        assert code == 0 and 'the goal was reached' in out, err
        assert np.linalg.norm(running.tool()[:3] - board[:3]) < 0.01


def test_after_a_motion_the_arm_goes_home_and_executes_again(running, execute):
    start = running.tool()
    assert execute('--tempo', '2')[0] == 0
    assert np.linalg.norm(running.tool()[:3] - start[:3]) > 0.05
    code, _, err = gdmp('home')
    assert code == 0, err
    np.testing.assert_allclose(running.tool()[:3], start[:3], atol=0.002)
    # What the server held before does not move the arm.
    running.client.spend(1.0)
    np.testing.assert_allclose(running.tool()[:3], start[:3], atol=0.002)
    assert execute('--tempo', '2')[0] == 0


def test_a_server_that_is_missing_or_doubled_is_named(running, execute):
    code, _, err = execute('--server', 'left/trajectory_server', '--wait', '3')
    assert code == 1
    assert ('waiting for the state of left/trajectory_server, 2 s: no node of this name runs; '
            'there are panda_sim, trajectory_server') in err
    running.start_server('another', extra=['-r', '__node:=trajectory_server'])
    code, _, err = execute()
    assert code == 1 and '2 nodes of the name trajectory_server run' in err
    running.children.stop('another')
    assert execute('--tempo', '2')[0] == 0


def test_ctrl_c_stops_the_motion_smoothly(running, execute):
    running.listen()

    def interrupt():
        if len(running.references) > 100 and speeds(running).max() > 0.05:
            raise KeyboardInterrupt
    with running.meanwhile(interrupt):
        code, out, _ = execute()
    assert code == 130 and 'stopped' in out
    running.client.wait_status('holding', 10.0)
    assert running.state.progress < 0.9
    running.wait('the reference to be at rest', lambda: not speeds(running)[-1].any())
    assert np.abs(np.diff(speeds(running), axis=0)).max() < 0.02


def test_a_start_that_is_interrupted_before_its_answer_is_cancelled(running):
    interrupts = iter([KeyboardInterrupt()])

    def interrupt():
        for one in interrupts:
            raise one
    client = ServerClient(SERVER, interrupt)
    try:
        with pytest.raises(KeyboardInterrupt):
            client.execute()
        assert client.cancel()
    finally:
        client.close()
    running.client.wait_status('holding', 10.0)
    assert running.state.progress < 0.1


def speeds(nodes):
    return np.array([[m.twist.linear.x, m.twist.linear.y, m.twist.linear.z]
                     for m in nodes.references]).reshape(-1, 3)


def test_it_waits_for_the_robot_as_long_as_it_was_told(running, skill_file, execute):
    running.unconfigure()
    assert running.transition(SERVER, CONFIGURE, ACTIVATE)
    running.client.wait_status('idle', 60.0)
    running.wait('the flag', lambda: 'no_robot' in running.state.flags)
    code, out, err = execute(skill_file, '--wait', '5')
    assert code == 1 and 'waiting for the pose of the robot' in out
    assert 'no measured pose has arrived on /panda_sim/measured_pose' in err
    begun = running.client.now()

    def come():
        if 2.0 < running.client.now() - begun < 2.05:
            arm.participant.executor.call(arm.autostart)
    arm = running.children.node(ARM)
    with running.meanwhile(come):
        code, out, _ = execute(skill_file)
    assert code == 0 and 'the goal was reached' in out
    running.spend(0.2)
    assert 'no_robot' not in running.state.flags
    running.children.kill(ARM)
    running.wait('the flag again', lambda: 'no_robot' in running.state.flags)
    running.children.kill(SERVER)
    running.start()


def test_without_a_server_it_says_so(nodes, execute):
    code, _, err = execute('--wait', '5')
    assert code == 1
    assert 'waiting for the state of trajectory_server, 4 s' in err
    assert 'waited 5 s for the state of trajectory_server, without success' in err
