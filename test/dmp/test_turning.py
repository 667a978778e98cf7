"""Skills turned as a whole."""
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gdmp_ros import (
    Euclidean,
    ParameterError,
    Rollout,
    Skill,
    Sphere,
    SymmetricPositiveDefinite,
    UnitQuaternion,
)
from gdmp_ros.dmp import changes
from test.motions import motion, takes, TOOL

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


@pytest.mark.parametrize('connection', ['parallel', 'published'])
def test_matrices_are_turned_by_a_congruence(connection, rng):
    """On SPD matrices a congruence that keeps the start is an isometry: Y = S½ Q S-½."""
    manifold = SymmetricPositiveDefinite(2)
    skill = Skill.learn(motion(manifold, rng), connection=connection)
    values, vectors = np.linalg.eigh(skill.start)
    root = (vectors * np.sqrt(values)) @ vectors.T
    rotation = Rotation.from_rotvec([0.0, 0.0, 0.7]).as_matrix()[:2, :2]
    keep = root @ rotation @ np.linalg.inv(root)
    turn = np.column_stack([manifold.log_in_frame(skill.frame, keep @ manifold.exp(
        skill.start, manifold.from_frame(skill.frame, row)) @ keep.T)[0]
                            for row in np.eye(manifold.tangent_size)])
    times = np.linspace(0.0, skill.duration, 40)
    plain, turned = (Rollout(skill, frame=frame).sample(times).points for frame in (None, turn))
    np.testing.assert_allclose(turned, keep @ plain @ keep.T, atol=1e-9)


def test_what_varies_is_turned_too(rng):
    shown = takes(UnitQuaternion(), 5, rng)
    skill = Skill.learn(shown, 20)
    turned = changes.turned(skill, TURN)
    manifold = skill.manifold
    for s in (0.0, 0.4, 1.0):
        # Seen from the turned frame, the same; noise is kept for each coordinate.
        first, second = (one.distribution.covariance(s) for one in (skill, turned))
        np.testing.assert_allclose(np.linalg.eigvalsh(second), np.linalg.eigvalsh(first),
                                   rtol=1e-3, atol=1e-12)
    assert manifold.distance(turned.goal, skill.goal) > 0.01


def test_the_other_quaternion_is_the_same_orientation(rng):
    skill = Skill.learn(motion(UnitQuaternion(), rng))
    times = np.linspace(0.0, skill.duration, 50)
    for start, goal in ((None, -skill.goal), (-skill.start, None), (-skill.start, -skill.goal)):
        moved = skill.between(start, goal)
        plain = Rollout(skill, start=start, goal=goal).sample(times).points
        np.testing.assert_allclose(Rollout(moved).sample(times).points, plain, atol=1e-9)
        np.testing.assert_allclose(plain, Rollout(skill).sample(times).points, atol=1e-9)


def test_a_sample_and_a_shift_carry_what_varies(rng):
    shown = takes(Sphere(2), 5, rng)
    drawn = Skill.learn(shown, 20).distribution.sample(rng)
    again = drawn.distribution.condition([(1.0, drawn.goal)])
    assert drawn.manifold.distance(again.goal, drawn.goal) < 1e-8
