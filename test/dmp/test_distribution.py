"""Distributions of motions: what is certain, what is likely, and conditions."""
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from gdmp_ros import (
    DataError,
    Demonstration,
    Euclidean,
    GdmpWarning,
    ManifoldError,
    ParameterError,
    Skill,
    SpecialOrthogonal,
    Sphere,
    SymmetricPositiveDefinite,
    UnitQuaternion,
)
from gdmp_ros.dmp.response import responses
from gdmp_ros.dmp.variation import Variation
from gdmp_ros.util.profiles import minimum_jerk
from test.motions import TAKE_TIMES as TIMES
from test.motions import takes, TOOL

MANIFOLDS = [Euclidean(3), Sphere(2), UnitQuaternion(), SpecialOrthogonal(3),
             SymmetricPositiveDefinite(2), TOOL]


def point_at(skill, s):
    return skill.rollout(duration=1.0).advance(s).point


def test_one_take_has_no_distribution(rng):
    shown = takes(Euclidean(2), 3, rng)
    assert Skill.learn(shown[0]).distribution is None
    assert Skill.learn(shown, fit='forcing').distribution is None
    assert Skill.learn(shown).distribution is not None


@pytest.mark.parametrize('connection', [
    'parallel', pytest.param('published', marks=pytest.mark.long)])
@pytest.mark.parametrize('manifold', MANIFOLDS, ids=repr)
def test_conditions_are_met(manifold, connection, rng):
    shown = takes(manifold, 6, rng)
    skill = Skill.learn(shown[1:], 40, connection=connection)
    distribution = skill.distribution
    size = manifold.tangent_size
    via = manifold.exp(distribution.mean(0.4), 0.03 * manifold.random_tangent(
        distribution.mean(0.4), rng))
    wanted = [(0.0, shown[0].points[0]), (0.4, via), (1.0, shown[0].points[-1])]
    made = distribution.condition(wanted)
    assert manifold.distance(made.start, wanted[0][1]) < 1e-6
    assert manifold.distance(made.goal, manifold.align(wanted[2][1], made.goal)) < 1e-6
    assert manifold.distance(point_at(made, 0.4), manifold.align(via, point_at(made, 0.4))) < 1e-4
    # What is known does not vary any more; elsewhere some of the variation is left.
    noise = skill.variation.noise
    for s in (0.0, 0.4):
        left = made.distribution.covariance(s) - np.diag(noise)
        assert np.abs(left).max() < 1e-3 * np.abs(distribution.covariance(s)).max()
    for s in (0.0, 0.2, 0.5, 1.0):
        covariance = distribution.covariance(s)
        assert covariance.shape == (size, size)
        np.linalg.cholesky(covariance + 1e-15 * np.eye(size))


@pytest.mark.parametrize('manifold', [
    UnitQuaternion(), SymmetricPositiveDefinite(2), SymmetricPositiveDefinite(3), Sphere(2),
    SpecialOrthogonal(3)], ids=repr)
def test_three_points_of_a_motion_of_its_own_are_met(manifold):
    """Such a motion exists: where the space is curved, it has to be found."""
    for seed in range(6):
        rng = np.random.default_rng(seed)
        distribution = Skill.learn(takes(manifold, 6, rng), 30).distribution
        drawn = distribution.sample(rng)
        points = [(s, point_at(drawn, s)) for s in (0.2, 0.5, 0.8)]
        made = distribution.condition(points)
        assert max(manifold.distance(point_at(made, s), manifold.align(p, point_at(made, s)))
                   for s, p in points) < 1e-8


def test_takes_that_all_end_alike_tell_nothing_about_another_goal(rng):
    """The path is moved with its goal: noise of the ends is not carried on a hundred times."""
    s, shown = np.linspace(0.0, 1.0, 200), []
    for _ in range(6):
        arc = np.outer(16.0 * (s * (1.0 - s)) ** 2, [0.0, 0.1 + 0.05 * rng.standard_normal(), 0.0])
        goal = np.array([0.4, 0.0, 0.1]) + 1e-5 * rng.standard_normal(3)
        shown.append(Demonstration(2.0 * s, np.outer(minimum_jerk(s), goal) + arc, Euclidean(3)))
    skill = Skill.learn(shown, 30)
    goal = skill.goal + [0.1, 0.1, 0.0]
    with pytest.warns(GdmpWarning, match='standard deviations from those of the takes'):
        made = skill.distribution.condition([(0.0, skill.start), (1.0, goal)])
    times = np.linspace(0.0, 2.0, 100)
    moved = skill.between(goal=goal).rollout().sample(times).points
    assert np.abs(made.rollout().sample(times).points - moved).max() < 0.01
    np.testing.assert_allclose(made.goal, goal, atol=1e-9)


