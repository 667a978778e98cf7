"""Reward-weighted averaging and CMA-ES."""
import numpy as np
import pytest

from gdmp_ros.errors import ParameterError
from gdmp_ros.improvement.search import (
    ELITISM,
    ranked,
    reward_weights,
    RewardWeighted,
    search_of,
    SEARCHES,
    SMALLEST,
)


def minimise(search, cost, updates, count=12, seed=0):
    for number in range(updates):
        samples = search.ask(count, np.random.default_rng([seed, number]))
        search.tell(samples, [cost(sample) for sample in samples])
    return search


@pytest.mark.parametrize('name', SEARCHES)
def test_the_mean_goes_to_the_minimum(name):
    pytest.importorskip('cma')
    goal = np.array([1.5, -1.0, 0.5, 0.0, 1.0, -0.5])
    costs = []
    for seed in range(5):
        found = minimise(search_of(name, 6), lambda x: float(np.sum((x - goal) ** 2)), 40,
                         seed=seed)
        costs.append(np.sum((found.mean - goal) ** 2))
    assert np.median(costs) < 0.02 * np.sum(goal ** 2)


@pytest.mark.parametrize('name', SEARCHES)
def test_the_same_numbers_give_the_same_samples(name):
    pytest.importorskip('cma')
    def cost(x):
        return float(np.abs(x).sum())
    first, second = (minimise(search_of(name, 4), cost, 5) for _ in range(2))
    np.testing.assert_array_equal(first.mean, second.mean)
    np.testing.assert_array_equal(first.covariance, second.covariance)


def test_the_covariance_grows_along_a_valley_and_shrinks_across():
    found = minimise(RewardWeighted(2), lambda x: float(100.0 * x[0] ** 2 - x[1]), 6, count=30)
    assert found.covariance[1, 1] > 5.0 * found.covariance[0, 0]


def test_directions_are_never_given_up():
    found = minimise(RewardWeighted(3), lambda x: float(x @ x), 300)
    assert np.linalg.eigvalsh(found.covariance).min() >= 0.999 * SMALLEST ** 2


def test_weights_are_those_of_the_source():
    weights = reward_weights(np.array([1.0, 2.0, 3.0]))
    np.testing.assert_allclose(weights / weights[0], np.exp([0.0, -0.5 * ELITISM, -ELITISM]))
    np.testing.assert_array_equal(reward_weights(np.full(4, 7.0)), np.full(4, 0.25))


def test_a_sample_that_was_ended_early_scores_worst():
    np.testing.assert_allclose(ranked([1.0, None, 3.0]), [1.0, 6.0, 3.0])
    assert ranked([2.0, None])[1] > 2.0
    assert ranked([-1.0, None, -1.0])[1] > -1.0
    assert ranked([None, None]) is None
    search = RewardWeighted(2)
    search.tell(np.ones((3, 2)), [None] * 3)
    np.testing.assert_array_equal(search.mean, 0.0)
    search.tell(np.array([[1.0, 0.0], [-1.0, 0.0]]), [1.0, None])
    assert search.mean[0] > 0.99


def test_an_unknown_search_is_refused():
    with pytest.raises(ParameterError, match='expected one of pibb, cma'):
        search_of('annealing', 2)
