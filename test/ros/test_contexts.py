"""Contexts at the command line and in the server, over DDS."""
import json

import numpy as np
import pytest

from gdmp_ros.data import recordings
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.manifolds.poses import tool_manifold
from gdmp_ros.ros import messages
from gdmp_ros.sim.arm import Arm
from gdmp_ros.util.profiles import minimum_jerk
from test.commands import gdmp
from test.ros.nodes import open_testbed

HEIGHTS = np.linspace(0.0, 0.12, 6)


def _take(height):
    """The tool lifts something over an edge and puts it down on it."""
    home, s = Arm().pose_at(Arm().home), np.linspace(0.0, 1.0, 200)
    blend = minimum_jerk(s)
    points = np.tile(home, (len(s), 1))
    points[:, 1] += 0.12 * blend
    points[:, 2] += (height - 0.1) * blend + (0.03 + height) * np.sin(np.pi * blend) ** 2
    return Demonstration((1.5 + 2.0 * height) * s, points, tool_manifold(None))


@pytest.fixture(scope='session')
def folder(tmp_path_factory):
    """A skill that ``gdmp learn`` learned with a table of contexts."""
    made = tmp_path_factory.mktemp('contexts')
    lines = ['take,height']
    for number, height in enumerate(HEIGHTS):
        recordings.write(made / 'takes' / f'take_{number}', _take(height), 'panda_link0',
                         recordings.EPOCH_NS)
        lines.append(f'take_{number},{height}')
    (made / 'heights.csv').write_text('\n'.join(lines))
    done = gdmp('learn', 'takes', '-o', 'skill.json', '--contexts', 'heights.csv', '--stiffness',
                'none', cwd=made)
    assert done.returncode == 0, done.stderr
    return made


@pytest.fixture(scope='module')
def shared_nodes(tmp_path_factory, folder):
    with open_testbed(tmp_path_factory.mktemp('nodes'), folder / 'skill.json') as made:
        made.start()
        yield made


def wait_tool_at(running, place):
    running.wait('the tool at its place', lambda: np.abs(messages.pose_numbers(
        running.robot[-1].pose)[:3] - place).max() < 4e-3, 5.0)


def test_the_command_line_shows_and_uses_contexts(folder):
    assert 'context height' in gdmp('show', 'skill.json', cwd=folder).stdout
    assert gdmp('rollout', 'skill.json', '--context', 'height=0.05', '-o', 'path.csv',
                cwd=folder).returncode == 0
    path = np.loadtxt(folder / 'path.csv', delimiter=',', skiprows=1)
    # Rest at the ends of the takes was cut off: the path is compared, not its timing.
    away = np.linalg.norm(path[:, None, 2:5] - _take(0.05).points[None, :, :3], axis=2)
    assert away.min(axis=1).max() < 2e-3
    outside = gdmp('rollout', 'skill.json', '--context', 'height=0.2', '-o', 'far.csv', cwd=folder)
    assert 'height is 0.2, the takes show 0 to 0.12' in outside.stderr
    for word, code, reason in (('width=1', 1, 'expected height, got width'),
                               ('height=0.3', 1, 'further outside of what the takes show'),
                               ('height', 2, "'height' is not NAME=NUMBER")):
        refused = gdmp('rollout', 'skill.json', '--context', word, cwd=folder)
        assert refused.returncode == code and reason in refused.stderr


def test_the_server_uses_the_next_context_from_the_next_start_on(running, folder):
    running.client.execute()
    running.wait_progress(0.2)
    before = messages.pose_numbers(running.state.goal[0])
    running.client.context({'height': 0.05})
    running.wait('the context', lambda: list(running.state.context.values) == [0.05])
    np.testing.assert_allclose(messages.pose_numbers(running.state.goal[0]), before)
    assert running.client.result(20.0).error_code == 0
    running.client.execute()
    assert running.client.result(20.0).error_code == 0
    wait_tool_at(running, _take(0.05).points[-1, :3])
    # The skill itself again.
    running.client.context({})
    running.wait('no context', lambda: not running.state.context.values)


@pytest.mark.parametrize('context, reason', [
    ({'width': 0.05}, 'expected height, got width'), ({'height': np.nan}, 'finite')])
def test_a_context_that_does_not_fit_is_refused(running, context, reason):
    refused = running.state.refused
    running.client.context(context)
    running.wait('a refusal', lambda: running.state.refused > refused)
    assert reason in running.state.last_refusal and not running.state.context.names


def test_execute_takes_a_context(running, folder):
    done = gdmp('run', '--context', 'height=0.1', **running.environment)
    assert done.returncode == 0, done.stderr
    assert json.loads((folder / 'skill.json').read_text())['version'] == 8
    wait_tool_at(running, _take(0.1).points[-1, :3])
    refused = gdmp('run', '--context', 'width=0.1', **running.environment)
    assert refused.returncode == 1 and 'expected height, got width' in refused.stderr
    assert Skill.load(folder / 'skill.json').variation.contexts.names == ('height',)
