"""Where curvature sets limits: learned right, or refused."""
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gdmp_ros import DataError, Demonstration, GdmpWarning, Skill, SymmetricPositiveDefinite
from gdmp_ros.dmp.evaluation import reproduction_error
from gdmp_ros.util.profiles import minimum_jerk

TIMES = np.linspace(0.0, 2.0, 300)


def turning(condition, turn=1.0):
    """An ellipsoid of a condition number that turns and grows."""
    points = []
    for x in minimum_jerk(TIMES / 2.0):
        rotation = Rotation.from_rotvec(turn * x * np.array([0.8, 0.5, -0.3])).as_matrix()
        values = np.array([condition ** -0.5, 1.0, condition ** 0.5]) * (1.0 + x)
        points.append((rotation * values) @ rotation.T)
    points = np.array(points)
    return Demonstration(TIMES, 0.5 * (points + points.transpose(0, 2, 1)),
                         SymmetricPositiveDefinite(3))


@pytest.mark.parametrize('condition', [1e2, 1e4, 1e5, 1e6, 1e8, 1e10, 1e14])
def test_matrices_of_any_condition_are_learned_right_or_refused(condition):
    # Without a turn they commute: the motion is as on a flat space.
    straight = turning(condition, 0.0)
    assert reproduction_error(Skill.learn(straight), straight)[0] < 1e-4
    try:
        shown = turning(condition)
        skill = Skill.learn(shown)
    except DataError as error:
        assert condition >= 1e4 and ('curved too much' in str(error) or 'not finite' in str(error)
                                     or 'positive definite' in str(error))
    else:
        assert reproduction_error(skill, shown)[0] < 1e-2


def test_a_motion_that_published_cannot_follow_is_reported():
    with pytest.warns(GdmpWarning, match="connection='parallel' follows it"):
        Skill.learn(turning(100.0), connection='published')
