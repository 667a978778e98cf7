"""The guard between a stream of references and the controller."""
import numpy as np
import pytest

from gdmp_ros.control.guard import Origin, ReferenceGuard
from gdmp_ros.control.settings import GuardSettings
from gdmp_ros.control.target import TARGET_SIZE

HOME = np.array([0.3, 0.0, 0.5, 0.0, 1.0, 0.0, 0.0])
STIFFNESS = np.diag([400.0, 400, 400, 30, 30, 30])
DT = 1e-3
HERE = Origin('base')


def reference(position=(0.3, 0.0, 0.5), velocity=(0.0, 0.0, 0.0)):
    numbers = np.zeros(TARGET_SIZE)
    numbers[:3], numbers[3:7], numbers[7:10] = position, HOME[3:], velocity
    numbers[19:55], numbers[55] = STIFFNESS.reshape(-1), 0.7
    return numbers


@pytest.fixture
def guard():
    return ReferenceGuard(GuardSettings(frame='base'), HOME, 0.7)


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
    assert guard.offer(reference(), HERE)
    before = guard.target(DT).copy()
    assert not guard.offer(numbers, Origin(frame))
    assert guard.refused == 1 and reason in guard.last_refusal
    np.testing.assert_array_equal(guard.target(DT), before)


def test_without_references_the_motion_stops_smoothly_and_holds(guard):
    speed, position = 0.2, 0.3
    for _ in range(1500):
        position += speed * DT
        guard.offer(reference((position, 0, 0.5), (speed, 0, 0)), HERE)
        last = guard.target(DT).copy()
    path = np.array([guard.target(DT)[0] for _ in range(4000)])
    velocity = np.diff(np.concatenate([[last[0]], path])) / DT
    # Carried on while they may just be late, then slower and slower.
    np.testing.assert_allclose(velocity[:99], speed, atol=1e-9)
    assert np.abs(np.diff(velocity)).max() < 1.6 * speed / 0.3 * DT
    assert (np.diff(velocity) <= 1e-9).all()
    assert velocity[-1] == 0.0 and not guard.following
    assert np.all(guard.target(DT)[7:19] == 0.0)


def test_references_that_come_in_pairs_are_followed_evenly(guard):
    path = []
    for k in range(400):
        if k % 2 == 0:
            guard.offer(reference((0.3 + 0.2 * DT * k, 0, 0.5), (0.2, 0, 0)), HERE)
        path.append(guard.target(DT)[0])
    np.testing.assert_allclose(np.diff(path), 0.2 * DT, atol=1e-12)


@pytest.mark.parametrize('age, side', [(3.0, 'past'), (-0.7, 'future'), (1.7e9, 'past')])
def test_stamps_of_another_clock_are_refused(guard, age, side):
    assert not guard.offer(reference(), Origin('base', age))
    assert f's in the {side}, expected within 0.5 s' in guard.last_refusal
    assert guard.offer(reference(), Origin('base', 0.4))


def turned(angle):
    numbers = reference()
    numbers[3:7] = np.cos(angle / 2) * HOME[3:] + np.sin(angle / 2) * np.array([0.0, 0, 1, 0])
    return numbers


def stiffer(factor):
    numbers = reference()
    numbers[19:55] *= factor
    return numbers


@pytest.mark.parametrize('small, large, reason', [
    (reference((0.34, 0, 0.5)), reference((0.36, 0, 0.5)), 'position jumps by 0.06 m'),
    (turned(0.19), turned(0.21), 'rotation jumps by 0.21 rad'),
    (stiffer(2.0), stiffer(3.0), 'stiffness jumps by a factor of 3'),
    (stiffer(0.5), stiffer(0.3), 'stiffness jumps by a factor of 3.33'),
])
def test_a_stream_that_is_followed_must_not_jump(guard, small, large, reason):
    assert guard.offer(large.copy(), HERE)  # the first may be anywhere
    for _ in range(150):
        guard.target(DT)
    assert not guard.following
    assert guard.offer(reference(), HERE)
    held = guard.target(DT).copy()
    assert not guard.offer(large.copy(), HERE)
    assert reason in guard.last_refusal
    np.testing.assert_array_equal(guard.target(DT), held)
    assert guard.offer(small.copy(), HERE)


def test_a_second_publisher_is_refused_while_the_first_is_followed(guard):
    for k in range(50):
        assert guard.offer(reference(), Origin('base', 0.0, 5_000_000 + k))
        assert not guard.offer(reference(), Origin('base', 0.0, 77 + k))
        assert not guard.offer(reference(), Origin('base', 0.0, 9_000_000 + k))
        guard.target(DT)
    assert guard.refused == 100 and 'more than one publisher' in guard.last_refusal
    assert guard.offer(reference(), Origin('base', 0.0, 5_000_052))  # two were lost
    for _ in range(150):
        guard.target(DT)
    assert guard.offer(reference(), Origin('base', 0.0, 1))  # the first one is gone
