"""Rhythmic skills from recordings as people make them: noise, uneven tempo, ways to and fro."""
import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

from experiments.edges import grating, largest_acceleration
from gdmp_ros import (
    CutLocusError,
    DataError,
    Demonstration,
    Euclidean,
    fit_report,
    ParameterError,
    Product,
    Rollout,
    Skill,
    Sphere,
    UnitQuaternion,
)
from gdmp_ros.learning.cycles import find_cycles, find_period
from gdmp_ros.util.profiles import minimum_jerk
from test.motions import cycle, cycle_error, MANIFOLDS, motion, recorded_cycles, TOOL

PERIOD = 1.3


def _orbit_error(skill, curve):
    """Largest distance of a cycle of the roll-out from the curve, whatever the phase."""
    manifold, s = skill.manifold, np.linspace(0.0, 1.0, 120, endpoint=False)
    points = Rollout(skill).sample((1.0 + s) * skill.duration).points.reshape(len(s), -1)

    def error(shift):
        there = curve.points(s + shift)
        there = np.array([manifold.flat(manifold.align(
            a.reshape(manifold.point_shape), b.reshape(manifold.point_shape)))
            for a, b in zip(there, points)])
        return float(np.linalg.norm(manifold.factor_distances(points, there), axis=1).max())
    best = min(s, key=error)
    return min(error(best + u) for u in np.linspace(-0.01, 0.01, 41))


@pytest.mark.parametrize('manifold', MANIFOLDS, ids=str)
@pytest.mark.parametrize('sd, dt', [
    (0.01, 0.01), *(pytest.param(*one, marks=pytest.mark.long)
                    for one in ((0.001, 0.01), (0.01, 0.002)))])
def test_noise_changes_the_cycle_by_no_more_than_its_sd(manifold, sd, dt, rng):
    curve = cycle(manifold, rng)
    shown = recorded_cycles(manifold, curve, PERIOD, 8.4, dt, sd * curve.span, rng)
    skill = Skill.learn_rhythmic(shown)
    assert skill.duration == pytest.approx(PERIOD, rel=sd)
    assert _orbit_error(skill, curve) < sd * curve.span


def test_noise_brings_no_acceleration_that_is_not_in_the_cycle(rng):
    manifold = Euclidean(3)
    curve = cycle(manifold, rng, size=0.1)
    accelerations = []
    for noise in (0.0, 1e-4):
        shown = recorded_cycles(manifold, curve, PERIOD, 8.4, 0.001, noise, rng)
        rollout = Rollout(Skill.learn_rhythmic(shown))
        accelerations.append(max(np.linalg.norm(rollout.advance(0.005).acceleration)
                                 for _ in range(300)))
    assert accelerations[1] < 1.05 * accelerations[0]


def _uneven(manifold, curve, rng, spread=0.07, cycles=9, rest=1.5, dt=0.01):
    """Cycles of different durations between two rests."""
    ends = np.concatenate([[0.0], np.cumsum(
        PERIOD * (1.0 + spread * rng.standard_normal(cycles)))])
    passed = PchipInterpolator(ends, np.arange(cycles + 1))
    times = np.arange(0.0, ends[-1] + 2.0 * rest, dt)
    progress = passed(np.clip(times - rest, 0.0, ends[-1]))
    return Demonstration(times, curve.points(progress).reshape(
        len(times), *manifold.point_shape), manifold)


@pytest.mark.parametrize('seed', range(4))
def test_uneven_cycles_between_two_rests(seed):
    rng = np.random.default_rng(seed)
    manifold = Product(Euclidean(3), UnitQuaternion())
    curve = cycle(manifold, rng)
    shown = _uneven(manifold, curve, rng)
    skill = Skill.learn_rhythmic(shown)
    assert skill.duration == pytest.approx(PERIOD, rel=0.08)
    # Averaged over times instead of phases, cycles that differ by 7 % would lose their detail.
    assert _orbit_error(skill, curve) < 0.03 * curve.span


def test_the_way_to_the_first_cycle_is_left_out(rng):
    manifold = Euclidean(3)
    curve = cycle(manifold, rng, size=0.1)
    cycles = recorded_cycles(manifold, curve, PERIOD, 6.0)
    away = np.array([0.4, 0.1, 0.3])
    blend = np.linspace(1.0, 0.0, 200)[:, None] ** 2
    points = np.concatenate([curve.at(0.0) + blend * away, cycles.points,
                             cycles.points[-1] + blend[::-1] * away])
    skill = Skill.learn_rhythmic(Demonstration(0.01 * np.arange(len(points)), points, manifold))
    assert skill.duration == pytest.approx(PERIOD, rel=1e-3)
    assert _orbit_error(skill, curve) < 0.01 * curve.span


