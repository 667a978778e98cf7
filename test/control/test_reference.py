"""The guard between a stream of references and the controller."""
import numpy as np
import pytest

from gdmp_ros.control.impedance import TARGET_SIZE
from gdmp_ros.control.reference import GuardSettings, ReferenceGuard

HOME = np.array([0.3, 0.0, 0.5, 0.0, 1.0, 0.0, 0.0])
STIFFNESS = np.diag([400.0, 400, 400, 30, 30, 30])
DT = 1e-3


def reference(position=(0.3, 0.0, 0.5), velocity=(0.0, 0.0, 0.0)):
    numbers = np.zeros(TARGET_SIZE)
    numbers[:3], numbers[3:7], numbers[7:10] = position, HOME[3:], velocity
    numbers[19:55], numbers[55] = STIFFNESS.reshape(-1), 0.7
    return numbers


@pytest.fixture
def guard():
    return ReferenceGuard(GuardSettings(frame='base'), HOME, STIFFNESS, 0.7)


def spoil(change):
    numbers = reference((0.4, 0.0, 0.5))
    change(numbers)
    return numbers


@pytest.mark.parametrize('numbers, frame, reason', [
    (reference(), 'world', "frame is 'world', expected 'base'"),
    (spoil(lambda n: n.__setitem__(1, np.nan)), 'base', 'NaN or infinite'),
    (spoil(lambda n: n.__setitem__(8, np.inf)), 'base', 'NaN or infinite'),
    (spoil(lambda n: n.__setitem__(4, 0.9)), 'base', 'quaternion norm is 0.9'),
    (spoil(lambda n: n.__setitem__(19, -5.0)), 'base', 'not positive definite'),
    (spoil(lambda n: n.__setitem__(20, 50.0)), 'base', 'not symmetric'),
    (spoil(lambda n: n.__setitem__(55, -1.0)), 'base', 'damping ratio'),
])
def test_bad_references_are_refused_and_counted_and_the_last_good_one_held(guard, numbers, frame,
                                                                           reason):
    for _ in range(2000):  # until the fade is over
        assert guard.offer(reference(), 'base')
        guard.target(DT)
    before = guard.target(DT).copy()
    assert not guard.offer(numbers, frame)
    assert guard.refused == 1 and reason in guard.last_refusal
    np.testing.assert_array_equal(guard.target(DT), before)


def test_without_references_the_motion_stops_smoothly_and_holds(guard):
    speed, position = 0.2, 0.3
    for _ in range(1500):
        position += speed * DT
        guard.offer(reference((position, 0, 0.5), (speed, 0, 0)), 'base')
        last = guard.target(DT).copy()
    path = np.array([guard.target(DT)[0] for _ in range(4000)])
    velocity = np.diff(np.concatenate([[last[0]], path])) / DT
    # Held still while it may just be late, then on at the last speed, fading.
    assert np.abs(velocity[:99]).max() < 1e-9
    assert velocity[105] == pytest.approx(speed, rel=0.1)
    assert (np.diff(velocity[105:]) <= 1e-9).all()
    assert velocity[-1] == 0.0 and not guard.following
    assert np.all(guard.target(DT)[7:19] == 0.0)


def test_a_stream_that_returns_elsewhere_is_joined_without_a_step(guard):
    moved = reference((0.33, 0.02, 0.5))
    path = []
    for _ in range(1500):
        guard.offer(moved.copy(), 'base')
        path.append(guard.target(DT)[:3].copy())
    steps = np.linalg.norm(np.diff(np.vstack([HOME[:3], path]), axis=0), axis=1)
    assert steps.max() < 0.2 * DT * 1.2
    np.testing.assert_allclose(path[-1], moved[:3], atol=1e-12)
