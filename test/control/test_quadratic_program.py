"""The solver of the limits, compared with daqp."""
import daqp
import numpy as np
import pytest

from gdmp_ros.control.quadratic_program import INFEASIBLE, MOST_STEPS, solve


def problem(rng, unknowns, count, at_zero):
    """Weights as those of the governor, box and general rows, some of which bind at 0."""
    jacobian = rng.normal(size=(6, unknowns))
    weights = np.array([1.0, 1.0, 1.0, 1e-3, 1e-3, 1e-3])
    hessian = (jacobian.T * weights) @ jacobian + 1e-6 * np.eye(unknowns)
    gradient = jacobian.T @ (weights * rng.normal(size=6))
    rows = rng.normal(size=(count, unknowns))
    box = np.vstack([np.eye(unknowns), -np.eye(unknowns)])[:count]
    rows[:len(box)] = box
    bounds = np.abs(rng.normal(size=count))
    bounds[rng.permutation(count)[:at_zero]] = 0.0
    return hessian, gradient, rows, bounds


@pytest.mark.parametrize('seed', range(4))
def test_it_finds_what_another_solver_finds(seed):
    rng, most = np.random.default_rng(seed), 0
    for _ in range(300):
        unknowns, count = int(rng.integers(6, 9)), int(rng.integers(1, 41))
        given = problem(rng, unknowns, count, int(rng.integers(0, min(count, 6) + 1)))
        hessian, gradient, rows, bounds = given
        x, multipliers = np.empty(unknowns), np.empty(count)
        steps = solve(hessian, gradient, rows, bounds, x, multipliers)
        assert 0 <= steps < MOST_STEPS
        most = max(most, steps)
        # Karush, Kuhn and Tucker.
        assert (rows @ x - bounds).max() <= 1e-9 and multipliers.min() >= -1e-12
        assert np.abs(hessian @ x - gradient + rows.T @ multipliers).max() < 1e-9
        assert np.abs(multipliers * (rows @ x - bounds)).max() < 1e-8
        other, _, flag, _ = daqp.solve(hessian, -gradient, rows, bounds, np.full(count, -1e30),
                                       np.zeros(count, np.int32))
        assert flag == 1
        mine, theirs = (0.5 * at @ hessian @ at - gradient @ at for at in (x, other))
        assert mine <= theirs + 1e-6 * (1.0 + abs(theirs))
    assert most > 10


def test_without_rows_it_is_the_minimum(rng):
    hessian, gradient, _, _ = problem(rng, 7, 14, 0)
    x = np.empty(7)
    assert solve(hessian, gradient, np.empty((0, 7)), np.empty(0), x, np.empty(0)) == 0
    np.testing.assert_allclose(hessian @ x, gradient, atol=1e-9)


def test_rows_that_contradict_each_other_are_noticed():
    rows, bounds = np.array([[1.0, 0.0], [-1.0, 0.0]]), np.array([-1.0, -1.0])
    x = np.empty(2)
    assert solve(np.eye(2), np.ones(2), rows, bounds, x, np.empty(2)) == INFEASIBLE


def test_numbers_that_are_not_finite_end_it():
    x = np.empty(2)
    solve(np.eye(2), np.array([np.nan, 1.0]), np.eye(2), np.ones(2), x, np.empty(2))
    assert not np.isfinite(x).all()
