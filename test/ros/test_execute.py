"""`gdmp execute` executes the skill of a running server from the terminal."""
from contextlib import contextmanager
import signal
import subprocess

from gdmp_msgs.srv import SetSpeed
import numpy as np
import pytest

from gdmp_ros.cli.main import main
from gdmp_ros.ros import messages
from gdmp_ros.ros.testbed import ARM, SERVER
from test.commands import GDMP
from test.ros.nodes import ACTIVATE, CONFIGURE, DEACTIVATE


@contextmanager
def executing(*words):
    """`gdmp execute` in another process."""
    process = subprocess.Popen([*GDMP, 'execute', *words], stdout=subprocess.PIPE,
                               stderr=subprocess.PIPE, text=True)
    try:
        yield process
    finally:
        process.kill()
        process.wait()


@pytest.fixture
def execute(capsys):
    """`gdmp execute` in this process: exit code and output."""
    def run(*words):
        code = main(['execute', *map(str, words)])
        return code, *capsys.readouterr()
    return run


def test_it_executes_switches_the_goal_and_prints_the_result(running, skill_file, execute):
    code, out, err = execute('--speed', '2')
    assert code == 0, err
    assert 'the goal was reached; distance: position' in out
    running.wait('this tempo', lambda: running.state.speed == pytest.approx(2.0, 0.05))
    goal = messages.pose_numbers(running.state.goal[0])[:3] + [0.0, 0.05, 0.03]
    numbers = [f'{value:.4f}' for value in goal]
    code, out, _ = execute('--load', skill_file, '--goal-position', *numbers, '--after', '0.3')
    assert code == 0 and 'the goal is switched to' in out
    running.wait('the tool to be there',
                 lambda: np.linalg.norm(running.tool()[:3] - goal) < 0.01)
    code, out, _ = execute('--goal-position', '5', '0', '0.3', '--after', '0.2')
    assert code == 0 and 'the new goal was refused: goal_pose: goal x is 5.000 m' in out
    code, _, err = execute('--speed', '7')
    assert code == 1 and 'speed is 7.0' in err
    code, _, err = execute('--load', 'nowhere.json')
    assert code == 1 and 'nowhere.json: cannot read the skill' in err


def test_ctrl_c_stops_the_motion_smoothly(running):
    running.listen()
    # Slow, so that the motion still goes on when the signal arrives at a busy machine.
    assert running.call(SetSpeed, f'{SERVER}/set_speed', scale=0.3).success
    with executing() as process:
        running.client.wait_status('moving', 60.0)
        running.wait('a fast reference', lambda: speeds(running).max() > 0.05)
        process.send_signal(signal.SIGINT)
        out, _ = process.communicate(timeout=60)
        assert process.returncode == 130 and 'stopped' in out
    running.client.wait_status('holding', 10.0)
    assert running.state.progress < 0.9
    running.wait('the reference to be at rest', lambda: not speeds(running)[-1].any())
    assert np.abs(np.diff(speeds(running), axis=0)).max() < 0.03


def speeds(nodes):
    return np.array([[m.twist.linear.x, m.twist.linear.y, m.twist.linear.z]
                     for m in nodes.references]).reshape(-1, 3)


@pytest.mark.long
def test_it_waits_for_the_robot_as_long_as_it_was_told(running, skill_file, execute):
    running.unconfigure()
    assert running.transition(SERVER, CONFIGURE, ACTIVATE)
    running.client.wait_status('idle', 60.0)
    running.wait('the flag', lambda: 'no_robot' in running.state.flags)
    code, out, _ = execute('--load', skill_file, '--wait', '5')
    assert code == 1 and 'waiting for the pose of the robot' in out
    assert 'no measured pose has arrived on /panda_sim/measured_pose' in out
    with executing('--load', str(skill_file)) as process:
        assert process.stdout.readline().startswith('waiting for the pose of the robot')
        assert running.transition(ARM, CONFIGURE, ACTIVATE)
        running.client.wait_status('moving', 60.0)
        assert 'no_robot' not in running.state.flags
        out, _ = process.communicate(timeout=60)
        assert process.returncode == 0 and 'the goal was reached' in out
    assert running.transition(ARM, DEACTIVATE)
    running.wait('the flag again', lambda: 'no_robot' in running.state.flags)


def test_without_a_server_it_says_so(nodes, execute):
    code, _, err = execute('--wait', '1')
    assert code == 1
    assert 'waited 1 s for the state of trajectory_server, without success' in err
