"""Names of joints are found among those of another program."""
import pytest

from gdmp_ros.errors import DataError
from gdmp_ros.util.names import indices_of

JOINTS = [f'joint{number}' for number in range(1, 8)]


@pytest.mark.parametrize('prefix', ['', 'panda_', 'fr3_', 'left/fr3_', 'robot_'])
@pytest.mark.parametrize('other', ['', 'panda_', 'fr3_'])
def test_joints_are_found_in_any_order_and_with_any_prefix(prefix, other):
    given = [f'{prefix}{name}' for name in reversed(JOINTS)] + [f'{prefix}finger_joint1']
    wanted = [f'{other}{name}' for name in JOINTS]
    assert indices_of(wanted, given, 'the joint') == list(range(6, -1, -1))


@pytest.mark.parametrize('wanted, given, why', [
    ('joint1', ['left_joint1', 'right_joint1'], 'there 2 times'),
    ('panda_joint1', ['left_joint1', 'right_joint1'], 'there 2 times'),
    ('shoulder_pan_joint', ['shoulder_lift_joint'], 'is missing'),
    ('panda_joint1', ['fr3_joint2', 'fr3_finger_joint1'], 'is missing'),
    ('panda_joint1', [], 'there are none')])
def test_what_is_not_there_or_not_clear_is_refused(wanted, given, why):
    with pytest.raises(DataError, match=why):
        indices_of([wanted], given, 'the joint')