def test_several_recordings_that_begin_anywhere_in_the_cycle(rng):
    manifold = TOOL
    curve = cycle(manifold, rng)
    shown = []
    for period, begin, sd in ((1.3, 0.0, 0.003), (1.5, 0.4, 0.003), (1.1, 0.77, 0.003)):
        times = np.arange(0.0, 4.2 * period, 0.01)
        points = [manifold.exp(p, sd * manifold.random_tangent(p, rng)) for p in
                  (curve.at(begin + t / period) for t in times)]
        shown.append(Demonstration(times, np.array(points), manifold))
    skill = Skill.learn_rhythmic(shown)
    assert skill.duration == pytest.approx(1.3, rel=0.01)
    assert _orbit_error(skill, curve) < 0.01 * curve.span
    # The phase is that of the first one.
    assert cycle_error(Rollout(skill), curve).max() < 0.05 * curve.span


def test_figure_eights_and_repeated_strokes_have_their_whole_period():
    t = np.arange(0.0, 20.0, 0.01)
    for curve in (np.column_stack([np.sin(t), np.sin(2.0 * t)]),
                  np.column_stack([np.sin(t) + 0.8 * np.sin(2.0 * t), np.cos(3.0 * t)])):
        assert find_period(curve, 0.01) == pytest.approx(200.0 * np.pi, rel=1e-3)
    cycles = find_cycles(np.column_stack([np.sin(t), np.sin(2.0 * t)]), 200.0 * np.pi)
    assert (cycles.first, cycles.last) == (0, len(t) - 1)


def test_one_cycle_is_enough_with_its_period(rng):
    manifold = Sphere(2)
    curve = cycle(manifold, rng)
    shown = recorded_cycles(manifold, curve, PERIOD, 1.02)
    with pytest.raises(DataError, match='no period was found'):
        Skill.learn_rhythmic(shown)
    skill = Skill.learn_rhythmic(shown, period=PERIOD)
    assert cycle_error(Rollout(skill), curve).max() < 1e-3 * curve.span
    with pytest.raises(DataError, match='expected at least one period of 2 s'):
        Skill.learn_rhythmic(shown, period=2.0)


def test_what_does_not_repeat_has_no_period(rng):
    for shown in (motion(Euclidean(3), rng), motion(UnitQuaternion(), rng)):
        with pytest.raises(DataError, match='no period was found'):
            Skill.learn_rhythmic(shown)
    noise = Demonstration(np.arange(0.0, 10.0, 0.01), rng.standard_normal((1000, 2)), Euclidean(2))
    with pytest.raises(DataError, match='no period was found'):
        Skill.learn_rhythmic(noise)
    still = Demonstration(np.arange(0.0, 10.0, 0.01), np.zeros((1000, 2)), Euclidean(2))
    with pytest.raises(DataError, match='no period was found'):
        Skill.learn_rhythmic(still)


@pytest.mark.parametrize('before, after', [(0, 400), (0, 1000), (1000, 0)])
def test_exact_rest_beside_the_cycles(before, after):
    times = np.arange(0.0, 4.0, 0.01)
    curve = np.column_stack([np.cos(2.0 * np.pi * times), np.sin(2.0 * np.pi * times)])
    points = np.concatenate([np.repeat(curve[:1], before, axis=0), curve,
                             np.repeat(curve[-1:], after, axis=0)])
    shown = Demonstration(0.01 * np.arange(len(points)), points, Euclidean(2))
    skill = Skill.learn_rhythmic(shown, period=1.0)
    assert skill.duration == pytest.approx(1.0, rel=0.02)
    radii = np.linalg.norm(Rollout(skill).sample(np.linspace(0.0, 1.0, 50)).points, axis=1)
    np.testing.assert_allclose(radii, 1.0, atol=0.03)


def test_too_few_samples_and_no_motion_are_refused():
    still = Demonstration(np.arange(0.0, 30.0, 0.01), np.zeros((3000, 2)), Euclidean(2))
    with pytest.raises(DataError, match='does not move'):
        Skill.learn_rhythmic(still, period=1.0)
    times = np.arange(0.0, 4.0, 0.01)
    shown = Demonstration(times, np.sin(2.0 * np.pi * times)[:, None], Euclidean(1))
    with pytest.raises(DataError, match='samples in a period'):
        Skill.learn_rhythmic(shown, period=0.05)


