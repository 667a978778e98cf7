"""Corrections by pushes: recorded, shown, kept and undone, over DDS."""
import re

from gdmp_msgs.msg import Reference
from gdmp_msgs.srv import RefineSkill
from geometry_msgs.msg import PoseStamped
import numpy as np
import pytest

from gdmp_ros import Skill
from gdmp_ros.ros import messages
from gdmp_ros.ros.clients.testbed import ARM, SERVER
from test.commands import gdmp
from test.ros.nodes import FRAME, open_testbed

#: Progress from and to, and how far a hand pulls the tool there [m].
PUSHES = [(0.15, 0.3, [0.0, 0.0, 0.09]), (0.45, 0.6, [0.09, 0.0, 0.0]),
          (0.72, 0.85, [0.0, -0.09, 0.0])]


@pytest.fixture(scope='session')
def skill(letters):
    return Skill.learn(letters[:3])


@pytest.fixture(scope='module')
def shared_nodes(tmp_path_factory, skill_file):
    with open_testbed(tmp_path_factory.mktemp('nodes'), skill_file) as made:
        made.start()
        yield made


def execute_and_push(running):
    """A hand takes the tool three times, and lets go."""
    hand = running.publisher(PoseStamped, f'{ARM}/hand_pose')
    references = running.collect(Reference, f'{SERVER}/reference')
    running.client.execute()

    def moved():
        if references:
            for first, last, away in PUSHES:
                if first < running.state.progress < last:
                    message = PoseStamped()
                    message.header.frame_id = FRAME
                    pose = messages.pose_numbers(references[-1].pose)
                    pose[:3] += away
                    messages.set_pose(message.pose, pose)
                    hand.publish(message)
        return running.client.done()
    running.wait('the motion', moved, 40.0)
    assert running.client.result(1.0).error_code == 0


def refine(running, action, **fields):
    return running.call(RefineSkill, f'{SERVER}/refine_skill', action=action, **fields)


def path(poses):
    return np.array([messages.pose_numbers(pose) for pose in poses])


def test_a_correction_is_proposed_kept_and_undone(running, skill, tmp_path):
    asked = RefineSkill.Request
    early = refine(running, asked.PROPOSE)
    assert not early.success and 'has not been executed' in early.message
    assert 'no correction' in refine(running, asked.KEEP).message
    execute_and_push(running)
    shown = refine(running, asked.PROPOSE)
    assert shown.success and len(shown.pushed_at) == 3, shown.message
    assert min(shown.moved) > 0.02
    before, after = path(shown.before), path(shown.after)
    moved = np.linalg.norm((after - before)[:, :3], axis=1)
    for at, largest in zip(shown.pushed_at, shown.moved):
        assert moved[round(100 * at)] == pytest.approx(largest, abs=3e-3)
    assert moved[[0, 100]].max() < 1e-3
    # Nothing is kept without being asked.
    assert refine(running, asked.DISCARD).success
    assert 'no correction' in refine(running, asked.KEEP).message
    again = refine(running, asked.PROPOSE)
    np.testing.assert_array_equal(path(again.after), after)
    kept = refine(running, asked.KEEP, output=str(tmp_path / 'better.json'))
    assert kept.success, kept.message
    better = Skill.load(tmp_path / 'better.json')
    made = better.rollout(duration=1.0).sample(np.linspace(0.0, 1.0, 101)).points[:, :7]
    np.testing.assert_allclose(made, after, atol=1e-3)
    # The next motion is that of the corrected skill, from where the arm is.
    running.listen()
    start = np.concatenate([running.tool(), better.start[7:]])
    running.client.execute()
    assert running.client.result(40.0).error_code == 0
    streamed = np.array([messages.pose_numbers(m.pose)[:3] for m in running.references])
    for at in shown.pushed_at:
        place = better.rollout(start=start, duration=1.0).advance(at).point[:3]
        assert np.linalg.norm(streamed - place, axis=1).min() < 4e-3
    assert refine(running, asked.UNDO).success
    undone = refine(running, asked.UNDO)
    assert not undone.success and 'was not corrected' in undone.message
    assert not refine(running, 9).success


def test_a_recorded_run_is_shown_kept_and_undone_at_the_command_line(running, skill, skill_file):
    folder = skill_file.parent
    running.record(folder / 'run')
    execute_and_push(running)
    running.spend(0.5)
    running.recorded(folder / 'run')
    original = skill_file.read_bytes()
    shown = gdmp('edit', 'refine', 'skill.json', 'run', '--plot', 'change.png', cwd=folder)
    assert shown.returncode == 0, shown.stderr
    assert len(re.findall(r'position', shown.stdout)) == 3
    assert 'nothing was written' in shown.stdout and (folder / 'change.png').exists()
    assert skill_file.read_bytes() == original
    for words, reason in ((('run', '--keep', '-o', 'x.json'), 'choose one'), ((), 'or --undo'),
                          (('run', '--undo'), '--undo takes a skill only'),
                          (('run', '--least', '500'), 'no push was found'),
                          (('--undo',), 'no earlier version')):
        refused = gdmp('edit', 'refine', 'skill.json', *words, cwd=folder)
        assert refused.returncode == 1 and reason in refused.stderr
    assert gdmp('edit', 'refine', 'skill.json', 'run', '--keep', cwd=folder).returncode == 0
    better = Skill.load(skill_file)
    moved = np.linalg.norm((better.reproduce(0.02).points - skill.reproduce(0.02).points)[:, :3],
                           axis=1)
    assert moved.max() > 0.02 and moved[[0, -1]].max() < 1e-3
    assert gdmp('edit', 'refine', 'skill.json', '--undo', cwd=folder).returncode == 0
    assert skill_file.read_bytes() == original
