"""The simulated robot of the studio, without a page."""
import time

import numpy as np
import pytest

from gdmp_ros import Skill
from gdmp_ros.data import lasa, recordings
from gdmp_ros.errors import DataError, ParameterError
from gdmp_ros.studio.simulated_robot import SimulatedRobot
from test.studio.views import wait


@pytest.fixture(scope='module')
def skill():
    return Skill.learn(lasa.robot_demonstrations('GShape')[0], 30)


@pytest.fixture
def robot():
    made = SimulatedRobot()
    yield made
    made.close()


def test_the_tempo_holds_for_the_first_motion_too(robot, skill):
    robot.set_tempo(0.3)
    robot.use(skill, 'letter')
    robot.start()
    view = wait(robot, lambda view: view.progress > 0.05)
    assert view.tempo == pytest.approx(0.3, abs=0.01)


def test_a_motion_home_is_stopped_and_a_skill_follows(robot, skill):
    robot.use(skill, 'letter')
    robot.set_tempo(2.0)
    robot.start()
    wait(robot, lambda view: view.progress > 0.5)
    robot.home()
    wait(robot, lambda view: view.mode == 'move')
    robot.stop()
    wait(robot, lambda view: view.mode == 'hold')
    time.sleep(1.0)  # a motion may begin when the arm is at rest
    robot.start()
    view = wait(robot, lambda view: view.status == 'holding' and view.progress >= 1.0)
    assert view.problem == '' and view.distance[0] < 5e-3


def test_a_guided_arm_is_pulled_and_let_go(robot, tmp_path):
    with pytest.raises(ParameterError, match='no take is being recorded'):
        robot.keep()
    robot.guide(True)
    view = wait(robot, lambda view: view.mode == 'guided')
    robot.record(tmp_path / 'takes')
    with pytest.raises(ParameterError, match='keep or discard it'):
        robot.home()
    target = view.pose.copy()
    target[2] += 0.1
    robot.pull(target)
    wait(robot, lambda view: abs(view.pose[2] - target[2]) < 0.02)
    robot.pull(None)
    taught = recordings.read(robot.keep()).demonstration
    assert taught.points[-1, 2] - taught.points[0, 2] > 0.06
    robot.guide(False)
    view = wait(robot, lambda view: view.mode == 'hold')
    time.sleep(0.5)
    np.testing.assert_allclose(robot.view().pose[:3], view.pose[:3], atol=1e-2)


def test_a_folder_that_cannot_be_written_is_refused_before_the_take(robot, tmp_path):
    (tmp_path / 'file').write_text('')
    robot.guide(True)
    with pytest.raises(DataError, match='cannot write takes'):
        robot.record(tmp_path / 'file')
    assert robot.view() is None or robot.view().recording is None


def test_a_goal_outside_the_workspace_is_refused_and_the_motion_goes_on(robot, skill):
    robot.use(skill, 'letter')
    robot.start()
    wait(robot, lambda view: view.status == 'moving')
    far = skill.goal[:7].copy()
    far[0] = 2.0
    with pytest.raises(Exception, match='outside the workspace'):
        robot.switch_goal(far)
    assert wait(robot, lambda view: view.status == 'holding').distance[0] < 5e-3