def test_a_point_that_cannot_be_met_is_refused(rng):
    distribution = Skill.learn(takes(Euclidean(3), 4, rng), 20).distribution
    with pytest.raises(ParameterError, match='no motion of this distribution was found'):
        distribution.condition([(0.5, np.full(3, 1e200))])


def test_conditioning_is_that_of_a_promp_with_the_same_weights(rng):
    promp = pytest.importorskip('movement_primitives.promp')
    count, size = 20, 3
    plain = Skill.learn(takes(Euclidean(size), 4, rng), count)
    # A distribution of the weights alone.
    root = np.zeros(((2 + count) * size, 50))
    root[2 * size:] = 0.1 * rng.standard_normal((count * size, 50))
    skill = replace(plain, variation=Variation(root, np.zeros(size)))
    # Their weights are ordered by dimension.
    order = np.arange(count * size).reshape(count, size).T.reshape(-1)
    weights = root[2 * size:][order]
    for s, covariance in ((0.6, None), (0.35, 1e-4 * np.diag([1.0, 2.0, 3.0]))):
        rows = responses(count, skill.gains).at(np.array([s]))[1][0, 1:]
        peer = promp.ProMP(size, count)
        peer.from_weight_distribution(np.zeros(count * size), weights @ weights.T)
        peer._rbfs_1d_point = lambda *_, rows=rows: rows
        value = skill.distribution.mean(s) + [0.02, -0.01, 0.03]
        expected = peer.condition_position(value - skill.distribution.mean(s), covariance)
        wanted = (s, value) if covariance is None else (s, value, covariance)
        made = skill.distribution.condition([wanted])
        np.testing.assert_allclose((made.weights - skill.weights).T.reshape(-1),
                                   expected.weight_mean, atol=1e-9)
        left = made.variation.factor[2 * size:][order]
        np.testing.assert_allclose(left @ left.T, expected.weight_cov, atol=1e-9)


@pytest.mark.long
def test_tubes_hold_for_takes_that_were_not_seen(rng):
    manifold, inside = Euclidean(3), []
    for _ in range(20):
        shown = takes(manifold, 9, rng, timing=0.0)
        distribution = Skill.learn(shown[1:], 40, align=False).distribution
        for s in (0.1, 0.3, 0.5, 0.7, 0.9):
            away = shown[0].at(np.array([2.0 * s]))[0] - distribution.mean(s)
            squared = away @ np.linalg.solve(distribution.covariance(s), away)
            inside.append([squared <= chi2.ppf(share, 3) for share in (0.68, 0.95)])
    shares = np.mean(inside, axis=0)
    assert 0.65 <= shares[0] <= 0.90 and 0.92 <= shares[1] <= 0.99


def test_a_condition_on_start_and_goal_predicts_what_goes_with_them(rng):
    """The bow of these takes follows from their start."""
    manifold, shown = Euclidean(2), []
    blend = minimum_jerk(TIMES / TIMES[-1])[:, None]
    for shift in np.linspace(-0.1, 0.1, 9):
        shown.append(Demonstration(TIMES, blend * [0.5, 0.0] + (1.0 - blend) * [0.0, shift]
                                   + np.sin(np.pi * blend) ** 2 * [0.0, 2.0 * shift], manifold))
    skill = Skill.learn(shown[:-1], 40)
    last = shown[-1]
    moved = skill.rollout(start=last.points[0], goal=last.points[-1])
    made = skill.distribution.condition([(0.0, last.points[0]), (1.0, last.points[-1])])
    errors = [np.abs(rollout.sample(TIMES).points - last.points).max()
              for rollout in (moved, made.rollout())]
    assert errors[1] < 0.4 * errors[0]


def test_ends_that_tell_nothing_do_not_change_a_skill_of_few_takes(rng):
    """The shape of these takes has nothing to do with where they start and end."""
    manifold, ratios = Euclidean(2), []
    blend = minimum_jerk(TIMES / TIMES[-1])[:, None]
    for count in (5, 6, 7):
        for _ in range(4):
            shown = []
            for _ in range(count):
                start, end, bow, wave = rng.normal(scale=0.02, size=(4, 2))
                shown.append(Demonstration(
                    TIMES, (1.0 - blend) * start + blend * ([0.5, 0.0] + end)
                    + np.sin(np.pi * blend) ** 2 * bow
                    + np.sin(2.0 * np.pi * blend) * np.sin(np.pi * blend) * wave, manifold))
            skill, last = Skill.learn(shown[:-1], 25, align=False), shown[-1]
            ends = last.points[0], last.points[-1]
            made = skill.distribution.condition([(0.0, ends[0]), (1.0, ends[1])])
            errors = [np.linalg.norm(rollout.sample(TIMES).points - last.points, axis=1).mean()
                      for rollout in (skill.rollout(start=ends[0], goal=ends[1]), made.rollout())]
            ratios.append(errors[1] / errors[0])
    assert np.median(ratios) <= 1.01 and max(ratios) <= 1.05


