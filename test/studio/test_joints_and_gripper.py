"""Skills of the joints and of a gripper on the page of the studio; curves over time."""
import re

import numpy as np
import pytest

from gdmp_ros import Demonstration, Skill
from gdmp_ros.data import bags, recordings, runs
from gdmp_ros.data.bags import GRIPPER, GRIPPER_FIELDS
from gdmp_ros.data.recordings import RecordedCommand
from gdmp_ros.errors import DataError
from gdmp_ros.manifolds.euclidean import Euclidean
from gdmp_ros.manifolds.product import Product
from gdmp_ros.sim.arm import Arm
from gdmp_ros.studio.motion import of_states
from gdmp_ros.util.profiles import minimum_jerk
from test.recorded_run import recorded_run
from test.studio.lockstep import opened_page
from test.studio.test_page import ends_at
from test.test_setup import ROOT

WAY = np.array([0.3, 0.1, 0.0, 0.2, 0.0, -0.2, 0.4])


def joint_skill(arm):
    shares = minimum_jerk(np.linspace(0.0, 1.0, 150))[:, None]
    return Skill.learn(Demonstration(np.linspace(0.0, 2.0, 150), arm.home + shares * WAY,
                                     Product(Euclidean(7), names=('joints',))))


@pytest.fixture(scope='module')
def arm():
    return Arm()


@pytest.fixture
def page(arm, folder, monkeypatch):
    monkeypatch.chdir(folder)
    joint_skill(arm).save(folder / 'joints.json')
    with opened_page(folder, 'joints.json') as made:
        yield made


def test_a_skill_of_the_joints_is_shown_changed_and_run(page, arm, folder):
    end = arm.pose_at(arm.home + WAY)[:3]
    np.testing.assert_allclose(ends_at(page.text()), end, atol=1e-3)
    page.wait_text('the arm can follow the whole path')
    away = np.array([0.0, 0.05, 0.03])
    page.drag('goal', away)
    np.testing.assert_allclose(ends_at(page.text()), end + away, atol=2e-3)
    page.click('add a via point')
    page.wait_text('1 via point')
    page.drag('via 50 %', [0.0, 0.0, 0.02])
    page.enter('joints_changed.json', 'bent.json')
    page.click('save the skill')
    page.wait_text('bent.json')
    bent = Skill.load(folder / 'bent.json')
    assert bent.manifold.names == ('joints',)
    np.testing.assert_allclose(arm.pose_at(bent.goal)[:3], end + away, atol=1e-3)
    page.click('start')
    page.wait_text('**moving**')
    page.spend(0.5)
    # The goal of a motion of the joints is switched by a pose, too.
    page.enter('goal [m]', tuple(end + [0.0, 0.0, 0.06]))
    reached = page.wait('the goal', lambda text: re.search(
        r'holding.*?tool at ([-\d.]+), ([-\d.]+), ([-\d.]+) m\n\n([\d.]+) mm and', text, re.S))
    np.testing.assert_allclose([float(reached[k]) for k in (1, 2, 3)], end + [0.0, 0.0, 0.06],
                               atol=4e-3)
    assert float(reached[4]) < 4.0


def test_a_skill_of_other_joints_is_refused(page, folder):
    three = Skill.learn(Demonstration(np.linspace(0.0, 1.0, 50), np.linspace(
        [0.0, 0.0, 0.0], [1.0, 1.0, 1.0], 50), Product(Euclidean(3), names=('joints',))), 10)
    three.save(folder / 'three.json')
    page.studio.bench.open(folder / 'joints.json')
    with pytest.raises(DataError, match='of 3 joints, the arm has 7'):
        page.studio.bench.open(folder / 'three.json')
    with pytest.raises(DataError, match='of 3 joints, the arm has 7'), opened_page(
            folder, 'three.json'):
        pass


def test_curves_follow_the_slider(page):
    curve, slider = page.part('curve'), page.part('time [%]')
    assert curve.options == ('position', 'speed', 'orientation', 'joints')

    def drawn():
        plot = next(part for part in page._parts() if hasattr(part, 'series'))
        return [one['label'] for one in plot.series], plot.data
    labels, (times, *columns) = drawn()
    assert labels == ['time [s]', 'x [m]', 'y [m]', 'z [m]', 'now']
    page.enter('curve', 'joints')
    page.enter('time [%]', 50.0)
    labels, (times, *columns) = drawn()
    assert labels[1:-1] == [f'joint {k} [deg]' for k in range(1, 8)]
    line = np.flatnonzero(np.isfinite(columns[-1]))
    assert len(line) == 2 and np.ptp(times[line]) == 0.0
    assert times[line[0]] == pytest.approx(0.5 * page.studio.motion.duration)
    # The text has the values at the line, and the transparent arm is there.
    found = re.search(r'joints: joint 1 ([-\d.]+) deg', page.text())
    assert float(found[1]) == pytest.approx(columns[0][line[0]], abs=0.5)
    assert page.studio.scene.ghost._root.visible
    page.enter('curve', 'speed')
    _, (times, *columns) = drawn()
    fastest = np.linalg.norm(np.diff(page.studio.motion.poses[:, :3], axis=0), axis=1).max()
    assert columns[0].max() == pytest.approx(
        fastest / np.diff(page.studio.motion.times)[0], rel=0.05)
    assert slider.value == 50.0


