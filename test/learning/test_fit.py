"""Learning: sample rates, number of basis functions, regularization, several motions."""
import numpy as np
import pytest

from gdmp_ros import (
    DataError,
    Demonstration,
    Euclidean,
    GdmpWarning,
    ParameterError,
    Skill,
    Sphere,
    UnitQuaternion,
)
from gdmp_ros.data import lasa
from gdmp_ros.dmp.evaluation import reproduction_error
from test.motions import TOOL, wave


@pytest.mark.parametrize('rate', [20.0, 50.0, 997.0])
def test_any_rate_gives_the_same_motion(rate, rng):
    seed = rng.integers(1 << 30)
    times = np.linspace(0.0, 3.0, round(3.0 * rate) + 1)
    fine = wave(TOOL, np.random.default_rng(seed), np.linspace(0.0, 3.0, 6001))
    shown = wave(TOOL, np.random.default_rng(seed), times)
    assert reproduction_error(Skill.learn(shown), fine)[0] < 3e-4


@pytest.mark.parametrize('cycles', [1.0, 6.0])
def test_auto_finds_the_smallest_count_that_meets_the_tolerance(cycles, rng):
    shown = wave(UnitQuaternion(), rng, np.linspace(0.0, 3.0, 1500), cycles)
    for tolerance in (1e-3, 1e-4):
        skill = Skill.learn(shown, n_basis='auto', tolerance=tolerance, fit='forcing')
        assert reproduction_error(skill, shown)[0] <= 1.02 * tolerance
        fewer = Skill.learn(shown, n_basis=skill.n_basis - 1, fit='forcing')
        assert reproduction_error(fewer, shown)[0] > tolerance


def test_a_letter_needs_about_60_and_a_long_demonstration_many_more(rng):
    letter = Skill.learn(lasa.riemannian(lasa.strokes('GShape')[0], 'R2'), n_basis='auto')
    times = np.linspace(0.0, 30.0, 3000)
    path = np.column_stack([np.sin(3.1 * times), np.cos(4.3 * times), 0.1 * times])
    long = Skill.learn(Demonstration(times, path, Euclidean(3)), n_basis='auto')
    assert 35 <= letter.n_basis <= 70 and 100 <= long.n_basis <= 300


def test_auto_reports_a_tolerance_that_cannot_be_met(rng):
    shown = wave(Euclidean(2), rng, np.linspace(0.0, 3.0, 400))
    noisy = Demonstration(shown.times, shown.points + 0.05 * rng.standard_normal((400, 2)),
                          Euclidean(2))
    for fit in ('output', 'forcing'):
        with pytest.warns(GdmpWarning, match='basis functions are enough; .*tolerance 1e-06'):
            skill = Skill.learn(noisy, n_basis='auto', tolerance=1e-6, fit=fit)
        assert reproduction_error(skill, noisy)[0] < 0.1
    for tolerance in (0.0, 1.0, float('nan'), None):
        for fit in ('output', 'forcing'):
            with pytest.raises(ParameterError, match='tolerance is'):
                Skill.learn(shown, n_basis='auto', tolerance=tolerance, fit=fit)
    with pytest.raises(ParameterError, match="or 'auto'"):
        Skill.learn(shown, n_basis='many')
    with pytest.raises(DataError, match='cutoff is -1'):
        Skill.learn(shown, smoothing=-1.0)


def test_regularisation_shrinks_the_weights_of_noisy_data(rng):
    shown = wave(Euclidean(3), rng, np.linspace(0.0, 3.0, 400))
    noisy = Demonstration(shown.times, shown.points + 1e-3 * rng.standard_normal((400, 3)),
                          Euclidean(3))
    sizes = [np.linalg.norm(Skill.learn(noisy, 100, regularization=r, fit='forcing').weights)
             for r in (0.0, 1e-2, 1.0)]
    assert sizes[0] > 1.05 * sizes[1] > 1.05 * sizes[2]
    with pytest.raises(ParameterError, match='regularization is -1'):
        Skill.learn(shown, regularization=-1.0)


def test_several_demonstrations_keep_their_own_starts_goals_and_durations(rng):
    manifold = Sphere(2)
    seed = rng.integers(1 << 30)
    shown = []
    for i in range(4):
        d = wave(manifold, np.random.default_rng(seed), np.linspace(0.0, 2.0 + 0.3 * i, 500))
        turn = np.linalg.qr(np.eye(3) + 0.03 * rng.standard_normal((3, 3)))[0]
        turn *= np.sign(np.diag(turn))
        shown.append(Demonstration(d.times, d.points @ turn.T, manifold))
    skill = Skill.learn(shown)
    assert skill.duration == pytest.approx(np.mean([d.duration for d in shown]))
    assert reproduction_error(skill, shown).max() < 0.03
    few = Skill.learn(shown, n_basis='auto', tolerance=1e-3)
    assert few.n_basis < 60
