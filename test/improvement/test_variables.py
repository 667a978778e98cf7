"""What a search may change of a skill, on all manifolds."""
import numpy as np
import pytest

from gdmp_ros import Demonstration, Skill
from gdmp_ros.errors import ParameterError
from gdmp_ros.improvement.variables import (
    Spiral,
    Stiffness,
    Tempo,
    Variables,
    ViaPoints,
    Weights,
)
from gdmp_ros.manifolds import Euclidean, Product, UnitQuaternion
from gdmp_ros.manifolds.poses import tool_manifold
from gdmp_ros.util.profiles import minimum_jerk
from test.motions import MANIFOLDS, motion

S = np.linspace(0.0, 1.0, 120)
KINDS = [one for one in MANIFOLDS if not isinstance(one, Product)]


def skill_on(manifold):
    shown = motion(manifold, np.random.default_rng(2))
    return Skill.learn(shown, 25)


def named(manifold):
    return Product(manifold, names=('it',))


def tool_skill(size=3):
    stiffness = np.diag(np.arange(1.0, size + 1) * 100.0).reshape(-1)
    points = np.tile([0.4, 0.0, 0.4, 0.0, 1.0, 0.0, 0.0, *stiffness], (len(S), 1))
    points[:, 0] += 0.2 * minimum_jerk(S)
    return Skill.learn(Demonstration(2.0 * S, points, tool_manifold(size)), 25)


def path(skill, progress=S):
    return skill.rollout().sample(skill.duration * progress).points.reshape(len(progress), -1)


@pytest.mark.parametrize('manifold', KINDS, ids=repr)
def test_zero_changes_nothing_and_one_displaces_by_the_deviation(manifold):
    skill = skill_on(named(manifold))
    for part in (Weights(6, {'it': 0.03}), ViaPoints((0.3, 0.6), {'it': 0.03})):
        variables = Variables(skill, [part])
        before = path(skill)
        assert skill.manifold.factor_distances(
            path(variables.apply(np.zeros(variables.size))), before).max() < 1e-6
        values = np.zeros(variables.size)
        values[variables.size // 2] = 1.0
        away = skill.manifold.factor_distances(path(variables.apply(values)), before)
        assert away.max() == pytest.approx(0.03, rel=0.15)
        # The way on is the same: it ends where it ended.
        assert away[-1] < 0.004


def test_a_bump_acts_where_it_is():
    skill = skill_on(named(Euclidean(2)))
    variables = Variables(skill, [Weights(8, {'it': 0.03})])
    at = []
    for number in range(1, 7):
        values = np.zeros(variables.size)
        values[2 * number] = 1.0
        away = skill.manifold.factor_distances(path(variables.apply(values)), path(skill))
        at.append(S[int(np.argmax(away[:, 0]))])
    assert (np.diff(at) > 0.0).all()


def test_a_spiral_covers_a_disk_and_nothing_else():
    points = np.column_stack([0.1 * S, 0.2 * S, 0.3 * S])
    skill = Skill.learn(Demonstration(2.0 * S, points, named(Euclidean(3))), 40)
    variables = Variables(skill, [Spiral(4, 0.003, factor='it')])
    for nothing in (0.0, -1.0):
        np.testing.assert_array_equal(path(variables.apply(np.array([nothing]))), path(skill))
    away = path(variables.apply(np.array([2.0]))) - path(skill)
    assert np.abs(away[:, 2]).max() < 1e-9 and np.abs(away[S < 0.3]).max() < 3e-4
    assert np.linalg.norm(away, axis=1).max() == pytest.approx(0.006, rel=0.1)
    # Each place of the disk is passed within half the distance between two turns.
    dense = np.linspace(0.0, 1.0, 4000)
    near = path(variables.apply(np.array([2.0])), dense) - path(skill, dense)
    for angle in np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False):
        for radius in (0.001, 0.003, 0.005):
            place = radius * np.array([np.cos(angle), np.sin(angle)])
            assert np.linalg.norm(near[:, :2] - place, axis=1).min() < 0.001


@pytest.mark.parametrize('count', [1, 2, 5])
def test_the_stiffness_is_scaled_along_its_axes(count):
    skill = tool_skill()
    variables = Variables(skill, [Stiffness(count, 0.5)])
    assert variables.size == 3 * count
    values = np.tile([1.0, 0.0, -1.0], count)
    changed = variables.apply(values)
    places = np.linspace(0.0, 1.0, max(count, 2))
    for s, before, after in zip(places, path(skill, places), path(changed, places)):
        ratio = after[7:].reshape(3, 3).diagonal() / before[7:].reshape(3, 3).diagonal()
        np.testing.assert_allclose(ratio, np.exp([0.5, 0.0, -0.5]), rtol=2e-3, err_msg=f'{s}')
    np.testing.assert_allclose(path(changed)[:, :7], path(skill)[:, :7], atol=1e-9)
    grouped = Variables(skill, [Stiffness(1, 0.5, ((0, 1), (2,)))])
    assert grouped.names == ['stiffness 1 axes 1 2', 'stiffness 1 axes 3']


def test_the_tempo_changes_the_duration_only():
    skill = tool_skill()
    changed = Variables(skill, [Tempo(0.2)]).apply(np.array([1.0]))
    assert changed.duration == pytest.approx(skill.duration * np.exp(-0.2))
    np.testing.assert_allclose(path(changed), path(skill), atol=1e-9)


def test_variables_lie_one_after_the_other():
    skill = tool_skill()
    parts = [Weights(4, {'position': 0.01}), Tempo(), ViaPoints((0.5,), {'orientation': 0.1})]
    variables = Variables(skill, parts)
    assert variables.size == 12 + 1 + 3 and variables.names[12] == 'tempo'
    values = np.zeros(16)
    values[12] = 1.0
    assert variables.apply(values).duration < skill.duration
    values = np.zeros(16)
    values[13] = 1.0
    at = path(variables.apply(values), np.array([0.5]))[0]
    assert UnitQuaternion().distance(at[3:7], path(skill, np.array([0.5]))[0, 3:7]) == (
        pytest.approx(0.1, rel=1e-3))


def test_what_a_skill_does_not_have_is_refused():
    skill = skill_on(named(Euclidean(2)))
    for parts, text in (([], 'nothing varies'), ([Weights(3, {'position': 0.1})], "'position'"),
                        ([Stiffness(1)], "'stiffness'"), ([Stiffness(1, factor='it')], 'SPD'),
                        ([Weights(3, {'it': 0.1}, (2,))], 'axis is 2'),
                        ([Spiral(20, 0.1, factor='it')], 'needs a skill of 146 basis')):
        with pytest.raises(ParameterError, match=text):
            Variables(skill, parts)
