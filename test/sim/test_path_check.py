"""A path that an arm cannot follow is recognised, with the reason."""
import numpy as np
import pytest

from gdmp_ros import Skill
from gdmp_ros.errors import DataError
from gdmp_ros.sim import Arm
from gdmp_ros.sim.path_check import PathChecker, TOUCHING_M
from test.commands import gdmp
from test.pictures import drawn


@pytest.fixture(scope='module')
def letter(letters):
    """Times and poses of a letter in front of the arm."""
    shown = letters[0]
    return shown.times[::20], shown.points[::20, :7]


@pytest.mark.parametrize('shift, reason', [
    ((0.0, 0.0, 0.0), None),
    ((0.4, 0.0, 0.0), 'out of reach'),
    ((0.4, 0.0, 0.0), 'singular'),
    ((-0.6, 0.0, 0.0), 'at its limit'),
    ((0.0, 0.0, -0.4), 'touches itself or the floor')])
def test_the_reason_is_told(letter, shift, reason):
    times, poses = letter[0], letter[1].copy()
    poses[:, :3] += shift
    found = PathChecker(Arm()).check(times, poses)
    assert bool(found.problems()) == found.wrong.any() == (reason is not None)
    assert reason is None or any(reason in problem for problem in found.problems())


def test_postures_are_those_of_the_path(letter):
    arm, (times, poses) = Arm(), letter
    found = PathChecker(arm).check(times, poses)
    for posture, pose in zip(found.postures, poses):
        np.testing.assert_allclose(arm.pose_at(posture)[:3], pose[:3], atol=1e-3)
    # No jump to another posture with the same pose.
    assert np.abs(np.diff(found.postures, axis=0)).max() < 0.3


def test_a_path_of_the_joints_is_checked_as_it_is():
    arm = Arm()
    path = np.linspace(arm.home, arm.home + 0.2, 5)
    path[3, 3] = arm.limits.lower[3]
    found = PathChecker(arm).check_postures(np.arange(5.0), path)
    np.testing.assert_array_equal(found.postures, path)
    assert found.wrong.tolist() == [False, False, False, True, False]
    assert found.joint[3] == 3
    with pytest.raises(DataError, match='of 6 joints, the arm has 7'):
        PathChecker(arm).check_postures(np.arange(5.0), path[:, :6])


def test_a_folded_arm_touches_itself():
    arm = Arm()
    folded = arm.home.copy()
    folded[3], folded[5] = arm.limits.lower[3], arm.limits.lower[5]
    folded[1] = -1.0
    pose = arm.pose_at(folded)
    found = PathChecker(arm).check([0.0], pose[None], folded)
    apart = PathChecker(arm).check([0.0], arm.pose_at(arm.home)[None])
    assert found.clearance[0] < TOUCHING_M < apart.clearance[0]


def test_the_command_ends_with_1_where_the_arm_cannot_follow(letters, tmp_path):
    Skill.learn(letters[0], 30).save(tmp_path / 'skill.json')
    good = gdmp('check', 'skill.json', cwd=tmp_path)
    assert good.returncode == 0 and 'can follow the whole path' in good.stdout
    bad = gdmp('check', 'skill.json', '--goal-position', 0.9, 0.3, 0.3, '--plot', 'check.png',
               cwd=tmp_path)
    assert bad.returncode == 1 and 'out of reach from' in bad.stdout
    assert drawn(tmp_path / 'check.png') > 0.01
