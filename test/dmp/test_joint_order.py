"""Joints are known by their names, in whatever order they were recorded."""
import numpy as np
import pytest

from gdmp_ros.data.bags import joint_positions
from gdmp_ros.dmp.changes import joints_in_order
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import DataError, GdmpWarning
from gdmp_ros.manifolds import Euclidean, Product
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.path_check import check_skill, PathChecker
from gdmp_ros.util.profiles import minimum_jerk

S = np.linspace(0.0, 1.0, 100)
NAMES = [f'joint{k}' for k in range(1, 8)]
ORDER = [3, 0, 6, 1, 5, 2, 4]


def skill_of(names, columns, takes=1):
    """One joint after the other goes further; in some order."""
    way = 0.1 + 0.05 * np.arange(7)
    shown = []
    for take in range(takes):
        full = Arm().home + np.outer(minimum_jerk(S), way * (1.0 + 0.1 * take))
        full = np.column_stack([full, np.full(len(S), 0.04), np.full(len(S), 0.04)])
        shown.append(Demonstration(2.0 * S, full[:, columns], Product(
            Euclidean(len(columns)), names=('joints',))))
    return Skill.learn(shown, 20, provenance={'joints': list(names)})


def path_of(skill):
    return skill.rollout().sample(2.0 * S).points


@pytest.mark.parametrize('prefix', ['', 'panda_'])
@pytest.mark.parametrize('takes', [1, 3])
def test_joints_in_another_order_are_the_same_joints(prefix, takes):
    straight = skill_of(NAMES, range(7), takes)
    mixed = skill_of([prefix + NAMES[k] for k in ORDER], ORDER, takes)
    sorted_ = joints_in_order(mixed, NAMES)
    np.testing.assert_allclose(path_of(sorted_), path_of(straight), atol=1e-9)
    assert sorted_.provenance['joints'] == [prefix + name for name in NAMES]
    assert joints_in_order(straight, NAMES) is straight
    if takes > 1:
        np.testing.assert_allclose(sorted_.distribution.covariance(0.5),
                                   straight.distribution.covariance(0.5), atol=1e-9)


def test_a_check_is_that_of_the_right_joints():
    checker = PathChecker(Arm())
    results = [check_skill(skill, checker)[1] for skill in (
        skill_of(NAMES, range(7)), skill_of([NAMES[k] for k in ORDER], ORDER))]
    np.testing.assert_allclose(*results, atol=1e-9)


def test_fingers_are_left_out_and_other_joints_refused():
    columns = [8, *ORDER, 7]
    names = ['finger_joint2', *(NAMES[k] for k in ORDER), 'finger_joint1']
    with pytest.warns(GdmpWarning, match='finger_joint2, finger_joint1: left out'):
        sorted_ = joints_in_order(skill_of(names, columns), NAMES)
    np.testing.assert_allclose(path_of(sorted_), path_of(skill_of(NAMES, range(7))), atol=1e-9)
    for wrong, text in ((['torso', *NAMES[1:]], "'joint1' is missing"),
                        (['joint2', *NAMES[1:]], "'joint1' is missing"),
                        ([*NAMES, 'torso'], 'the arm has')):
        columns = list(range(7)) + [7] * (len(wrong) - 7)
        with pytest.raises(DataError, match=text):
            joints_in_order(skill_of(wrong, columns), NAMES)


def test_a_message_is_read_by_names():
    class Message:
        name = ['finger_joint1', *(f'fr3_{NAMES[k]}' for k in ORDER)]
        position = [0.04, *map(float, ORDER)]
    np.testing.assert_array_equal(joint_positions(Message, NAMES), np.arange(7.0))
    with pytest.raises(DataError, match="'elbow' is missing"):
        joint_positions(Message, ['elbow'])
    Message.name = ['joint1', 'joint1', *NAMES[2:], 'finger_joint1']
    with pytest.raises(DataError, match="'joint1' is there 2 times"):
        joint_positions(Message, NAMES)
