"""Demonstrations with noise, gaps and irregular stamps."""
import numpy as np
import pytest

from gdmp_ros import (
    DataError,
    Demonstration,
    Euclidean,
    GdmpWarning,
    Product,
    Skill,
    Sphere,
    SymmetricPositiveDefinite,
    UnitQuaternion,
)
from gdmp_ros.dmp.evaluation import reproduction_error
from test.motions import motion, TOOL, wave


@pytest.mark.parametrize('frequency, left', [(2.0, 0.5), (1.0, 16.0 / 17.0), (4.0, 1.0 / 17.0)])
def test_smoothing_has_the_effect_it_states(frequency, left):
    times = np.linspace(0.0, 20.0, 4001)
    shown = Demonstration(times, np.sin(2.0 * np.pi * frequency * times)[:, None], Euclidean(1))
    smooth = shown.smoothed(2.0).points[1000:3000, 0]
    kept = np.sqrt(2.0) * np.sqrt(np.mean(smooth ** 2))
    assert kept == pytest.approx(left, rel=0.02)
    reference = np.sin(2.0 * np.pi * frequency * times[1000:3000])
    assert smooth @ reference / np.linalg.norm(smooth) / np.linalg.norm(reference) > 0.9999


@pytest.mark.parametrize('manifold', [Sphere(2), UnitQuaternion(), SymmetricPositiveDefinite(2)],
                         ids=repr)
def test_the_curve_through_the_samples_has_a_continuous_acceleration(manifold, rng):
    # Far apart, so that the space is curved between neighbours.
    shown = wave(manifold, rng, np.linspace(0.0, 3.0, 12), size=1.5)
    np.testing.assert_allclose(shown.at(shown.times), shown.points, atol=1e-12)
    h, base = 1e-4, shown.times[1:-1]
    sides = []
    for side in (-1.0, 1.0):
        near = [shown.at(base + side * k * h) for k in range(4)]
        # One-sided, of second order.
        sides.append((2.0 * near[0] - 5.0 * near[1] + 4.0 * near[2] - near[3]) / h ** 2)
    scale = np.abs(sides[0]).max()
    np.testing.assert_allclose(sides[0], sides[1], atol=5e-3 * scale)


def test_a_skill_is_learned_despite_noise_gaps_and_irregular_stamps(rng):
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


def test_rounded_quaternions_are_normalised_and_wrong_ones_refused(rng):
    manifold = Product(Euclidean(3), UnitQuaternion())
    shown = motion(manifold, rng)
    rounded = shown.points.round(4)
    with pytest.warns(GdmpWarning, match='by up to .*e-05: they were normalised'):
        made = Demonstration(shown.times, rounded, manifold)
    np.testing.assert_allclose(np.linalg.norm(made.points[:, 3:], axis=1), 1.0, atol=1e-12)
    np.testing.assert_array_equal(made.points[:, :3], rounded[:, :3])
    with pytest.raises(DataError, match='quaternion norm is 1.01'):
        Demonstration(shown.times, np.hstack([rounded[:, :3], 1.01 * shown.points[:, 3:]]),
                      manifold)
