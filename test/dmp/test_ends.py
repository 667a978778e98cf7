"""A skill between other ends is the roll-out between them, as a skill."""
import numpy as np
import pytest

from gdmp_ros import Skill, SpecialOrthogonal, Sphere
from test.motions import motion, takes, TOOL, wave


def elsewhere(manifold, point, rng, size=0.2):
    step = manifold.random_tangent(point, rng)
    return manifold.exp(point, step * (size / manifold.norm(point, step)))


@pytest.mark.parametrize('connection', ['parallel', 'published'])
@pytest.mark.parametrize('manifold', [TOOL, SpecialOrthogonal(3), Sphere(2)], ids=str)
def test_it_moves_as_a_roll_out_between_these_ends(manifold, connection, rng, tmp_path):
    skill = Skill.learn(motion(manifold, rng), 20, connection=connection)
    start, goal = (elsewhere(manifold, point, rng) for point in (skill.start, skill.goal))
    moved = skill.between(start, goal)
    times = np.linspace(0.0, 1.2 * skill.duration, 50)
    wanted = skill.rollout(start=start, goal=goal).sample(times)
    found = moved.rollout().sample(times)
    np.testing.assert_allclose(found.points, wanted.points, atol=1e-9)
    moved.save(tmp_path / 'moved.json')
    again = Skill.load(tmp_path / 'moved.json').rollout().sample(times)
    np.testing.assert_array_equal(again.points, found.points)


def test_via_points_stay_where_they_are(rng):
    skill = Skill.learn(wave(TOOL, rng, np.linspace(0.0, 2.0, 300)), 30)
    goal = elsewhere(TOOL, skill.goal, rng)
    moved = skill.between(goal=goal)
    via = moved.rollout(duration=1.0).sample([0.4]).points[0].copy()
    via[0] += 0.05
    bent = moved.through([(0.4, via)], ['position'])
    passed = bent.rollout(duration=1.0).sample([0.4, 5.0]).points
    np.testing.assert_allclose(passed[0, :3], via[:3], atol=1e-6)
    np.testing.assert_allclose(passed[1], goal, atol=1e-4)


def test_takes_vary_in_the_same_directions(rng):
    skill = Skill.learn(takes(TOOL, 6, rng), 20)
    same = skill.between(skill.start, skill.goal)
    np.testing.assert_allclose(same.distribution.covariance(0.7),
                               skill.distribution.covariance(0.7), atol=1e-12)
    step = np.zeros(TOOL.tangent_size)
    step[:3] = 0.1  # flat: the same covariance there
    moved = skill.between(goal=TOOL.exp(skill.goal, TOOL.from_frame(
        TOOL.frame(skill.goal), step)))
    np.testing.assert_allclose(moved.distribution.covariance(1.0)[:3, :3],
                               skill.distribution.covariance(1.0)[:3, :3], atol=1e-9)
