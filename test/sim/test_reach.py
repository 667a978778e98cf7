"""Goals that an arm can and cannot reach."""
import numpy as np
import pytest

from gdmp_ros.data import lasa
from gdmp_ros.sim import Arm
from gdmp_ros.sim.path_check import Reach


@pytest.fixture(scope='module')
def arm():
    return Arm()


@pytest.fixture(scope='module')
def reach(arm):
    return Reach(arm)


def test_every_pose_of_a_posture_within_the_limits_is_reached(arm, reach, rng):
    for _ in range(300):
        arm.reset(rng.uniform(arm.limits.lower, arm.limits.upper))
        assert reach.problem(arm.measure().pose.copy()) == ''


def test_the_letters_are_reached(reach):
    for letter in ('GShape', 'Sshape'):
        for pose in lasa.robot_demonstrations(letter)[0].points[::200, :7]:
            assert reach.problem(pose) == ''


@pytest.mark.parametrize('position, turned, told', [
    ((0.75, 0.55, 0.9), False, 'comes within'),
    ((0.0, 0.0, 0.02), False, 'comes within'),
    ((0.8, 0.0, 0.1), True, 'comes within'),
])
def test_what_is_too_far_or_turned_too_far_is_named(reach, position, turned, told):
    downwards, upwards = (0.0, 1.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)
    problem = reach.problem(np.array([*position, *(upwards if turned else downwards)]))
    assert told in problem and 'joint limits' in problem