def test_samples_are_like_the_takes(rng):
    shown = takes(TOOL, 9, rng, timing=0.0)
    skill = Skill.learn(shown, 40)
    drawn = [skill.distribution.sample(rng) for _ in range(60)]
    assert all(one.manifold == TOOL for one in drawn)
    for s in (0.0, 0.5, 1.0):
        mean = skill.distribution.mean(s)
        away = [TOOL.log_in_frame(TOOL.frame(mean), TOOL.align(point_at(one, s), mean))[0]
                for one in drawn]
        ratio = np.sqrt(np.mean(np.square(away), axis=0)
                        / np.diag(skill.distribution.covariance(s)))
        assert 0.6 < np.median(ratio) < 1.4
    again = skill.distribution.sample(np.random.default_rng(3))
    same = skill.distribution.sample(np.random.default_rng(3))
    np.testing.assert_array_equal(again.weights, same.weights)


def test_a_likely_point_is_approached_and_a_certain_one_met(rng):
    skill = Skill.learn(takes(Euclidean(2), 5, rng), 40)
    mean, covariance = skill.distribution.mean(0.5), skill.distribution.covariance(0.5)
    wanted = mean + [0.05, 0.0]
    distances = []
    for scale in (0.0, 1.0, 100.0):
        made = skill.distribution.condition([(0.5, wanted, scale * covariance)])
        distances.append(np.linalg.norm(point_at(made, 0.5) - wanted))
    assert distances[0] < 1e-9 < distances[1] < distances[2] < 0.05
    assert 0.4 < distances[1] / 0.05 < 0.6


def test_a_distribution_is_saved_with_its_skill(tmp_path, rng):
    skill = Skill.learn(takes(UnitQuaternion(), 4, rng), 30)
    skill.save(tmp_path / 'skill.json')
    loaded = Skill.load(tmp_path / 'skill.json')
    np.testing.assert_array_equal(loaded.variation.factor, skill.variation.factor)
    np.testing.assert_array_equal(loaded.distribution.covariance(0.3),
                                  skill.distribution.covariance(0.3))
    made = skill.distribution.condition([(0.0, skill.distribution.mean(0.01))])
    made.save(tmp_path / 'made.json')
    np.testing.assert_array_equal(Skill.load(tmp_path / 'made.json').weights, made.weights)
    with pytest.raises(DataError, match='variation: factor has shape'):
        replace(skill, variation=Variation(np.zeros((3, 2)), np.zeros(3)))


def test_what_is_no_condition_is_refused(rng):
    distribution = Skill.learn(takes(Sphere(2), 3, rng)).distribution
    point = distribution.mean(0.5)
    for wanted, reason in (([], 'at least one'), ([(0.5, point), (0.5, point)], 'another s'),
                           ([(1.5, point)], 's is 1.5'), ([(np.nan, point)], 's is nan'),
                           ([('a', point)], "s is 'a'"), ([(0.5,)], '1 parts'),
                           ([(0.5, point, -np.eye(3))], 'no positive semidefinite'),
                           ([(0.5, point, np.eye(2))], 'no positive semidefinite')):
        with pytest.raises(ParameterError, match=reason):
            distribution.condition(wanted)
    with pytest.raises(ManifoldError):
        distribution.condition([(0.5, 2.0 * point)])
    for call in (distribution.mean, distribution.covariance):
        with pytest.raises(ParameterError, match='s is 2'):
            call(2)


def test_durations_vary_as_those_of_the_takes(rng, tmp_path):
    shown = takes(Euclidean(2), 6, rng)
    shown = [Demonstration(one.times * length, one.points, one.manifold)
             for one, length in zip(shown, (0.8, 0.9, 1.0, 1.0, 1.1, 1.25))]
    skill = Skill.learn(shown, 20)
    stated = np.std(np.log([one.duration for one in shown]), ddof=1)
    assert skill.distribution.timing == pytest.approx(stated)
    drawn = [skill.distribution.sample(rng).duration for _ in range(300)]
    assert np.std(np.log(drawn)) == pytest.approx(stated, rel=0.15)
    skill.save(tmp_path / 'skill.json')
    assert Skill.load(tmp_path / 'skill.json').distribution.timing == skill.variation.timing
    assert Skill.learn(takes(Euclidean(2), 3, rng), 20).distribution.timing == 0.0
