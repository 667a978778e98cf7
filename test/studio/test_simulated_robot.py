"""The simulated robot of the studio, without a page."""
from functools import partial

import numpy as np
import pytest

from gdmp_ros import Skill
from gdmp_ros.data import recordings
from gdmp_ros.errors import DataError, ParameterError
from gdmp_ros.sim.arm import Arm
from gdmp_ros.studio.simulated_robot import SimulatedRobot
from gdmp_ros.studio.workbench import opened
from test.lockstep.clock import SteppedClock
from test.motions import circles
from test.studio import views

NS = 1_000_000_000


@pytest.fixture(scope='module')
def skill(letters):
    return Skill.learn(letters[0], 30)


@pytest.fixture
def clock():
    return SteppedClock()


@pytest.fixture
def robot(clock):
    made = SimulatedRobot(clock=clock)
    yield made
    made.close()


@pytest.fixture
def wait(robot, clock):
    return partial(views.wait, robot, clock)


def rest(clock, seconds):
    clock.sleep_until(clock.now() + round(seconds * NS))


def test_the_tempo_holds_for_the_first_motion_too(robot, skill, wait):
    robot.set_tempo(0.3)
    robot.use(skill, 'letter')
    robot.start()
    view = wait(lambda view: view.progress > 0.05)
    assert view.tempo == pytest.approx(0.3, abs=0.01)


def test_a_motion_home_is_stopped_and_a_skill_follows(robot, skill, clock, wait):
    robot.use(skill, 'letter')
    robot.set_tempo(2.0)
    robot.start()
    wait(lambda view: view.progress > 0.5)
    robot.home()
    wait(lambda view: view.mode == 'move')
    robot.stop()
    wait(lambda view: view.mode == 'hold')
    rest(clock, 1.0)  # a motion may begin when the arm is at rest
    robot.start()
    view = wait(lambda view: view.status == 'holding' and view.progress >= 1.0)
    assert view.problem == '' and view.distance[0] < 5e-3


def test_a_guided_arm_is_pulled_and_let_go(robot, tmp_path, clock, wait):
    with pytest.raises(ParameterError, match='no take is being recorded'):
        robot.keep()
    robot.guide(True)
    view = wait(lambda view: view.mode == 'guided')
    robot.record(tmp_path / 'takes')
    with pytest.raises(ParameterError, match='keep or discard it'):
        robot.home()
    target = view.pose.copy()
    target[2] += 0.1
    robot.pull(target)
    wait(lambda view: abs(view.pose[2] - target[2]) < 0.02)
    robot.pull(None)
    taught = recordings.read(robot.keep()).demonstration
    assert taught.points[-1, 2] - taught.points[0, 2] > 0.06
    robot.guide(False)
    view = wait(lambda view: view.mode == 'hold')
    rest(clock, 0.5)
    np.testing.assert_allclose(robot.view().pose[:3], view.pose[:3], atol=1e-2)


def test_a_folder_that_cannot_be_written_is_refused_before_the_take(robot, tmp_path):
    (tmp_path / 'file').write_text('')
    robot.guide(True)
    with pytest.raises(DataError, match='cannot write takes'):
        robot.record(tmp_path / 'file')
    assert robot.view() is None or robot.view().recording is None


def test_a_goal_outside_the_workspace_is_refused_and_the_motion_goes_on(robot, skill, wait):
    robot.use(skill, 'letter')
    robot.start()
    wait(lambda view: view.status == 'moving')
    far = skill.goal[:7].copy()
    far[0] = 2.0
    with pytest.raises(Exception, match='outside the workspace'):
        robot.switch_goal(far)
    assert wait(lambda view: view.status == 'holding').distance[0] < 5e-3


def _circles():
    """The tool goes round four times near where the arm stands."""
    return circles(Arm().pose_at(Arm().home), 0.04, 4.3)


def test_a_rhythmic_skill_changes_its_amplitude_and_centre(robot, wait):
    wipe = Skill.learn_rhythmic(_circles())
    robot.use(wipe, 'wipe')
    robot.start()
    view = wait(lambda view: view.progress > 1.5)
    frequency, amplitude = view.cycle
    assert frequency == pytest.approx(1.0, rel=0.1) and amplitude == pytest.approx(1.0, rel=0.01)
    robot.set_amplitude(0.5)
    wait(lambda view: view.cycle[1] < 0.51)
    goal = wipe.goal[:7] + [0.05, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    robot.switch_goal(goal)
    robot.set_amplitude(0.0)
    view = wait(lambda view: view.status == 'holding' and view.distance[0] < 5e-3)
    np.testing.assert_allclose(view.pose[:3], goal[:3], atol=5e-3)


def test_a_sequence_is_shown_step_by_step_and_ended_by_a_signal(robot, tmp_path, wait):
    Skill.learn_rhythmic(_circles()).save(tmp_path / 'wipe.json')
    path = tmp_path / 'clean.yaml'
    path.write_text('steps: [{skill: wipe.json, cycles: 1}, {hold: 0.1}, '
                    '{skill: wipe.json, until: enough, name: polish}]')
    bench = opened([path])
    assert list(bench.sequences) == ['clean.yaml'] and list(bench.skills) == ['wipe']
    robot.start_sequence(bench.sequences['clean.yaml'], 0)
    wait(lambda view: view.step == '1 of 3, wipe')
    wait(lambda view: view.step == '3 of 3, polish')
    robot.signal('enough')
    view = wait(lambda view: not view.step)
    assert view.problem == ''
    robot.start_sequence(bench.sequences['clean.yaml'], 2)
    wait(lambda view: view.step == '3 of 3, polish' and view.progress > 0.2)
    robot.stop()
    wait(lambda view: view.status == 'holding' and view.problem == 'stopped')


def test_a_pushed_motion_corrects_a_skill_and_is_undone_exactly(
        robot, skill, tmp_path, clock, wait):
    skill.save(tmp_path / 'letter.json')
    bench = opened([tmp_path / 'letter.json'])
    with pytest.raises(DataError, match='expected at least 10 poses'):
        bench.correct(robot.followed())
    robot.use(bench.edited(), 'letter')
    robot.start()
    view = wait(lambda view: view.status == 'moving' and view.progress > 0.3)
    while view.progress < 0.6:
        robot.pull(view.goal * [0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0]
                   + [*(view.pose[:3] + [0.0, 0.0, 0.03]), 0.0, 0.0, 0.0, 0.0])
        rest(clock, 0.02)
        view = robot.view()
    robot.pull(None)
    wait(lambda view: view.status == 'holding')
    pushes = bench.correct(robot.followed())
    assert {push.quantity for push in pushes} >= {'position'} and bench.unsaved
    corrected = bench.edited()
    bench.save(tmp_path / 'better.json')
    np.testing.assert_array_equal(Skill.load(tmp_path / 'better.json').weights,
                                  corrected.weights)
    assert np.abs(corrected.reproduce(0.05).points - skill.reproduce(0.05).points)[:, 2].max(
        ) > 0.01
    bench.undo_correction()
    np.testing.assert_array_equal(bench.edited().weights, skill.weights)
    with pytest.raises(DataError, match='no correction to undo'):
        bench.undo_correction()
