"""The fit of the motion: noise, ends, start velocities, every manifold and both connections."""
import math

import numpy as np
import pytest

from gdmp_ros import (
    Demonstration,
    Euclidean,
    GdmpWarning,
    ParameterError,
    Rollout,
    Skill,
    SymmetricPositiveDefinite,
    UnitQuaternion,
)
from gdmp_ros.data import lasa
from gdmp_ros.dmp.evaluation import deviation, mean_distance, reproduction_error
from gdmp_ros.dmp.primitive import Gains
from gdmp_ros.dmp.response import response_to, responses
from gdmp_ros.util.profiles import minimum_jerk
from test.motions import takes, TOOL, wave

DURATION = 5.0
GAINS = Gains()


def bend(times):
    """Positions of a motion of 0.37 m with a bend, at rest at both ends."""
    b = minimum_jerk(np.minimum(times / DURATION, 1.0))
    return np.column_stack([0.3 * b, 0.2 * b, 0.1 * np.sin(np.pi * b) ** 2])


def recorded(rate, noise, seed):
    """The motion with noise [m] at a rate [Hz]."""
    times = np.arange(round(DURATION * rate) + 1) / rate
    points = bend(times)
    points += noise * np.random.default_rng(seed).standard_normal(points.shape)
    return Demonstration(times, points, Euclidean(3))


def figures(skill):
    """Largest error within and after the motion, peak acceleration, start velocity."""
    times = np.arange(7001) * 1e-3
    motion = skill.rollout().sample(times)
    error = np.linalg.norm(motion.points - bend(times), axis=1)
    acceleration = np.linalg.norm(np.diff(motion.velocities, axis=0) / 1e-3, axis=1)
    within = times <= DURATION
    return np.array([error[within].max(), error[~within].max(), acceleration.max(),
                     np.linalg.norm(motion.velocities[0])])


def noisy(clean, noise, rng):
    """A demonstration with noise on its tangent spaces."""
    manifold = clean.manifold
    points = [manifold.exp(point, noise * rng.standard_normal(manifold.tangent_size))
              for point in clean.points]
    return Demonstration(clean.times, np.array(points), manifold)


@pytest.mark.parametrize('rate', [100.0, 1000.0])
@pytest.mark.parametrize('noise', [1e-5, 1e-4, 1e-3])
def test_noise_neither_moves_the_tool_nor_decides_how_it_begins(rate, noise):
    clean = figures(Skill.learn(recorded(rate, 0.0, 0), fit='output'))
    within, after, acceleration, start = np.mean(
        [figures(Skill.learn(recorded(rate, noise, seed), fit='output')) for seed in range(3)],
        axis=0)
    assert within < 2.0 * noise + 1e-4 and after < 2.0 * noise + 1e-4
    assert acceleration < (2.4 if noise < 1e-3 else {100.0: 4.5, 1000.0: 3.2}[rate]) * clean[2]
    assert start < 5e-3


def test_the_fit_of_the_forcing_term_does_not_withstand_this_noise():
    within, after, _, start = figures(Skill.learn(recorded(1000.0, 1e-4, 0), fit='forcing'))
    assert within > 5e-3 and after > 0.1 and start > 0.1


@pytest.mark.parametrize('manifold', [UnitQuaternion(), SymmetricPositiveDefinite(3), TOOL],
                         ids=repr)
def test_noise_on_curved_spaces(manifold, rng):
    clean = wave(manifold, rng, np.linspace(0.0, 5.0, 2001))
    skill = Skill.learn(noisy(clean, 1e-3, rng), fit='output')
    assert deviation(skill, clean, clean.times).max() < 2.1e-3
    after = Rollout(skill).sample(np.linspace(5.0, 7.0, 200)).points.reshape(200, -1)
    goal = np.broadcast_to(clean.flat_points[-1], after.shape).copy()
    assert manifold.factor_distances(after, goal).max() < 2.1e-3
    assert np.linalg.norm(skill.velocity) == 0.0


def test_noise_on_a_motion_that_is_split(rng):
    manifold, times = UnitQuaternion(), np.linspace(0.0, 4.0, 2001)
    vectors = [np.array([0.3 * np.sin(3.0 * b), 0.2 * b, 4.5 * b])
               for b in minimum_jerk(times / 4.0)]
    clean = Demonstration(times, np.array([manifold.exp(np.array([1.0, 0.0, 0.0, 0.0]), v)
                                           for v in vectors]), manifold)
    skill = Skill.learn(noisy(clean, 1e-3, rng), fit='output')
    assert len(skill.segments) == len(Skill.learn(clean).segments) > 1
    path = Rollout(skill).sample(times).points
    assert manifold.factor_distances(path, clean.flat_points).max() < 2.1e-3


