"""The studio as a client of running nodes: skill, goal switch, hand guiding, takes."""
from functools import partial

import numpy as np
import pytest

from gdmp_ros.data import recordings
from gdmp_ros.errors import GdmpError
from gdmp_ros.ros.clients.testbed import ARM, MODULES, TAKE_RECORDER
from gdmp_ros.scene import Scene, Volume
from gdmp_ros.studio.nodes_robot import NodesRobot
from test.studio import views


@pytest.fixture
def robot(running):
    made = NodesRobot()
    yield made
    made.close()


@pytest.fixture
def wait(running):
    return partial(views.wait, clock=running.client.clock)


def test_a_changed_skill_is_executed_and_its_goal_switched(robot, skill, wait):
    goal = skill.goal.copy()
    goal[:3] += [0.03, 0.0, -0.02]
    wait(robot, until=lambda view: view.status in ('holding', 'idle'))
    robot.use(skill.between(goal=goal), 'changed')
    robot.start()
    view = wait(robot, until=lambda view: view.status == 'moving' and view.progress > 0.2)
    np.testing.assert_allclose(view.goal[:3], goal[:3], atol=1e-6)
    goal[1] += 0.04
    robot.switch_goal(goal[:7])
    view = wait(robot, until=lambda view: view.status == 'holding' and view.distance[0] < 5e-3)
    np.testing.assert_allclose(view.pose[:3], goal[:3], atol=5e-3)
    assert view.problem == ''


def test_a_stopped_motion_is_no_problem_and_a_refused_tempo_is_one(robot, skill, wait):
    wait(robot, until=lambda view: view.status in ('holding', 'idle'))
    robot.use(skill, 'letter')
    robot.start()
    wait(robot, until=lambda view: view.status == 'moving')
    robot.stop()
    assert wait(robot, until=lambda view: view.status == 'holding').problem == ''
    robot.set_tempo(5.0)
    refused = wait(robot, until=lambda view: view.problem)
    assert 'speed is 5.0, expected a number from 0 to 2' in refused.problem
    robot.set_tempo(1.0)


def test_a_guided_arm_follows_the_hand_and_a_take_is_recorded(robot, running, tmp_path, wait):
    with pytest.raises(GdmpError, match='no take_recorder runs'):
        robot.record(tmp_path)
    running.children.start_node(TAKE_RECORDER, MODULES[TAKE_RECORDER],
                                {'folder': str(tmp_path / 'takes')})
    try:
        robot.guide(True)
        view = wait(robot, until=lambda view: view.mode == 'guided')
        running.spend(1.0)
        robot.record(tmp_path)
        wait(robot, until=lambda view: view.recording is not None)
        target = view.pose.copy()
        target[2] += 0.08
        robot.pull(target)
        wait(robot, until=lambda view: abs(view.pose[2] - target[2]) < 0.02)
        robot.pull(None)
        taught = recordings.read(robot.keep()).demonstration
        assert taught.points[-1, 2] - taught.points[0, 2] > 0.05
        robot.guide(False)
        wait(robot, until=lambda view: view.mode != 'guided')
    finally:
        running.children.stop(TAKE_RECORDER)


def test_how_the_arm_followed_a_motion_is_known_for_a_correction(robot, running, skill, wait):
    wait(robot, until=lambda view: view.status in ('holding', 'idle'))
    robot.use(skill, 'letter')
    with pytest.raises(GdmpError, match='has not been executed'):
        robot.followed()
    robot.start()
    view = wait(robot, until=lambda view: view.status == 'moving' and view.progress > 0.3)
    while view.progress < 0.6:
        hand = view.pose.copy()
        hand[2] += 0.05
        robot.pull(hand)
        running.spend(0.02)
        view = robot.view()
    robot.pull(None)
    wait(robot, until=lambda view: view.status == 'holding')
    followed = robot.followed()
    away = np.linalg.norm((followed.measured - followed.references)[:, :3], axis=1)
    pushed = (followed.progress > 0.4) & (followed.progress < 0.6)
    assert away[pushed].max() > 0.015 and away[followed.progress < 0.25].max() < 0.015


def test_an_arm_that_is_started_again_hears_what_is_around_it(nodes):
    nodes.start_arm()
    nodes.wait('the arm', lambda: bool(nodes.robot))
    robot = NodesRobot()
    try:
        robot.surround(Scene([Volume('post', 'sphere', (0.05,), np.array(
            [0.3, 0.5, 0.2, 1.0, 0.0, 0.0, 0.0]))]))
        nodes.spend(0.5)
        assert nodes.children.node(ARM).control.controller.scene.names == ('post',)
        nodes.children.kill(ARM)
        nodes.spend(2.0)
        assert robot.view() is None
        nodes.start_arm()
        nodes.wait('the scene', lambda: nodes.children.node(ARM).active and nodes.children.node(
            ARM).control.controller.scene.names == ('post',), 20.0)
    finally:
        robot.close()
