"""Skills turned as a whole."""
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gdmp_ros import Euclidean, ParameterError, Rollout, Skill, Sphere, UnitQuaternion
from test.motions import motion, TOOL

TURN = Rotation.from_rotvec([0.3, -0.5, 1.1]).as_matrix()


@pytest.mark.parametrize('connection', ['parallel', 'published'])
def test_a_path_in_space_is_turned_exactly(connection, rng):
    skill = Skill.learn(motion(Euclidean(3), rng), connection=connection)
    times = np.linspace(0.0, 1.3 * skill.duration, 100)
    plain, turned = (Rollout(skill, frame=frame).sample(times).points
                     for frame in (None, TURN))
    np.testing.assert_allclose(turned - skill.start, (plain - skill.start) @ TURN.T, atol=1e-12)
    # To another start and goal: the frame goes with it.
    start, goal = skill.start + [0.1, 0.2, 0.0], skill.goal + [0.1, 0.2, 0.3]
    away = goal - start
    plain = Rollout(skill, start=start, goal=goal).sample(times).points
    turned = Rollout(skill, start=start, goal=start + TURN @ away, frame=TURN).sample(times).points
    np.testing.assert_allclose(turned - start, (plain - start) @ TURN.T, atol=1e-12)


@pytest.mark.parametrize('connection', ['parallel', 'published'])
def test_orientations_and_directions_are_turned_exactly(connection, rng):
    for manifold in (UnitQuaternion(), Sphere(2)):
        skill = Skill.learn(motion(manifold, rng), connection=connection)
        # On a sphere the turn is about the start.
        turn = (TURN if manifold == UnitQuaternion()
                else Rotation.from_rotvec(1.1 * skill.start).as_matrix())
        times = np.linspace(0.0, skill.duration, 50)
        plain, turned = (Rollout(skill, frame=frame).sample(times).points
                         for frame in (None, turn))
        for first, second in zip(plain, turned):
            expected = turn @ manifold.log_in_frame(skill.frame, first)[0]
            np.testing.assert_allclose(manifold.log_in_frame(skill.frame, second)[0], expected,
                                       atol=1e-9)


def test_what_is_no_turn_is_refused(rng):
    skill = Skill.learn(motion(Euclidean(3), rng))
    for bad in (np.eye(2), 2.0 * np.eye(3), np.full((3, 3), np.nan)):
        with pytest.raises(ParameterError, match='expected an orthogonal matrix'):
            Rollout(skill, frame=bad)
    ball = Skill.learn(motion(Sphere(2), rng))
    with pytest.raises(ParameterError, match='out of the tangent space'):
        Rollout(ball, frame=TURN)
    tool = Skill.learn(motion(TOOL, rng))
    assert Rollout(tool, frame=np.eye(12)).advance(3.0 * tool.duration) is not None
