"""Whatever is given to learning and roll-outs: named errors only, and nothing hangs."""
from functools import cache
import warnings

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from gdmp_ros import (
    Demonstration,
    Euclidean,
    GdmpError,
    Rollout,
    Skill,
    Sphere,
    SymmetricPositiveDefinite,
    UnitQuaternion,
)
from gdmp_ros.util.profiles import minimum_jerk
from test.motions import TOOL

MANIFOLDS = [Euclidean(1), Euclidean(3), Sphere(2), UnitQuaternion(),
             SymmetricPositiveDefinite(2), TOOL]
NUMBERS = st.one_of(st.floats(allow_nan=True, allow_infinity=True, width=64),
                    st.sampled_from([0.0, -1.0, 1e-300, 1e300, 1e-3, 0.05, 5.0, 3601.0]))
#: Also what is no number.
ANYTHING = st.one_of(NUMBERS, st.none(), st.text(max_size=3), st.integers(-5, 5000), st.booleans())
QUICK = settings(max_examples=25)


def shown(manifold, samples=80, size=0.3, seed=1, duration=1.0):
    rng = np.random.default_rng(seed)
    base = manifold.random_point(rng)
    tangent = size * manifold.random_tangent(base, rng)
    times = np.linspace(0.0, duration, samples)
    return Demonstration(times, np.array([manifold.exp(base, b * tangent)
                                          for b in minimum_jerk(times / duration)]), manifold)


@cache
def learned(manifold, connection):
    """A skill, learned when it is needed."""
    return Skill.learn(shown(manifold), 20, connection=connection)


#: Of what skills are learned.
KINDS = [(manifold, connection)
         for manifold in MANIFOLDS for connection in ('parallel', 'published')]
SKILLS = st.sampled_from(KINDS).map(lambda kind: learned(*kind))


def tried(call):
    """Call; only named errors may come out, and what comes out is finite."""
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')
        try:
            return call()
        except GdmpError:
            return None


@QUICK
@given(st.sampled_from(MANIFOLDS), st.integers(3, 40), st.floats(1e-12, 1e3),
       st.sampled_from([0.001, 0.049, 0.05, 1.0, 60.0]), st.integers(0, 2),
       st.sampled_from(['output', 'forcing']), st.one_of(st.just('auto'), st.integers(-1, 40)),
       st.sampled_from([None, 'rest', 'moving']), st.sampled_from(['parallel', 'published']))
def test_learning(manifold, samples, size, duration, more, fit, count, end, connection):
    size = min(size, 2.0) if not manifold.factors[0].is_flat else size

    def learn():
        takes = [shown(manifold, samples, size, 1, duration)]
        takes += [shown(manifold, samples + k, 1.1 * size, 1, 1.2 * duration) for k in range(more)]
        return Skill.learn(takes, count, fit=fit, end=end, connection=connection)
    skill = tried(learn)
    if skill is not None:
        assert np.isfinite(skill.weights).all() and np.isfinite(skill.velocity).all()
        assert np.isfinite(Rollout(skill).advance(1.5 * skill.duration).point).all()


@pytest.mark.long
@pytest.mark.parametrize('fit', ['output', 'forcing'])
def test_a_motion_of_hours(fit):
    skill = Skill.learn(shown(TOOL, 40, duration=1e4), 20, fit=fit)
    assert np.isfinite(Rollout(skill, duration=10.0).advance(15.0).point).all()


@QUICK
@given(st.sampled_from(MANIFOLDS))
def test_a_demonstration_that_does_not_move(manifold):
    point = manifold.random_point(np.random.default_rng(5))
    still = Demonstration(np.linspace(0.0, 1.0, 50), np.array([point] * 50), manifold)
    for fit in ('output', 'forcing'):
        for takes in (still, [still, still]):
            for count in ('auto',):
                skill = tried(lambda: Skill.learn(takes, count, fit=fit))  # noqa: B023
                state = Rollout(skill).advance(1.2)
                assert manifold.distance(state.point, manifold.align(point, state.point)) < 1e-6


@QUICK
@given(SKILLS, ANYTHING, ANYTHING, ANYTHING, ANYTHING)
def test_options_of_a_rollout(skill, duration, speed, speed_rate, tolerance):
    rollout = tried(lambda: Rollout(skill, duration=duration, speed=speed, speed_rate=speed_rate,
                                    tolerances=None if tolerance is None else [tolerance]))
    if rollout is not None:
        assert np.isfinite(rollout.advance(0.1).point).all()


@QUICK
@given(SKILLS, st.lists(NUMBERS, min_size=1, max_size=8))
def test_times_that_pass(skill, steps):
    rollout = Rollout(skill)
    for dt in steps:
        before = rollout.memory.copy()
        if tried(lambda: rollout.advance(dt)) is None:  # noqa: B023
            np.testing.assert_array_equal(rollout.memory, before)
        assert np.isfinite(rollout.state.numbers).all()


@QUICK
@given(SKILLS, NUMBERS, NUMBERS, st.integers(0, 7))
def test_goals_and_their_velocities(skill, number, speed, size):
    rollout = Rollout(skill)
    rollout.advance(0.3)
    goal = skill.goal + np.where(np.arange(skill.goal.size).reshape(skill.goal.shape) == size,
                                 number, 0.0)
    velocity = np.full(skill.manifold.tangent_size, speed)
    with np.errstate(all='ignore'):
        tried(lambda: rollout.retarget(goal))
        tried(lambda: rollout.retarget(skill.goal, velocity))
        tried(lambda: rollout.retarget(skill.goal, np.full(size, speed)))
        state = rollout.advance(0.5)
    assert 'held' in rollout.flags or np.isfinite(state.numbers).all()


@pytest.mark.parametrize('manifold, connection', KINDS)
def test_an_hour_at_rest_costs_no_hour(manifold, connection):
    skill = learned(manifold, connection)
    state = Rollout(skill).advance(60.0)
    assert skill.manifold.distance(state.point, skill.goal) < 1e-6
