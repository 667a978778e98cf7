"""The guard between a stream of references and the controller."""
import numpy as np
import pytest

from gdmp_ros.control.arm_states import Request
from gdmp_ros.control.guard import ReferenceGuard
from gdmp_ros.control.modes import ArmMode, StreamMode
from gdmp_ros.control.reference_check import Origin
from gdmp_ros.control.reference_kinds import MeasuredMotion
from gdmp_ros.control.settings import GuardSettings
from gdmp_ros.control.target import resting_target, TARGET_SIZE
from gdmp_ros.errors import ParameterError

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
    for k in range(1500):
        position += speed * DT * min(k / 500, 1.0)
        guard.offer(reference((position, 0, 0.5), (speed * min(k / 500, 1.0), 0, 0)), HERE)
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
    guard.arm()
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


@pytest.mark.parametrize('age, who', [
    (3.0, 'their publisher, the network or this process was held up'),
    (-3.0, 'this process was held up and its time is behind')])
def test_a_stream_that_was_on_time_is_late_because_somebody_was_held_up(guard, age, who):
    """Clocks that agreed are not blamed; those of another stream may differ."""
    assert guard.offer(reference(), Origin('base', 0.001, 7))
    assert not guard.offer(reference(), Origin('base', age, 8))
    assert guard.last_refusal.endswith(f'the stream was on time before: {who}')
    assert not guard.offer(reference(), Origin('base', age, 1_000_000))
    assert 'the clocks of the machines differ' in guard.last_refusal


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
])
def test_a_stream_that_is_followed_must_not_jump(guard, small, large, reason):
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


# Arming: the arm begins to follow only a motion that begins near the robot, or after `arm`.

def wait(guard, seconds):
    for _ in range(round(seconds / DT)):
        guard.target(DT, MeasuredMotion(HOME, np.zeros(6)))


def stream(guard, start, seconds=0.3, mode=StreamMode.STREAMING, first=1000):
    """Offer a stream that rests at a position; whether its last reference was followed."""
    for k in range(round(seconds / DT)):
        taken = guard.offer(reference(start), Origin('base', 0.0, first + k, mode))
        guard.target(DT, MeasuredMotion(HOME, np.zeros(6)))
    return taken


NEAR, FAR = (0.315, 0.0, 0.5), (0.325, 0.0, 0.5)


@pytest.mark.parametrize('begin, reason', [
    (reference(FAR), 'begins 0.025 m from the robot'),
    (turned(0.12), 'begins 0.12 rad from the robot'),
    (reference(NEAR, (0.06, 0, 0)), 'differs by 0.06 m/s from the velocity'),
    (reference(NEAR), ''), (turned(0.08), ''), (reference(NEAR, (0.04, 0, 0)), ''),
    (stiffer(10.0), ''),
])
def test_a_motion_is_followed_if_it_begins_near_the_robot(guard, begin, reason):
    assert guard.offer(begin.copy(), HERE) == (not reason)
    assert guard.following == (not reason) and reason in guard.last_refusal


def test_a_stream_that_began_elsewhere_is_not_followed_when_it_comes_near(guard):
    assert not stream(guard, FAR) and not stream(guard, NEAR, first=1300)
    assert 'call ~/arm' in guard.last_refusal and guard.refused == 600
    # It begins anew: after a pause that is too long, from another publisher, or after it held.
    wait(guard, 1.1)
    assert stream(guard, NEAR, first=1600)
    guard.stop()
    assert not stream(guard, NEAR, first=1900)
    assert stream(guard, NEAR, first=77)
    guard.stop()
    assert not stream(guard, NEAR, first=377)
    stream(guard, NEAR, mode=StreamMode.HOLDING, first=677)
    assert stream(guard, NEAR, first=977)


@pytest.mark.parametrize('position, gap, followed', [
    ((0.37, 0.0, 0.5), 0.2, True), ((0.37, 0.0, 0.5), 0.0, False), ((0.9, 0.0, 0.5), 0.2, False)])
def test_the_first_references_of_a_motion_may_be_lost(guard, position, gap, followed):
    """The stream rested near the robot, and moves at 0.3 m/s when the next reference arrives."""
    stream(guard, NEAR, mode=StreamMode.HOLDING)
    wait(guard, gap)
    taken = guard.offer(reference(position, (0.3, 0, 0)), Origin('base', 0.0, 1500))
    assert taken == followed, guard.last_refusal


def test_a_stream_that_holds_is_followed_on_but_arms_nothing(guard):
    assert not stream(guard, NEAR, mode=StreamMode.HOLDING)
    assert not guard.following and guard.refused == 0
    guard.arm()
    assert not stream(guard, NEAR, mode=StreamMode.HOLDING, first=2000)
    assert stream(guard, NEAR, first=3000)
    assert stream(guard, NEAR, mode=StreamMode.HOLDING, first=3300)
    stream(guard, NEAR, 0.001, StreamMode.ENDED, first=3600)
    assert not guard.following and guard.reason == ''
    assert not stream(guard, NEAR, mode=StreamMode.HOLDING, first=3601)