@pytest.mark.parametrize('noise', [0.0, 1e-4])
def test_a_start_in_motion_keeps_its_velocity(noise, rng):
    times = np.linspace(0.0, 3.0, 1501)
    points = np.column_stack([0.1 * np.sin(times), 0.2 * times - 0.03 * times ** 2])
    shown = Demonstration(times, points + noise * rng.standard_normal(points.shape), Euclidean(2))
    velocity = Skill.learn(shown, fit='output', end='moving').velocity / 3.0
    assert np.linalg.norm(velocity - [0.1, 0.2]) < 0.05 * math.hypot(0.1, 0.2)


@pytest.mark.parametrize('mapping', lasa.MAPPINGS)
@pytest.mark.parametrize('name', ['Angle', 'WShape'])
def test_letters_end_as_asked(mapping, name):
    shown = lasa.riemannian(lasa.strokes(name)[0], mapping)
    assert reproduction_error(Skill.learn(shown, fit='output', end='moving'), shown)[0] < 8e-5
    skill = Skill.learn(shown, fit='output')
    assert reproduction_error(skill, shown)[0] < 1.5e-4
    after = Rollout(skill).sample(shown.duration * np.linspace(1.0, 1.6, 200)).points
    goal = np.broadcast_to(shown.flat_points[-1], (200, shown.flat_points.shape[1])).copy()
    away = shown.manifold.factor_distances(after.reshape(200, -1), goal)
    assert away.max() < 0.005 * shown.span()


@pytest.mark.parametrize('mapping', ['R2', 'S2', 'S3', 'SPD2'])
def test_the_published_connection_is_not_worse_than_with_the_forcing_term(mapping, rng):
    shown = lasa.riemannian(lasa.strokes('GShape')[0], mapping)
    clean = Skill.learn(shown, connection='published', fit='output', end='moving')
    paper = Skill.learn(shown, connection='published', fit='forcing')
    assert (reproduction_error(clean, shown)[0]
            < max(1.3 * reproduction_error(paper, shown)[0], 1e-4))
    moved = noisy(shown, 1e-3 * shown.span(), rng)
    skill = Skill.learn(moved, connection='published', fit='output', end='moving')
    assert skill.connection == 'published'
    assert reproduction_error(skill, shown)[0] < 2e-3
    paper = Skill.learn(moved, connection='published', fit='forcing')
    assert reproduction_error(skill, shown)[0] < reproduction_error(paper, shown)[0]


def test_several_demonstrations_count_alike(rng):
    """Whatever their number of samples."""
    first, second = (wave(Euclidean(2), np.random.default_rng(7), np.linspace(0.0, 3.0, count))
                     for count in (400, 4000))
    other = Demonstration(second.times, second.points + 0.1 * minimum_jerk(
        second.times / 3.0)[:, None] * (1.0 - minimum_jerk(second.times / 3.0))[:, None],
                          second.manifold)
    few = Skill.learn([first, other], fit='output')
    many = Skill.learn([second, other], fit='output')
    path = [Rollout(s).sample(np.linspace(0.0, 3.0, 300)).points for s in (few, many)]
    assert np.linalg.norm(path[0] - path[1], axis=1).max() < 1e-4


def test_auto_takes_fewer_functions_for_noisy_data_and_never_fails(rng):
    clean = wave(Euclidean(3), rng, np.linspace(0.0, 3.0, 1500), 6.0)
    counts = []
    for noise in (0.0, 1e-3, 1e-1):
        shown = noisy(clean, noise, rng)
        skill = Skill.learn(shown, n_basis='auto', tolerance=1e-6, fit='output')
        counts.append(skill.n_basis)
    assert counts[0] >= counts[1] >= counts[2]
    tool = wave(TOOL, rng, np.linspace(0.0, 3.0, 1000), 5.0)
    assert Skill.learn(noisy(tool, 1e-2, rng), n_basis='auto', fit='output').n_basis >= 10
    letter = lasa.riemannian(lasa.strokes('GShape')[0], 'S3')
    skill = Skill.learn(letter, n_basis='auto', fit='output', end='moving')
    assert reproduction_error(skill, letter)[0] < 1e-4 and 35 <= skill.n_basis <= 85


def test_responses_are_what_a_rollout_does(rng):
    count, response = 20, responses(20, GAINS)
    shown = wave(Euclidean(1), rng, np.linspace(0.0, 1.0, 400))
    skill = Skill.learn(shown, n_basis=count, fit='output')
    whole = np.linspace(0.0, 1.25, 100)
    goal, motion = response.at(whole)
    expected = (skill.start + goal[:, None] * (skill.goal - skill.start)
                + motion @ np.vstack([skill.velocity, skill.weights]))
    got = Rollout(skill, duration=1.0).sample(whole).points
    np.testing.assert_allclose(got, expected, atol=1e-6 * shown.span())


