"""Stiffness from variance: bounded, stiff where demonstrations agree."""
import numpy as np
import pytest

from gdmp_ros.errors import DataError, ParameterError
from gdmp_ros.learning.stiffness import bounded_stiffness, Mixture, variance_stiffness


def fan(rng, count=7, samples=150):
    """Paths that agree at both ends and differ sideways in the middle."""
    t = np.linspace(0.0, 1.0, samples)
    return [np.column_stack([t, a * np.sin(np.pi * t), 0.02 * b * np.sin(np.pi * t)])
            for a, b in rng.standard_normal((count, 2)) * 0.1]


def test_stiffness_is_low_where_and_in_which_direction_demonstrations_differ(rng):
    profile = variance_stiffness(fan(rng), np.array([0.02, 0.5, 0.98]))
    assert profile[1, 1, 1] < 0.6 * profile[0, 1, 1]
    assert profile[1, 1, 1] < 0.6 * profile[1, 2, 2]


def test_eigenvalues_stay_within_the_bounds(rng):
    values = np.linalg.eigvalsh(variance_stiffness(fan(rng), np.linspace(0, 1, 40), 150.0, 700.0))
    assert values.min() >= 150.0 - 1e-6 and values.max() <= 700.0 + 1e-6
    assert values.max() / values.min() > 3.0


def test_a_small_range_of_precisions_gives_the_inverse_covariance():
    covariances = np.array([np.diag([1.0, 2.0]), np.diag([1.5, 1.2])])
    profile = bounded_stiffness(covariances, 100.0, 1000.0)
    ratio = np.einsum('tij,tjk->tik', profile, covariances)
    np.testing.assert_allclose(ratio, ratio[0, 0, 0] * np.tile(np.eye(2), (2, 1, 1)), atol=1e-9)


def test_regression_recovers_a_known_covariance(rng):
    shape = np.array([[0.04, 0.01], [0.01, 0.02]])
    offsets = rng.multivariate_normal(np.zeros(2), shape, 400)
    t = np.linspace(0.0, 1.0, 20)
    paths = [np.column_stack([t, 2 * t]) + offset for offset in offsets]
    found = Mixture(paths, n_components=4).covariances(np.array([0.5]))[0]
    np.testing.assert_allclose(found, shape, atol=0.008)


def test_bad_input_is_refused(rng):
    with pytest.raises(DataError, match='at least 2 demonstrations, got 1'):
        Mixture(fan(rng, count=1))
    with pytest.raises(ParameterError, match='0 < k_min < k_max'):
        bounded_stiffness(np.eye(2)[None], 500.0, 100.0)
