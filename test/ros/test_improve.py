"""``gdmp improve --robot``: one by one with a person who says go."""
import json

from geometry_msgs.msg import PoseStamped
import numpy as np
import pytest
from std_srvs.srv import Trigger

from gdmp_ros import Demonstration, Skill
from gdmp_ros.control.modes import ArmMode
from gdmp_ros.manifolds.poses import tool_manifold
from gdmp_ros.ros import messages
from gdmp_ros.ros.clients.testbed import ARM
from gdmp_ros.sim import Arm
from gdmp_ros.sim.path_check import Reach
from gdmp_ros.util.profiles import minimum_jerk
from test.commands import gdmp
from test.ros.nodes import FRAME

SCORE = """
import numpy as np

def score(trial):
    assert trial.times[0] == 0.0 and len(trial.times) == len(trial.references) == len(
        trial.torques) > 1500
    assert np.diff(trial.times).max() < 0.05 and trial.times[-1] > 1.5
    lag = np.linalg.norm((trial.references - trial.measured)[:, :3], axis=1).max()
    assert lag < 0.02, lag
    return {'high': trial.measured[:, 2].max(), 'lag': lag}
"""


@pytest.fixture(scope='session')
def skill():
    """To the side, from a place near the home posture."""
    s = np.linspace(0.0, 1.0, 100)
    points = np.tile(Arm().pose_at(Arm().home), (len(s), 1))
    points[:, 1] += 0.05 + 0.1 * minimum_jerk(s)
    return Skill.learn(Demonstration(1.5 * s, points, tool_manifold(None)), 20)


@pytest.fixture
def folder(tmp_path, skill_file):
    (tmp_path / 'high.py').write_text(SCORE)
    (tmp_path / 'skill.json').write_bytes(skill_file.read_bytes())
    return tmp_path


@pytest.fixture
def start(skill):
    """Where roll-outs begin: joint positions at the start of the skill."""
    return Reach(Arm()).posture(skill.start[:7], Arm().home)


def improve(running, folder, answers, *words, during=lambda: None):
    """
    Improve as a person who types these answers; returns exit code and text.

    :param during: called until the end
    """
    with running.meanwhile(during):
        done = gdmp('improve', 'high.py', '--skill', 'skill.json', '-o', 'better.json', '--robot',
                    '--updates', '1', '--samples', '2', '--held-out', '0', '--vary-path', '3',
                    *words, given=answers, cwd=folder)
    return done.returncode, done.stdout + done.stderr


def outcomes(folder):
    """Kept outcomes of roll-outs: key, terms, success, reason of an early end."""
    lines = (folder / 'better.jsonl').read_text().splitlines()[1:]
    return [(key, *outcome) for key, outcome in map(json.loads, lines)]


def check_back(running, start):
    running.robot.clear()
    running.wait('a state', lambda: bool(running.robot), 5.0)
    assert running.robot[-1].mode == ArmMode.HOLD
    assert np.abs(np.array(running.robot[-1].position) - start).max() < 0.01


def test_a_person_says_go_quits_goes_on_and_repeats(running, folder, start):
    code, text = improve(running, folder, '\nq\n')
    assert code == 0 and 'every roll-out is kept; the same command continues' in text, text
    assert '2 roll-outs; see better.html; kept in better.jsonl' in text
    assert 'mm from the skill before' in text and 'Enter: go, w: do not try it' in text
    assert len(outcomes(folder)) == 1 and not (folder / 'better.json').exists()
    check_back(running, start)
    # Go; repeat it; go; go on.
    code, text = improve(running, folder, '\nr\n\n\n')
    assert code == 0 and 'wrote better.json' in text, text
    kept = outcomes(folder)
    assert [key for key, *_ in kept] == ['0/0/0', '0/1/0', '0/1/0']
    assert all(ended == '' and terms['high'] > 0.1 for _, terms, _, ended in kept), kept
    check_back(running, start)
    source = Skill.load(folder / 'better.json').provenance['improved']
    assert source['task'] == 'high.py' and source['rollouts'] == 2


def push(running):
    """A hand pulls the tool away while it moves."""
    hand = running.publisher(PoseStamped, f'{ARM}/hand_pose')

    def during():
        if running.state is not None and 0.3 < running.state.progress < 0.6 and running.robot:
            message = PoseStamped()
            message.header.frame_id = FRAME
            pose = running.tool()
            pose[1] += 0.1
            messages.set_pose(message.pose, pose)
            hand.publish(message)
    return during


def test_a_push_ends_a_rollout_which_is_worst_and_the_arm_goes_back(running, folder, start):
    code, text = improve(running, folder, '\nq\n', '--largest-force', '20', during=push(running))
    (key, terms, _, ended), = outcomes(folder)
    assert key == '0/0/0' and terms is None and 'allowed 20' in ended, text
    check_back(running, start)
    # And another one may begin.
    code, text = improve(running, folder, '\nq\n', '--largest-force', '20')
    assert outcomes(folder)[1][3] == '', text
    check_back(running, start)


def test_an_arm_that_is_stopped_ends_a_rollout(running, folder, start):
    stopped, stop = [], running.client.service(Trigger, f'{ARM}/stop')

    def during():
        if not stopped and running.state is not None and 0.3 < running.state.progress < 0.6:
            stopped.append(stop.call_async(Trigger.Request()))
    code, text = improve(running, folder, '\nq\n', during=during)
    (_, terms, _, ended), = outcomes(folder)
    assert stopped and terms is None and ended == '~/stop was called', (ended, text)
    check_back(running, start)


def test_ctrl_c_stops_the_arm_and_it_holds(running, folder, start):
    interrupted = []

    def during():
        if not interrupted and running.state is not None and 0.3 < running.state.progress < 0.6:
            interrupted.append(True)
            raise KeyboardInterrupt
    code, text = improve(running, folder, '\n', during=during)
    assert code == 130 and not outcomes(folder), text
    running.wait_rest()
    assert running.state.status == 'holding'
    assert np.abs(np.array(running.robot[-1].position) - start).max() > 0.02


def test_a_roll_out_that_cannot_be_scored_does_not_count(running, folder, start):
    (folder / 'high.py').write_text('def score(trial):\n    return 1.0 / 0.0\n')
    code, text = improve(running, folder, '\nq\n')
    assert code == 0 and not outcomes(folder), text
    assert 'this roll-out does not count: ' in text and (
        'high.py, line 2: score(trial) failed: ZeroDivisionError' in text)
    check_back(running, start)


def test_nobody_who_answers_moves_nothing(running, folder):
    before = np.array(running.robot[-1].position)
    code, text = improve(running, folder, '')
    assert code == 0 and 'ended by the person' in text, text
    assert not outcomes(folder)
    assert np.abs(np.array(running.robot[-1].position) - before).max() < 1e-3


def test_a_person_refuses_a_skill_without_trying_it(running, folder):
    code, text = improve(running, folder, 'w\nx\nw\n\n')
    assert code == 0 and 'wrote better.json' in text, text
    assert [ended for *_, ended in outcomes(folder)] == [
        'not begun: the person did not want it'] * 2


def test_silent_nodes_are_named(running, folder):
    code, text = improve(running, folder, '\n', '--node', 'nobody', '--wait', '1')
    assert code == 1 and 'waited 1 s for nobody and trajectory_server' in text, text
