"""`gdmp execute` asks a running server for what a user at the terminal wants."""
from functools import partial
import signal
import subprocess

import numpy as np

from gdmp_ros.ros import messages
from test.commands import GDMP, gdmp

EXECUTE = [*GDMP, 'execute']
run = partial(gdmp, 'execute', timeout=120)


def test_it_executes_switches_the_goal_and_says_how_it_ended(world, skill_file):
    world.start()
    plain = run('--speed', '1.5')
    assert plain.returncode == 0, plain.stderr
    assert 'the goal is reached; distance: position' in plain.stdout
    goal = messages.pose_numbers(world.operator.state.goal[0])[:3] + [0.0, 0.05, 0.03]
    numbers = [f'{value:.4f}' for value in goal]
    done = run('--load', skill_file, '--goal-position', *numbers, '--after', '0.3')
    assert done.returncode == 0 and 'the goal is now at' in done.stdout
    world.wait('the tool to be there',
               lambda: np.linalg.norm(world.tool()[:3] - goal) < 0.01)
    refused = run('--goal-position', '5', '0', '0.3', '--after', '0.2')
    assert refused.returncode == 0 and 'refused: goal_pose: goal x is 5.000 m' in refused.stdout
    assert run('--speed', '7').returncode == 1
    missing = run('--load', 'nowhere.json')
    assert missing.returncode == 1 and 'nowhere.json: cannot read the skill' in missing.stderr


def test_it_waits_for_the_robot_as_long_as_it_was_told(world, skill_file):
    world.start_server(skill='')
    world.operator.wait_status('idle', 60.0)
    early = run('--load', skill_file, '--wait', '6')
    assert early.returncode == 1 and 'waiting for the pose of the robot' in early.stdout
    assert 'no measured pose has arrived on /panda_sim/measured_pose' in early.stdout
    process = subprocess.Popen([*EXECUTE, '--load', str(skill_file)], stdout=subprocess.PIPE,
                               text=True)
    world.spin(2.0)
    world.start_sim()
    world.operator.wait_status('moving', 60.0)
    assert 'no_robot' not in world.operator.state.flags
    out, _ = process.communicate(timeout=60)
    assert process.returncode == 0 and 'the goal is reached' in out
    world.children.stop('panda_sim')
    world.wait('the robot to be missed', lambda: 'no_robot' in world.operator.state.flags)


def test_ctrl_c_brings_the_motion_to_a_smooth_stop(world):
    world.start()
    world.listen()
    process = subprocess.Popen(EXECUTE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    world.operator.wait_status('moving', 30.0)
    world.spin(0.4)
    process.send_signal(signal.SIGINT)
    out, _ = process.communicate(timeout=30)
    assert process.returncode == 130 and 'stopped' in out
    world.operator.wait_status('holding', 10.0)
    assert world.operator.state.progress < 0.9
    speeds = np.array([[m.twist.linear.x, m.twist.linear.y, m.twist.linear.z]
                       for m in world.references])
    assert np.abs(speeds).max() > 0.05 and not speeds[-1].any()
    assert np.abs(np.diff(speeds, axis=0)).max() < 0.03


def test_without_a_server_it_says_so(world):
    done = run('--wait', '2')
    assert done.returncode == 1
    assert 'waited 2 s for trajectory_server to say what it does in vain' in done.stderr
