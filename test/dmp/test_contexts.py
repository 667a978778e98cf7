"""Skills for contexts: heights, weights and places that were not shown."""
import json
import warnings

import numpy as np
import pytest
from scipy.interpolate import LinearNDInterpolator

from gdmp_ros import DataError, Demonstration, Euclidean, GdmpWarning, ParameterError, Skill
from gdmp_ros.util.profiles import minimum_jerk
from test.motions import MANIFOLDS, takes, TOOL

SAMPLES = 200
LOW, HIGH = np.array([-1.0, -1.0]), np.array([1.0, 1.0])


class Family:
    """Motions that depend on two numbers, smoothly and not linearly."""

    def __init__(self, manifold):
        self.manifold = manifold
        self.base = manifold.random_point(np.random.default_rng(5))
        self.frame = manifold.frame(self.base)
        # Two orthogonal directions, in all factors.
        random = np.random.default_rng(6).standard_normal((manifold.tangent_size, 2))
        coordinates = [manifold.to_frame(self.frame, manifold.from_frame(self.frame, column))
                       for column in random.T]
        self.directions = np.linalg.qr(np.array(coordinates).T)[0].T

    def away(self, height, side):
        """Coordinates at the base, shape ``(SAMPLES, n)``."""
        one, other = self.directions
        blend = minimum_jerk(np.linspace(0.0, 1.0, SAMPLES))[:, None]
        hop = np.sin(np.pi * blend) ** 2
        turned = np.cos(1.3 * side) * one + np.sin(1.3 * side) * other
        return (0.6 * blend * turned + 0.25 * np.exp(0.7 * height) * hop * other
                - 0.1 * height * side * hop * one)

    def duration(self, height):
        return 2.0 * np.exp(0.2 * height)

    def at(self, away):
        return np.array([self.manifold.exp(self.base, self.manifold.from_frame(self.frame, row))
                         for row in away])

    def take(self, height, side, rng=None):
        """With a generator: timing and motion differ, as a person would show it."""
        away, times = self.away(height, side), np.linspace(0.0, 1.0, SAMPLES)
        if rng is not None:
            shift = 0.05 * rng.uniform(-1.0, 1.0) * np.sin(np.pi * times) ** 2
            away = np.array([np.interp(times + shift, times, column) for column in away.T]).T
            away += 0.01 * np.sin(np.pi * times[:, None]) ** 2 * rng.standard_normal(
                away.shape[1])
        return Demonstration(self.duration(height) * times, self.at(away), self.manifold)


def grid(count):
    side = np.linspace(LOW, HIGH, count)
    return np.array([(h, s) for h in side[:, 0] for s in side[:, 1]])


def error(manifold, path, wanted):
    away = manifold.factor_distances(np.ascontiguousarray(path.reshape(SAMPLES, -1)),
                                     wanted.points.reshape(SAMPLES, -1))
    return np.linalg.norm(away, axis=1).mean()


def path_of(skill):
    return skill.rollout().sample(np.linspace(0.0, skill.duration, SAMPLES)).points


@pytest.mark.parametrize('manifold', [
    *(pytest.param(one, marks=pytest.mark.long) for one in MANIFOLDS[:-1]), MANIFOLDS[-1]],
    ids=repr)
def test_sixteen_takes_know_as_much_as_a_dense_sampling(manifold, rng, tmp_path):
    family, shown = Family(manifold), grid(4)
    Skill.learn([family.take(*one) for one in shown], 60, contexts={
        'height': shown[:, 0], 'side': shown[:, 1]}).save(tmp_path / 'skill.json')
    skill, dense = Skill.load(tmp_path / 'skill.json'), grid(8)
    between = LinearNDInterpolator(dense, [family.away(*one).reshape(-1) for one in dense])
    ours, usual = [], []
    for height, side in rng.uniform(LOW, HIGH, (10, 2)):
        wanted = family.take(height, side)
        made = skill.distribution.condition(context={'side': side, 'height': height})
        assert made.duration == pytest.approx(wanted.duration, rel=2e-3)
        ours.append(error(manifold, path_of(made), wanted))
        usual.append(error(manifold, family.at(between(height, side).reshape(SAMPLES, -1)),
                           wanted))
    assert np.mean(ours) <= 1.5 * np.mean(usual)


