"""Roll-outs of a simulated arm: ended at a limit, and the arm is where it may start again."""
from dataclasses import replace

import numpy as np
import pytest

from gdmp_ros import Demonstration, Skill
from gdmp_ros.control.joint_motion import PostureMotion
from gdmp_ros.improvement.insertion import Insertion, PLACE
from gdmp_ros.improvement.trial import perform
from gdmp_ros.manifolds.poses import tool_manifold
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.closed_loop import ClosedLoop
from gdmp_ros.sim.path_check import PathChecker, Reach
from gdmp_ros.sim.scenes import hard_table
from gdmp_ros.util.profiles import minimum_jerk

HOME = Arm().pose_at(Arm().home)


def skill_by(way, duration=1.5, stiffness=600.0):
    s = np.linspace(0.0, 1.0, 150)
    matrix = np.diag([stiffness] * 3 + [40.0] * 3).reshape(-1)
    points = np.tile([*HOME, *matrix], (len(s), 1))
    points[:, :3] += minimum_jerk(s)[:, None] * way
    return Skill.learn(Demonstration(duration * s, points, tool_manifold(6)), 25)


def check_may_start_again(loop):
    """The arm rests where it began, and executes another skill from there."""
    measured = loop.arm.measure()
    np.testing.assert_allclose(measured.position, loop.arm.home, atol=5e-3)
    assert np.abs(measured.velocity).max() < 5e-3
    assert not loop.moves_joints and not loop.controller.guard.following
    again = perform(skill_by(np.array([0.0, 0.05, 0.05])), loop, PathChecker(Arm()))
    assert not again.ended
    np.testing.assert_allclose(again.measured[-1, :3], HOME[:3] + [0.0, 0.05, 0.05], atol=5e-3)


def test_a_roll_out_is_recorded():
    loop = ClosedLoop(Arm())
    trial = perform(skill_by(np.array([0.0, 0.1, 0.0])), loop, PathChecker(Arm()))
    assert not trial.ended
    count = len(trial.times)
    assert count > 1400 and (np.diff(trial.times) > 0.0).all()
    assert trial.measured.shape == trial.references.shape == (count, 7)
    assert trial.stiffness.shape == (count, 6, 6) and trial.wrenches.shape == (count, 6)
    assert trial.joints.shape == trial.torques.shape == (count, 7)
    assert np.ptp(trial.measured[:, 1]) == pytest.approx(0.1, abs=5e-3)


def test_a_limit_ends_a_roll_out_and_the_arm_goes_back():
    loop = ClosedLoop(Arm())
    # Faster than the arm may move.
    trial = perform(replace(skill_by(np.array([0.0, 0.35, 0.0])), duration=0.3), loop)
    assert 'limit' in trial.ended
    assert len(trial.times) < 300
    check_may_start_again(loop)


def test_a_force_ends_a_roll_out_and_the_arm_goes_back_the_way_it_came():
    loop = ClosedLoop(Arm(hard_table(0.05)))
    trial = perform(skill_by(np.array([0.0, 0.1, -0.15])), loop, largest_force=30.0)
    assert 'a force of' in trial.ended and 'allowed 30' in trial.ended
    assert np.linalg.norm(trial.wrenches[-1, :3]) > 30.0 > np.linalg.norm(
        trial.wrenches[:-1, :3], axis=1).max()
    check_may_start_again(loop)


def test_a_path_that_the_arm_cannot_follow_is_not_begun():
    loop = ClosedLoop(Arm())
    trial = perform(skill_by(np.array([0.9, 0.0, 0.0])), loop, PathChecker(Arm()))
    assert trial.ended.startswith('not begun: ') and len(trial.times) == 0
    check_may_start_again(loop)


def test_the_way_back_is_the_way_that_was_come():
    """Round a corner: a straight way back would cut it."""
    joints, corner, home = ClosedLoop(Arm()).joints, np.zeros((200, 7)), Arm().home
    corner[:100, 0] = np.linspace(0.0, 0.4, 100)
    corner[100:, 0] = 0.4
    corner[100:, 1] = np.linspace(0.0, 0.5, 100)
    way = PostureMotion(joints, home + corner[::-1][1:], 0.5)
    way.begin(home + corner[-1])
    passed = np.array([way.at(time)[0] - home for time in np.arange(0.0, way.remaining, 0.01)])
    np.testing.assert_allclose(passed[0] + home, corner[-1] + home)
    np.testing.assert_allclose(passed[-1], corner[0], atol=1e-9)
    # Either the first joint is at the corner or the second one at its start.
    assert np.minimum(np.abs(passed[:, 0] - 0.4), np.abs(passed[:, 1])).max() < 1e-2
    assert np.abs(np.diff(passed, axis=0)).max() <= 0.5 * 0.01 * 1.01
    rest = PostureMotion(joints, np.tile(home, (2, 1)), 0.5)
    rest.begin(home)
    np.testing.assert_array_equal(rest.at(0.0)[0] - home, 0.0)


def test_an_insertion_that_is_on_the_spot_succeeds_and_others_do_not():
    task, found = Insertion(), []
    skill = task.skill()
    for seed in range(6):
        outcome = task.rollout(skill, seed)
        away = np.linalg.norm(task.off(seed))
        assert away <= 0.003 and outcome.cost is not None
        found.append(outcome.success)
        if away > 0.0015:
            assert not outcome.success
    assert np.mean(found) <= 0.2

    class Known(Insertion):
        """The hole is where it is believed to be."""

        def off(self, seed):
            return np.zeros(2)
    outcome = Known().rollout(skill, 0)
    assert outcome.success and outcome.cost < 0.05
    assert np.allclose(skill.start[:2], PLACE)


def test_the_same_seed_gives_the_same_outcome():
    task = Insertion()
    skill = task.skill()
    assert task.rollout(skill, 5) == task.rollout(skill, 5)
    assert Reach(Arm()).problem(skill.start[:7]) == ''