def test_after_a_short_gap_the_same_motion_goes_on_and_after_a_long_one_it_does_not(guard):
    assert stream(guard, NEAR)
    wait(guard, 0.9)
    assert not guard.following and guard.reason == 'no reference for 0.1 s'
    assert stream(guard, (0.34, 0, 0.5), first=2200) and guard.reason == ''
    wait(guard, 1.1)
    assert not stream(guard, (0.35, 0, 0.5), first=3600)
    assert 'begins 0.05 m from the robot' in guard.last_refusal


def test_after_a_jump_nothing_is_followed_without_arming(guard):
    assert stream(guard, NEAR)
    assert not stream(guard, (0.8, 0, 0.5), 5.0, first=1300)
    assert guard.mode is ArmMode.HOLD and guard.refused == 5000
    np.testing.assert_array_equal(guard.target(DT)[:3], NEAR)
    guard.arm()
    assert stream(guard, (0.8, 0, 0.5), first=6300)


def test_arming_is_for_ten_seconds_and_for_one_motion(guard):
    guard.arm()
    wait(guard, 10.1)
    assert not stream(guard, FAR)
    guard.arm()
    assert stream(guard, FAR, first=1300)
    guard.stop()
    assert not stream(guard, FAR, first=1600)


def test_a_fault_stays_until_it_is_ended_and_then_a_motion_must_begin_anew(guard):
    guard.fault('a sensor is broken')
    with pytest.raises(ParameterError, match='a sensor is broken'):
        guard.arm()
    assert not stream(guard, NEAR) and guard.mode is ArmMode.FAULT
    assert 'a sensor is broken): call ~/recover' in guard.last_refusal
    guard.states.take(Request.RECOVER)
    assert guard.mode is ArmMode.HOLD and not stream(guard, NEAR, first=1300)
    assert stream(guard, NEAR, first=7)


def test_an_arm_that_gives_way_holds_when_it_is_stopped_or_armed(guard):
    stream(guard, NEAR)
    for leave, first in ((guard.stop, 1300), (guard.arm, 1600)):
        guard.states.take(Request.COMPLY, 'it was touched')
        assert not stream(guard, NEAR, first=first) and guard.mode is ArmMode.COMPLIANT
        leave()
        assert guard.mode is ArmMode.HOLD


def test_a_motion_that_is_streamed_while_a_hand_guides_is_not_followed_afterwards(guard):
    guard.states.take(Request.GUIDE)
    for k in range(300):
        assert not guard.offer(reference(NEAR), Origin('base', 0.0, 1000 + k))
        guard.measure(DT, MeasuredMotion(HOME, np.zeros(6)))
    guard.states.take(Request.RELEASE)
    assert not stream(guard, NEAR, first=1300)
    assert guard.mode is ArmMode.HOLD and 'before the arm was ready' in guard.last_refusal


def test_references_that_are_delayed_irregularly_give_a_smooth_motion(guard):
    """They arrive 0 to 4 ms late, as from a busy machine."""
    rng, shown = np.random.default_rng(0), []

    def at(t):
        target = resting_target(HOME)
        target[0] = HOME[0] + 0.1 * np.sin(3.0 * t)
        target[7], target[13] = 0.3 * np.cos(3.0 * t), -0.9 * np.sin(3.0 * t)
        return target
    waiting, sent = [], 0
    guard.arm()
    for k in range(3000):
        waiting.append((1e-3 * k, 1e-3 * (k + rng.integers(0, 5))))
        for stamp, arrives in list(waiting):
            if arrives <= 1e-3 * k:
                waiting.remove((stamp, arrives))
                sent += 1
                assert guard.offer(at(stamp), Origin('base', 1e-3 * k - stamp, sent))
        shown.append(guard.target(DT)[0])
    # Steps of 0.3 mm a tick; without evening out they differ by more than 1 mm.
    assert np.abs(np.diff(shown[500:], 2)).max() < 0.2e-3


def test_a_stream_that_goes_on_is_followed_by_the_kernel(guard, monkeypatch):
    speed, sequence = 0.1, 1
    assert guard.offer(reference(velocity=(0.0, 0.0, 0.0)), Origin('base', sequence=sequence))
    # From here on nothing is decided in Python.
    monkeypatch.delattr(ReferenceGuard, '_why_not')
    for k in range(1, 200):
        guard.target(DT)
        at = 0.3 + speed * k * DT
        assert guard.offer(reference((at, 0.0, 0.5), (speed, 0.0, 0.0)),
                           Origin('base', sequence=sequence + k))
        assert guard.target(DT)[0] == pytest.approx(at, abs=1e-9)
    for far in (reference((at + 0.1, 0.0, 0.5)), reference((at, 0.0, 0.5))):
        with pytest.raises(AttributeError):  # a jump; a number that is too old
            guard.offer(far, Origin('base', sequence=sequence + (200 if far[0] > at else 50)))


def test_a_stream_that_rests_is_remembered_by_the_kernel(guard, monkeypatch):
    monkeypatch.delattr(ReferenceGuard, '_why_not')
    resting = Origin('base', mode=StreamMode.HOLDING)
    assert not guard.offer(reference(), resting) and guard.refused == 0
    monkeypatch.undo()
    assert guard.offer(reference(velocity=(0.04, 0.0, 0.0)), HERE)