def test_the_response_to_a_step_is_critically_damped():
    response = responses(2, GAINS)
    half = 0.5 * GAINS.alpha_z * response.progress
    np.testing.assert_allclose(response_to(np.ones((len(half), 1)), GAINS)[:, 0],
                               1.0 - (1.0 + half) * np.exp(-half), atol=5e-3)


def test_more_functions_than_samples_and_a_demonstration_that_rests():
    times = np.linspace(0.0, 2.0, 300)
    shown = wave(Euclidean(2), np.random.default_rng(1), times)
    assert reproduction_error(Skill.learn(shown, n_basis=500, fit='output'), shown)[0] < 1e-3
    still = Demonstration(times, np.ones((300, 2)), Euclidean(2))
    for count in (60, 'auto'):
        path = Skill.learn(still, n_basis=count, fit='output').reproduce(0.01).points
        np.testing.assert_allclose(path, 1.0, atol=1e-12)


@pytest.mark.parametrize('settings, reason', [
    ({'fit': 'output', 'n_basis': 1}, 'n_basis is 1, expected 2 to 1000'),
    ({'fit': 'best'}, "fit is 'best', expected one of output, forcing"),
    ({'end': 'stop'}, "end is 'stop', expected one of rest, moving"),
    ({'fit': 'forcing', 'end': 'rest'}, "end='rest' needs fit='output'")])
def test_invalid_settings_are_refused(settings, reason):
    with pytest.raises(ParameterError, match=reason):
        Skill.learn(recorded(100.0, 0.0, 0), **settings)


def test_a_setting_without_a_meaning_is_ignored_with_a_warning():
    shown = recorded(100.0, 0.0, 0)
    with pytest.warns(GdmpWarning, match='regularization is for'):
        skill = Skill.learn(shown, regularization=0.1)
    np.testing.assert_array_equal(skill.weights, Skill.learn(shown).weights)


def test_mean_error_falls_with_the_rate():
    """The same noise in each sample: ten times as many samples know more."""
    errors = []
    for rate in (100.0, 1000.0):
        found = []
        for seed in range(3):
            skill = Skill.learn(recorded(rate, 1e-3, seed), fit='output')
            times = np.linspace(0.0, DURATION, 500)
            path = Rollout(skill).sample(times).points
            found.append(mean_distance(np.linalg.norm(path - bend(times), axis=1)[:, None]))
        errors.append(np.mean(found))
    assert errors[1] < 0.6 * errors[0]


def test_demonstrations_count_by_their_weights(rng):
    """Twice the weight is the same as twice the take, whatever the number of samples."""
    first, second, third = takes(TOOL, 3, rng)
    twice = Skill.learn([first, second, second, third], 30, align=False)
    weighted = Skill.learn([first, second, third], 30, align=False,
                           demonstration_weights=[1.0, 2.0, 1.0])
    dense = Demonstration(np.linspace(0.0, 2.0, 900), second.at(np.linspace(0.0, 2.0, 900)), TOOL)
    finer = Skill.learn([first, dense, third], 30, align=False, demonstration_weights=(2, 4, 2))
    times = np.linspace(0.0, 2.0, 50)
    paths = [one.rollout(duration=2.0).sample(times).points for one in (twice, weighted, finer)]
    np.testing.assert_allclose(paths[1], paths[0], atol=1e-5)
    np.testing.assert_allclose(paths[2], paths[0], atol=2e-4)
    plain = Skill.learn([first, second, third], 30, align=False)
    assert np.abs(plain.rollout(duration=2.0).sample(times).points - paths[0]).max() > 5e-3
    # One take that hardly counts changes neither the motion nor what is likely.
    alone = Skill.learn([first, second], 30, align=False)
    both = Skill.learn([first, second, third], 30, align=False,
                       demonstration_weights=[1.0, 1.0, 1e-9])
    np.testing.assert_allclose(both.goal, alone.goal, atol=1e-6)
    for weights in ([1.0, 2.0], [1.0, 0.0, 1.0], [1.0, np.nan, 1.0]):
        with pytest.raises(ParameterError, match='demonstration_weights are'):
            Skill.learn([first, second, third], demonstration_weights=weights)
    with pytest.raises(ParameterError, match='demonstration_weights need'):
        Skill.learn([first, second, third], fit='forcing', demonstration_weights=[1.0, 2.0, 1.0])
