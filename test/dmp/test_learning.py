"""Demonstrations as they come: noise, gaps, any rate; how many functions; via points; reports."""
import numpy as np
import pytest

from gdmp_ros import (
    DataError,
    Demonstration,
    Euclidean,
    fit_report,
    ParameterError,
    Product,
    Rollout,
    Skill,
    Sphere,
    SymmetricPositiveDefinite,
    UnitQuaternion,
)
from gdmp_ros.dmp.evaluation import reproduction_error
from gdmp_ros.data import lasa
from gdmp_ros.util.profiles import minimum_jerk

TOOL = Product(Euclidean(3), UnitQuaternion(), SymmetricPositiveDefinite(3),
               names=['position', 'orientation', 'stiffness'])


def wave(manifold, rng, times, cycles=1.0, size=0.5):
    base = manifold.random_point(rng)
    first, second = manifold.random_tangent(base, rng), manifold.random_tangent(base, rng)
    first *= size / manifold.norm(base, first)
    second *= 0.4 * size / manifold.norm(base, second)
    t = (times - times[0]) / (times[-1] - times[0])
    points = [manifold.exp(base, b * first + np.sin(2.0 * np.pi * cycles * b) * second)
              for b in minimum_jerk(t)]
    return Demonstration(times, np.array(points), manifold)


@pytest.mark.parametrize('frequency, left', [(2.0, 0.5), (1.0, 16.0 / 17.0), (4.0, 1.0 / 17.0)])
def test_smoothing_has_the_effect_it_states(frequency, left):
    times = np.linspace(0.0, 20.0, 4001)
    shown = Demonstration(times, np.sin(2.0 * np.pi * frequency * times)[:, None], Euclidean(1))
    smooth = shown.smoothed(2.0).points[1000:3000, 0]
    kept = np.sqrt(2.0) * np.sqrt(np.mean(smooth ** 2))
    assert kept == pytest.approx(left, rel=0.02)
    reference = np.sin(2.0 * np.pi * frequency * times[1000:3000])
    assert smooth @ reference / np.linalg.norm(smooth) / np.linalg.norm(reference) > 0.9999


def test_noise_gaps_and_irregular_stamps_are_survived_on_the_manifold(rng):
    times = np.sort(np.concatenate([rng.uniform(0.0, 3.0, 500), [0.0, 3.0]]))
    times = times[(times < 1.2) | (times > 1.35)]  # a gap
    clean = wave(TOOL, rng, times)
    noisy = np.array([TOOL.exp(p, 2e-3 * TOOL.random_tangent(p, rng)) for p in clean.points])
    shown = Demonstration(times, noisy, TOOL)
    smooth = shown.smoothed(5.0)
    before = TOOL.factor_distances(shown.flat_points, clean.flat_points)
    after = TOOL.factor_distances(smooth.flat_points, clean.flat_points)
    assert (after.mean(axis=0) < 0.5 * before.mean(axis=0)).all()
    for point in smooth.points:
        TOOL.check_point(point)
    skill = Skill.learn(shown, smoothing=5.0, regularization=1e-3)
    assert reproduction_error(skill, clean)[0] < 0.01


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
        skill = Skill.learn(shown, n_basis='auto', tolerance=tolerance)
        assert reproduction_error(skill, shown)[0] <= 1.02 * tolerance
        fewer = Skill.learn(shown, n_basis=skill.n_basis - 1)
        assert reproduction_error(fewer, shown)[0] > tolerance


def test_a_letter_needs_about_60_and_a_long_demonstration_many_more(rng):
    letter = Skill.learn(lasa.riemannian(lasa.strokes('GShape')[0], 'R2'), n_basis='auto')
    times = np.linspace(0.0, 30.0, 3000)
    path = np.column_stack([np.sin(3.1 * times), np.cos(4.3 * times), 0.1 * times])
    long = Skill.learn(Demonstration(times, path, Euclidean(3)), n_basis='auto')
    assert 35 <= letter.n_basis <= 70 and 100 <= long.n_basis <= 300


def test_auto_says_when_the_tolerance_cannot_be_met(rng):
    shown = wave(Euclidean(2), rng, np.linspace(0.0, 3.0, 400))
    noisy = Demonstration(shown.times, shown.points + 0.05 * rng.standard_normal((400, 2)),
                          Euclidean(2))
    with pytest.raises(ParameterError, match='basis functions leave a mean error'):
        Skill.learn(noisy, n_basis='auto', tolerance=1e-6)
    with pytest.raises(ParameterError, match="or 'auto'"):
        Skill.learn(shown, n_basis='many')
    with pytest.raises(DataError, match='cutoff is -1'):
        Skill.learn(shown, smoothing=-1.0)


def test_regularisation_shrinks_the_weights_of_noisy_data(rng):
    shown = wave(Euclidean(3), rng, np.linspace(0.0, 3.0, 400))
    noisy = Demonstration(shown.times, shown.points + 1e-3 * rng.standard_normal((400, 3)),
                          Euclidean(3))
    sizes = [np.linalg.norm(Skill.learn(noisy, 100, regularization=r).weights)
             for r in (0.0, 1e-2, 1.0)]
    assert sizes[0] > 1.05 * sizes[1] > 1.05 * sizes[2]
    with pytest.raises(ParameterError, match='regularization is -1'):
        Skill.learn(shown, regularization=-1.0)


def test_the_report_finds_what_was_spoiled_and_nothing_else(rng):
    times = np.linspace(0.0, 3.0, 900)
    clean = wave(TOOL, rng, times)
    report = fit_report(Skill.learn(clean), clean)
    assert report.demonstrations[0].suspicions == () and report.segments == ()
    assert report.condition < 1e4 and len(report.demonstrations[0].mean_error) == 3
    points = clean.points.copy()
    points[300] = TOOL.exp(points[300], 0.01 * TOOL.random_tangent(points[300], rng))
    points[500] = points[499]
    keep = np.r_[0:600, 630:900]
    spoiled = Demonstration(times[keep], points[keep], TOOL)
    found = fit_report(Skill.learn(spoiled), spoiled).demonstrations[0].suspicions
    told = {s.sample: s.reason for s in found}
    assert len(told) == len(found)
    assert 'jumps' in told[300] and 'repeats' in told[500] and 'gap' in told[599]
    assert set(told) <= {300, 500, 501, 599}


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