def test_takes_of_a_person_are_aligned_with_the_motion_of_their_context(rng):
    family, shown = Family(Euclidean(3)), grid(4)
    people = [family.take(*one, rng) for one in shown]
    errors = {}
    for align in (True, False):
        skill = Skill.learn(people, 60, contexts=shown, align=align)
        errors[align] = np.mean([error(family.manifold, path_of(
            skill.distribution.condition(context=one)), family.take(*one))
            for one in rng.uniform(LOW, HIGH, (10, 2))])
    assert errors[True] < min(errors[False], 0.03)  # 5 % of the span


def test_what_the_context_explains_is_certain_and_points_can_be_met_besides(rng):
    family, shown = Family(MANIFOLDS[-1]), grid(4)
    skill = Skill.learn([family.take(*one, rng) for one in shown], 40, contexts=shown)
    made = skill.distribution.condition(context=[0.6, -0.4])
    assert np.trace(made.distribution.covariance(1.0)) < 0.1 * np.trace(
        skill.distribution.covariance(1.0))
    assert made.variation.contexts is None
    middle = made.distribution.mean(0.5)
    via = family.manifold.exp(middle, 0.02 * family.manifold.random_tangent(middle, rng))
    both = skill.distribution.condition([(0.5, via)], context=[0.6, -0.4])
    assert family.manifold.distance(both.distribution.mean(0.5), via) < 1e-6


def test_outside_of_what_was_shown_it_says_so_and_is_less_certain(rng):
    family, shown = Family(Euclidean(3)), grid(4)
    shown = shown[shown.sum(axis=1) < 1.0]  # never high and at the side together
    skill = Skill.learn([family.take(*one, rng) for one in shown], 40,
                        contexts=dict(zip(('height', 'side'), shown.T)))
    inside = skill.distribution.condition(context=[0.2, -0.3])
    with pytest.warns(GdmpWarning, match='height is 1.7, the takes show -1 to 1; .* a guess'):
        far = skill.distribution.condition(context=[1.7, -0.3])
    with pytest.warns(GdmpWarning, match='no combination like height 1, side 0.99; .* a guess'):
        skill.distribution.condition(context=[1.0, 0.99])
    assert np.trace(far.distribution.covariance(0.5)) > 2.0 * np.trace(
        inside.distribution.covariance(0.5))


def test_a_skill_moved_elsewhere_keeps_its_contexts(rng):
    family, shown = Family(Euclidean(3)), grid(3)
    skill = Skill.learn([family.take(*one) for one in shown], 40, contexts=shown)
    by = np.array([0.3, -0.2, 0.1])
    moved = skill.between(skill.start + by, skill.goal + by)
    first, other = (one.distribution.condition(context=[0.5, 0.2]) for one in (skill, moved))
    np.testing.assert_allclose(path_of(other), path_of(first) + by, atol=1e-9)


def test_a_number_that_says_nothing_leaves_the_takes_as_they_are(rng):
    shown = takes(Euclidean(2), 8, rng)
    plain = Skill.learn(shown, 20)
    skill = Skill.learn(shown, 20, contexts=rng.standard_normal((8, 1)))
    for s in (0.2, 0.5, 1.0):
        ratio = np.trace(skill.distribution.covariance(s)) / np.trace(
            plain.distribution.covariance(s))
        assert 0.5 < ratio < 3.0


