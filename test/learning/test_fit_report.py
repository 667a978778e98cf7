"""The report on a fit."""
from dataclasses import replace

import numpy as np

from gdmp_ros import Demonstration, Euclidean, fit_report, Skill
from gdmp_ros.dmp.evaluation import reproduction_error
from gdmp_ros.util.profiles import minimum_jerk
from test.motions import TOOL, wave


def test_the_report_finds_the_spoiled_samples_only(rng):
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


def test_the_report_tells_the_noise_of_each_factor(rng):
    clean = wave(TOOL, rng, np.linspace(0.0, 3.0, 900))
    scale = np.repeat([1e-3, 5e-3, 2e-2], [3, 3, 6])
    noisy = Demonstration(clean.times, np.array([
        TOOL.exp(point, scale * rng.standard_normal(12)) for point in clean.points]), TOOL)
    skill = Skill.learn(noisy, fit='output')
    np.testing.assert_allclose(fit_report(skill, noisy).demonstrations[0].noise[:2], [1e-3, 5e-3],
                               rtol=0.1)
    assert max(fit_report(skill, clean).demonstrations[0].noise) < 1e-5


def test_takes_with_the_same_start_and_other_goals_are_compared_with_their_own(rng):
    """The roll-out goes to the goal of the take, although it begins where the skill does."""
    s = np.linspace(0.0, 1.0, 400)
    shown = [Demonstration(2.0 * s, np.outer(minimum_jerk(s), goal), Euclidean(2))
             for goal in ([1.0, 0.3], [1.0, -0.3])]
    skill = replace(Skill.learn(shown), start=shown[0].points[0])
    times = 2.0 * s
    for take, error, fit in zip(shown, reproduction_error(skill, shown),
                                fit_report(skill, shown).demonstrations):
        path = skill.rollout(goal=take.points[-1]).sample(times).points
        expected = np.linalg.norm(path - take.points, axis=1).mean() / np.hypot(1.0, 0.3)
        np.testing.assert_allclose([error, fit.relative_error], expected, rtol=0.01)
        assert expected < 0.1
