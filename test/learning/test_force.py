"""Stiffness from forces."""
import numpy as np
import pytest

from gdmp_ros.errors import DataError, ParameterError
from gdmp_ros.learning.force_stiffness import force_stiffness, ForceRecords
from gdmp_ros.manifolds import SymmetricPositiveDefinite

MASS, DAMPING = 1.5, 20.0
TIMES = np.linspace(0.0, 4.0, 401)


def records(stiffness, rng, count=5, noise=0.0):
    """Motions of a mass that obey M a = K (x̂ - x) - D v + f exactly, for smooth random x."""
    intended = np.column_stack([np.sin(TIMES), np.cos(TIMES), 0.3 * TIMES])
    x, v, a, f = ([] for _ in range(4))
    for _ in range(count):
        position, velocity, acceleration = (np.zeros((401, 3)) for _ in range(3))
        for rate in (2.0, 3.3, 5.1):
            size, phase = 0.02 * rng.standard_normal(3), rng.uniform(0.0, 6.0, 3)
            position += size * np.sin(rate * TIMES[:, None] + phase)
            velocity += size * rate * np.cos(rate * TIMES[:, None] + phase)
            acceleration -= size * rate ** 2 * np.sin(rate * TIMES[:, None] + phase)
        position = position + intended - 0.01
        pull = np.einsum('tij,tj->ti', stiffness, intended - position)
        x.append(position)
        v.append(velocity)
        a.append(acceleration)
        f.append(MASS * acceleration - pull + DAMPING * velocity
                 + noise * rng.standard_normal((401, 3)))
    return ForceRecords(TIMES, *map(np.array, (x, v, a, f)))


def turning(rng):
    base = np.diag([250.0, 400.0, 700.0])
    result = []
    for t in TIMES:
        c, s = np.cos(0.3 * t), np.sin(0.3 * t)
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        result.append(turn @ base @ turn.T)
    return np.array(result)


def test_a_turning_stiffness_is_found_from_motion_and_force(rng):
    wanted, spd = turning(rng), SymmetricPositiveDefinite(3)
    found = force_stiffness(records(wanted, rng, noise=0.3), MASS, DAMPING)
    away = [spd.distance(np.ascontiguousarray(a), b) for a, b in zip(found, wanted)]
    assert np.mean(away) < 0.05
    assert spd.distance(wanted[0], wanted[-1]) > 0.5


def test_the_stiffness_stays_within_its_bounds(rng):
    soft = np.broadcast_to(np.diag([20.0, 300.0, 5000.0]), (401, 3, 3))
    values = np.linalg.eigvalsh(force_stiffness(records(soft, rng), MASS, DAMPING))
    assert values.min() == pytest.approx(200.0, rel=1e-6)
    assert values.max() == pytest.approx(800.0, rel=1e-6)


def test_bad_input_is_refused(rng):
    good = records(turning(rng), rng)
    with pytest.raises(DataError, match='at least 2 demonstrations'):
        ForceRecords(TIMES, *(getattr(good, n)[:1] for n in (
            'positions', 'velocities', 'accelerations', 'forces')))
    with pytest.raises(DataError, match='forces have shape'):
        ForceRecords(TIMES, good.positions, good.velocities, good.accelerations,
                     good.forces[:, :5])
    with pytest.raises(DataError, match='force sensor'):
        ForceRecords(TIMES, good.positions, good.velocities, good.accelerations,
                     np.full_like(good.forces, np.nan))
    with pytest.raises(DataError, match='do not differ'):
        ForceRecords(TIMES, *(np.repeat(getattr(good, n)[:1], 3, axis=0) for n in (
            'positions', 'velocities', 'accelerations', 'forces')))
    with pytest.raises(ParameterError, match='window'):
        force_stiffness(good, MASS, DAMPING, window=0.0)
    with pytest.raises(ParameterError, match='k_min < k_max'):
        force_stiffness(good, MASS, DAMPING, k_min=900.0)