def test_contexts_that_cannot_be_used_are_refused(rng):
    shown = takes(Euclidean(2), 5, rng)
    skill = Skill.learn(shown, 20, contexts={'height': [1.0, 2.0, 3.0, 4.0, 5.0]})
    with pytest.raises(ParameterError, match=r'expected 1 finite numbers \(height\)'):
        skill.distribution.condition(context=[1.0, 2.0])
    with pytest.raises(ParameterError, match='expected height, got width'):
        skill.distribution.condition(context={'width': 1.0})
    with pytest.raises(ParameterError, match='height is 9.5, further outside .*, 1 to 5, than'):
        skill.distribution.condition(context=[9.5])
    with pytest.raises(ParameterError, match='learned without contexts'):
        Skill.learn(shown, 20).distribution.condition(context=[1.0])
    with pytest.raises(ParameterError, match='one row for each'):
        Skill.learn(shown, 20, contexts=[[1.0], [2.0]])
    with pytest.raises(ParameterError, match='one row for each'):
        Skill.learn(shown, 20, contexts={'height': [1.0, 2.0]})
    with pytest.raises(DataError, match='does not vary'):
        Skill.learn(shown, 20, contexts=np.ones((5, 1)))
    with pytest.raises(DataError, match='expected at least 6'):
        Skill.learn(shown, 20, contexts=rng.standard_normal((5, 3)))
    with pytest.raises(ParameterError, match='contexts need'):
        Skill.learn(shown, fit='forcing', contexts=np.ones((5, 1)))


@pytest.mark.parametrize('change, reason', [
    (lambda c: c.update(names='height'), 'object with names'),
    (lambda c: c.update(names=['a', 'a']), 'takes has shape'),
    (lambda c: c.update(takes=[[1.0]] * 5), 'does not vary'),
    (lambda c: c.update(lengths=[0.0]), 'lengths and noise must be above 0'),
    (lambda c: c.update(trend=[[1.0, 2.0]]), 'trend has shape'),
    (lambda c: c.pop('bend'), 'bend')])
def test_damaged_contexts_are_refused(rng, tmp_path, change, reason):
    path = tmp_path / 'skill.json'
    Skill.learn(takes(Euclidean(2), 5, rng), 20, contexts=np.arange(5.0)[:, None]).save(path)
    document = json.loads(path.read_text())
    change(document['variation']['contexts'])
    path.write_text(json.dumps(document))
    with pytest.raises(DataError, match=reason):
        Skill.load(path)


@pytest.mark.parametrize('offset, factor', [(1e4, 1.0), (1e6, 1.0), (1.7e9, 10.0), (0.0, 1e-9),
                                            (0.0, 1e8), (-3e5, 1e-2)])
def test_the_unit_and_the_zero_of_a_context_do_not_matter(offset, factor, rng):
    shown = takes(TOOL, 7, rng)
    sizes = np.array([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    plain = Skill.learn(shown, 20, contexts={'size': sizes})
    other = Skill.learn(shown, 20, contexts={'size': offset + factor * sizes})
    for size in (0.5, 2.2, 5.9, 6.4):
        with warnings.catch_warnings():
            warnings.simplefilter('ignore', GdmpWarning)
            made = [plain.in_context([size]), other.in_context([offset + factor * size])]
        first, second = (one.rollout().sample(np.linspace(0.0, one.duration, 50)).points
                         for one in made)
        # 1.7e9 has seven digits less.
        assert np.abs(first - second).max() < 1e-6 * np.abs(first).max()


@pytest.mark.parametrize('numbers', [[2.0] * 6, 1.0 + 1e-12 * np.arange(6.0),
                                     [[1.0, 2.0]] * 6, [[k, 3.0 * k - 1.0] for k in range(6)]])
def test_numbers_that_do_not_vary_are_refused(numbers, rng):
    given = np.array(numbers, dtype=float).reshape(6, -1)
    with pytest.raises(DataError, match='does not vary between the takes, or follows'):
        Skill.learn(takes(TOOL, 6, rng), 20, contexts=given)
