"""Via points."""
import numpy as np
import pytest

from gdmp_ros import Euclidean, GdmpWarning, ParameterError, Rollout, Skill
from test.motions import TOOL, wave


@pytest.mark.parametrize('connection', ['parallel', 'published'])
def test_via_points_are_passed_and_the_end_stays(connection, rng):
    shown = wave(TOOL, rng, np.linspace(0.0, 3.0, 600))
    skill = Skill.learn(shown, connection=connection)
    middle = Rollout(skill).sample(np.array([1.2, 2.1, 3.0])).points
    wanted = [TOOL.exp(p, 0.1 * TOOL.random_tangent(p, rng)) for p in middle[:2]]
    passing = skill.through([(0.4, wanted[0]), (0.7, wanted[1])])
    path = Rollout(passing).sample(np.array([1.2, 2.1, 3.0])).points
    for got, expected in zip(path, [*wanted, middle[2]]):
        assert TOOL.distance(got, expected) < 1e-6
    only = skill.through([(0.4, wanted[0])], factors=['position'])
    point = Rollout(only).sample(np.array([1.2])).points[0]
    np.testing.assert_allclose(point[:3], wanted[0][:3], atol=1e-6)
    assert TOOL.distance(point, wanted[0]) > 0.01
    np.testing.assert_array_equal(only.weights[:, 3:], skill.weights[:, 3:])


def test_via_points_are_exact_at_once_where_the_manifold_is_flat(rng):
    skill = Skill.learn(wave(Euclidean(3), rng, np.linspace(0.0, 2.0, 400)))
    passing = skill.through([(0.5, np.array([0.3, 0.2, 0.1]))])
    point = Rollout(passing).sample(np.array([1.0])).points[0]
    np.testing.assert_allclose(point, [0.3, 0.2, 0.1], atol=1e-7)
    for bad in ([(1.2, point)], [(0.3, point), (0.3, point)], []):
        with pytest.raises(ParameterError, match='between 0 and 1'):
            skill.through(bad)
    with pytest.raises(ParameterError, match="no factor is called 'arm'"):
        skill.through([(0.5, point)], factors=['arm'])


@pytest.mark.parametrize('connection', ['parallel', 'published'])
def test_via_points_of_earlier_calls_are_kept(connection, rng, tmp_path):
    shown = wave(TOOL, rng, np.linspace(0.0, 3.0, 600))
    skill = Skill.learn(shown, connection=connection)
    moments = np.array([0.3, 0.6, 0.8])
    wanted = [TOOL.exp(p, 0.03 * TOOL.random_tangent(p, rng))
              for p in Rollout(skill).sample(3.0 * moments).points]
    for s, point in zip(moments, wanted):
        skill = skill.through([(s, point)])
        skill.save(tmp_path / 'skill.json')
        skill = Skill.load(tmp_path / 'skill.json')
    assert skill.via == tuple(moments)
    for got, expected in zip(Rollout(skill).sample(3.0 * moments).points, wanted):
        assert TOOL.distance(got, expected) < 1e-6
    # One at the same progress replaces it.
    again = skill.through([(0.6, Rollout(skill).sample(np.array([1.85])).points[0])])
    assert again.via == skill.via


def test_a_via_point_that_costs_much_is_reported(rng):
    skill = Skill.learn(wave(Euclidean(3), rng, np.linspace(0.0, 2.0, 400)))
    with pytest.warns(GdmpWarning, match='the largest acceleration grows from'):
        skill.through([(0.5, skill.start + 5.0)])
