"""Stiffness from forces."""
import numpy as np
import pytest

from gdmp_ros.errors import DataError, ParameterError
from gdmp_ros.learning.stiffness import force_stiffness, ForceRecords
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
    away = [spd.distance(np.ascontiguousarray(a), b) for a, b in zip(found.matrices, wanted)]
    assert np.mean(away) < 0.05
    assert found.known.all()
    assert spd.distance(wanted[0], wanted[-1]) > 0.5


def test_the_stiffness_stays_within_its_bounds(rng):
    soft = np.broadcast_to(np.diag([20.0, 300.0, 5000.0]), (401, 3, 3))
    values = np.linalg.eigvalsh(force_stiffness(records(soft, rng), MASS, DAMPING).matrices)
    assert values.min() == pytest.approx(200.0, rel=1e-6)
    assert values.max() == pytest.approx(800.0, rel=1e-6)


def test_directions_without_excitation_are_unknown(rng):
    wanted, flat = turning(rng), np.array([1.0, 1.0, 0.0])
    shown = records(wanted, rng, noise=0.3)
    kept = [getattr(shown, name) * flat for name in ('velocities', 'accelerations', 'forces')]
    mean = shown.positions.mean(axis=0)
    still = mean + (shown.positions - mean) * flat + 1e-5 * rng.standard_normal((5, 401, 3))
    found = force_stiffness(ForceRecords(TIMES, still, *kept), MASS, DAMPING)
    assert not found.known[:, 0].any() and found.known[:, 1:].all()
    np.testing.assert_allclose(np.abs(found.directions[:, 2, 0]), 1.0, atol=1e-3)
    np.testing.assert_allclose(np.linalg.eigvalsh(found.matrices)[:, 0], 200.0, rtol=1e-3)


def test_the_standard_error_is_that_of_the_stiffness(rng):
    wanted = np.broadcast_to(np.diag([300.0, 400.0, 600.0]), (401, 3, 3))
    draws = [force_stiffness(records(wanted, rng, count=9, noise=3.0), MASS, DAMPING,
                             smoothing=1e3) for _ in range(30)]
    # Along a coordinate; the window in the middle of the motion.
    stated, away = [], []
    for found in draws:
        along = found.directions[200]
        error = along.T @ (found.matrices[200] - wanted[200]) @ along
        stated.append(found.errors[200])
        away.append(np.linalg.norm(error, axis=0))
    ratio = np.sqrt(np.mean(np.square(away), axis=0) / np.mean(np.square(stated), axis=0))
    assert (ratio > 0.6).all() and (ratio < 1.4).all()


def test_noise_of_the_positions_does_not_make_it_softer(rng):
    wanted = np.broadcast_to(np.diag([300.0, 400.0, 600.0]), (401, 3, 3))
    shown = records(wanted, rng)
    noisy = ForceRecords(TIMES, shown.positions + 5e-3 * rng.standard_normal((5, 401, 3)),
                         shown.velocities, shown.accelerations, shown.forces)
    corrected, plain = (force_stiffness(noisy, MASS, DAMPING, position_noise=noise).matrices
                        for noise in (None, 0.0))
    bias = [np.mean(np.diagonal(found, axis1=1, axis2=2) / np.diagonal(wanted[0])) - 1.0
            for found in (corrected, plain)]
    assert bias[1] < -0.03 and abs(bias[0]) < 0.3 * abs(bias[1])
    with pytest.raises(ParameterError, match='position_noise'):
        force_stiffness(noisy, MASS, DAMPING, position_noise=-1.0)


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