def test_a_long_recording_at_a_high_rate(rng):
    times = np.arange(0.0, 30.0, 0.001)
    points = np.column_stack([np.cos(2.0 * np.pi * times), np.sin(2.0 * np.pi * times)])
    points += 0.01 * rng.standard_normal(points.shape)
    skill = Skill.learn_rhythmic(Demonstration(times, points, Euclidean(2)))
    assert skill.duration == pytest.approx(1.0, rel=1e-4)
    radii = np.linalg.norm(Rollout(skill).sample(np.linspace(0.0, 1.0, 50)).points, axis=1)
    np.testing.assert_allclose(radii, 1.0, atol=2e-3)


def test_a_whole_turn_is_refused():
    times = np.arange(0.0, 10.0, 0.01)
    angle = 2.0 * np.pi * times / 2.0
    turning = np.column_stack([np.cos(angle), np.sin(angle), 0.0 * angle])
    with pytest.raises((CutLocusError, DataError), match='all the way round|centre'):
        Skill.learn_rhythmic(Demonstration(times, turning, Sphere(2)))


def test_settings_out_of_range_are_refused(rng):
    shown = recorded_cycles(Euclidean(3), cycle(Euclidean(3), rng), PERIOD, 3.3)
    for settings, match in (({'period': -1.0}, 'period'), ({'n_basis': 3}, 'n_basis'),
                            ({'n_basis': 2.5}, 'n_basis'), ({'tolerance': 0.0}, 'tolerance'),
                            ({'demonstration_weights': [1.0, 2.0]}, 'demonstration_weights')):
        with pytest.raises(ParameterError, match=match):
            Skill.learn_rhythmic(shown, **settings)


def acceleration_of(skill):
    return largest_acceleration(lambda times: skill.rollout().sample(times).points,
                                2.0 * skill.duration)[0]


@pytest.mark.parametrize('uneven', [0.1, 0.3])
@pytest.mark.parametrize('walk', [0.0, 0.05, 0.2])
def test_cycles_that_differ_and_a_centre_that_walks(uneven, walk):
    """Three cycles or more that differ by up to 30 % are never refused, nor taken for one."""
    for seed in range(5):
        rng = np.random.default_rng(seed)
        cycles = int(rng.integers(3, 9))
        shown, fastest = grating(rng, cycles, int(rng.integers(20, 61)), uneven, walk)
        skill = Skill.learn_rhythmic(shown)
        fit = fit_report(skill, shown).demonstrations[0]
        assert 1.8 < fit.cycles < cycles + 1.0
        assert acceleration_of(skill) < 1.5 * fastest
        if uneven == 0.1:
            # What the centre walks in a cycle is reported.
            share = fit.closing[0] * skill.duration / (fit.duration * 0.2)
            assert abs(share - walk * np.linalg.norm([0.2, 0.9, 0.1])) < 0.1


def test_two_cycles_exactly_are_enough_and_one_is_not():
    def circle(cycles):
        times = np.linspace(0.0, 2.0 * cycles, round(120 * cycles))
        return Demonstration(times, 0.1 * np.column_stack([
            np.cos(np.pi * times), np.sin(np.pi * times)]), Euclidean(2))
    skill = Skill.learn_rhythmic(circle(2.0))
    assert skill.duration == pytest.approx(2.0, rel=1e-3)
    for cycles in (1.0, 1.3, 1.6):
        with pytest.raises(DataError, match='ecord at least two cycles'):
            Skill.learn_rhythmic(circle(cycles))


def test_noise_and_reaches_are_no_rhythm():
    for seed in range(10):
        rng, s = np.random.default_rng(seed), np.linspace(0.0, 1.0, 200)
        walk = 0.01 * np.cumsum(rng.standard_normal((300, 3)), axis=0)
        reach = (np.outer(minimum_jerk(s), rng.standard_normal(3))
                 + np.outer(np.sin(np.pi * s), 0.3 * rng.standard_normal(3))
                 + 2e-3 * rng.standard_normal((200, 3)))
        for points in (walk, rng.standard_normal((300, 3)), reach):
            with pytest.raises(DataError, match='no period was found|no rhythm was found'):
                Skill.learn_rhythmic(Demonstration(np.arange(len(points)) / 30.0, points,
                                                   Euclidean(3)))