def test_a_grasp_is_taught_learned_and_run(folder, monkeypatch):
    monkeypatch.chdir(folder)
    with opened_page(folder) as page:
        page.enter('guide the arm by hand', True)
        page.wait('the guided arm', lambda text: 'arm: guided' in text)
        page.click('record a take')
        page.wait_text('recording, ')
        page.drag('hand', [0.0, 0.0, -0.08], steps=20, held=0.5)
        page.enter('close to [mm]', 30)
        page.enter('hold with [N]', 0)
        page.click('close the gripper')
        page.spend(0.5)
        assert page.studio.view.width < 0.07
        page.drag('hand', [0.0, 0.06, 0.0], steps=20, held=1.0)
        page.click('keep the take')
        page.wait_text('kept: ')
        page.enter('automatic number of functions', False)
        page.click('learn')
        page.wait_text('learned from 1 take: ')
        skill = page.studio.skill
        assert len(skill.events) == 1 and skill.events[0].width == pytest.approx(0.03)
        assert 'gripper' in page.part('curve').options
        page.wait('the hold', lambda text: 'arm: guided' not in text)
        page.click('open the gripper')
        page.spend(1.5)
        assert page.studio.view.width > 0.075
        page.click('start')
        page.wait_text('**moving**')
        page.wait_text('**holding**')
        page.spend(1.0)
        assert page.studio.view.width == pytest.approx(0.03, abs=2e-3)
        # The same take as one of the joints.
        page.enter('of the joints', True)
        page.click('learn')
        page.wait('a skill of the joints',
                  lambda _: page.studio.skill.manifold.names == ('joints',) or None)


def test_a_recorded_run_has_curves_of_error_and_force():
    run = recorded_run()
    command = RecordedCommand(int(run.state_stamps[1000]), 0.02, 10.0, 0.1)
    _, done = of_states(run, [command])
    curves = done.curves()
    assert set(curves) == {'position', 'speed', 'orientation', 'joints', 'stiffness', 'gripper',
                           'error', 'force'}
    tracked = runs.tracking(run)
    assert np.nanmax(curves['error'].values[:, 0]) == pytest.approx(
        1e3 * tracked.position.max(), rel=1e-6)
    width = curves['gripper'].values[:, 0]
    assert np.isnan(width[done.index(0.9)]) and width[done.index(1.1)] == 20.0
    assert done.recorded and len(curves['force'].values) == len(done.times)


def test_a_recorded_run_is_shown_without_a_skill(folder):
    with opened_page(folder) as page:
        page.wait_text('No skill yet')
        page.studio.bench.runs['monday'] = of_states(recorded_run(), [])
        page.studio.jobs.put(page.studio.redraw)
        page.wait('the run', lambda text: 'No skill yet' not in text)
        assert page.part('skill').value == 'run monday'
        assert {'error', 'force'} <= set(page.part('curve').options)


def test_commands_are_written_with_the_definition_of_the_message():
    fields = [line.partition('#')[0].split() for line in
              (ROOT / 'msg_defs/msg/GripperCommand.msg').read_text().splitlines()]
    assert [' '.join(words) for words in fields if words] == GRIPPER_FIELDS.split('\n')[:-1]
    assert GRIPPER == 'gdmp_msgs/msg/GripperCommand'


def test_takes_of_joints_alone_are_shown_and_learned(folder, arm, monkeypatch, tmp_path):
    monkeypatch.chdir(folder)
    motion = joint_skill(arm).reproduce(0.02)
    with bags.BagWriter(tmp_path / 'posture') as writer:
        for time, row in zip(motion.times, motion.points):
            writer.joints('/joint_states', recordings.EPOCH_NS + round(1e9 * time), arm.names, row)
    with opened_page(folder, tmp_path / 'posture') as page:
        page.wait('the take', lambda _: page.studio.scene.lines('take ') or None)
        page.click('learn')
        page.wait_text('learned from 1 take: ')
        assert page.studio.skill.manifold.names == ('joints',)
