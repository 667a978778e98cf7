"""Kernels of a stream of references against their formulas, at random numbers."""
import math

import numpy as np
import pytest

from gdmp_ros.control import stream
from gdmp_ros.control.joint_target import resting_joints
from gdmp_ros.control.target import ACCELERATION, resting_target, TWIST
from gdmp_ros.kernels import records_at
from test.control.formulas import DRAWS, HERE, PLAIN, TWIST_OF

ACCELERATION_AT = slice(ACCELERATION, ACCELERATION + 6)


def memory_of(**known):
    """Numbers of a stream, and its record; what is not given is 0."""
    numbers = np.zeros(stream._FIXED + 7)
    record = records_at(numbers, 0, 1, stream.STREAM)[0]
    for name, value in known.items():
        setattr(record, name, value)
    return numbers, record


def target_of(rng):
    """A target with a random twist and acceleration."""
    target = resting_target(HERE, PLAIN)
    target[TWIST_OF] = 0.1 * rng.normal(size=6)
    target[ACCELERATION_AT] = rng.normal(size=6)
    return target


def test_joints_move_on_with_their_velocity(rng):
    target = resting_joints(rng.normal(size=7), np.full(7, 200.0))
    target[7:14] = rng.normal(size=7)
    before = target.copy()
    stream.extrapolate_joints(target, 1e-3)
    np.testing.assert_allclose(target[:7], before[:7] + 1e-3 * before[7:14])
    np.testing.assert_array_equal(target[7:], before[7:])


def test_a_motion_has_changed_when_it_is_lost_and_when_it_has_stopped():
    def changed(state, noted, progress):
        numbers, _ = memory_of(state=state, noted=noted, stop_progress=progress)
        return stream.has_changed(numbers)
    stops, follows = stream._STOPPING, stream._FOLLOWING
    assert changed(stops, 0.0, 0.5) and changed(stops, 1.0, 1.0)
    assert not changed(stops, 1.0, 0.5) and not changed(follows, 0.0, 1.0)


def test_a_reference_is_lost_after_the_time_out_not_at_it():
    for age, lost in ((0.1, False), (0.101, True)):
        assert stream.is_lost(memory_of(age=age, timeout=0.1)[0]) == lost


def test_what_may_jump_grows_with_the_time_and_what_was_not_used_is_forgotten(rng):
    for _ in range(DRAWS):
        way, turn = rng.uniform(0.0, 0.2, 2)
        numbers, _ = memory_of(age=0.004, way=way, turn=turn, jump_position=0.05,
                               jump_rotation=0.1, fastest=1.7, fastest_turn=2.5)
        kept = math.exp(-0.004 / stream._SPARE_S)
        expected = [min(own, jump) + kept * max(own - jump, 0.0) + 0.004 * rate
                    for own, jump, rate in ((way, 0.05, 1.7), (turn, 0.1, 2.5))]
        np.testing.assert_allclose(stream.allowance(numbers), expected)


@pytest.mark.parametrize('stamped', [True, False])
def test_poses_are_compared_with_twists_over_the_time_between_their_stamps(rng, stamped):
    """Without stamps, over the time between their arrivals less the difference of their ages."""
    # An arm that has lost ticks takes 12 ms for the 20 ms of the stamps.
    for _ in range(DRAWS):
        step = 0.02 if stamped else 0.01
        stamps = (5.0, 5.0 + step) if stamped else (0.0, 0.0)
        # The second one arrives 12 ms after the first one, and is 2 ms older.
        numbers, record = memory_of(age=0.012, arrived_age=0.003, stamp=stamps[0], way=1.0,
                                    turn=1.0, jump_position=1.0, jump_rotation=1.0)
        known, twist = stream.newest(numbers), 0.2 * rng.normal(size=6)
        known.place[:], known.twist[:] = HERE, twist
        target = target_of(rng)
        target[:3] += 0.003 * rng.normal(size=3)
        stream._arrive(numbers, target, 0.005, stamps[1], False)
        apart = np.concatenate([target[:3] - HERE[:3], np.zeros(3)]) - 0.5 * step * (
            twist + target[TWIST_OF])
        np.testing.assert_allclose(known.apart, apart, atol=1e-9)
        for part in range(2):
            at = slice(3 * part, 3 * part + 3)
            speed = max(np.linalg.norm(twist[at]), np.linalg.norm(target[TWIST_OF][at]))
            allowed = stream._APART[part] + (
                stream._APART_S + stream._APART_SHARE * step) * speed
            wrong = np.linalg.norm(apart[at]) > allowed
            assert known.distrusted[part] == pytest.approx(stream.TRUSTED_S if wrong else -step)
        np.testing.assert_allclose(record.way, 1.0 - np.linalg.norm(target[:3] - HERE[:3]))
        assert record.arrived_age == 0.005 and record.stamp == stamps[1]
        np.testing.assert_array_equal(known.place, target[:7])
        np.testing.assert_array_equal(known.twist, target[TWIST_OF])


def test_a_turn_uses_up_what_may_jump():
    numbers, record = memory_of(way=1.0, turn=0.5, jump_position=1.0, jump_rotation=0.5, age=0.01)
    stream.newest(numbers).place[:] = HERE
    target = resting_target(HERE, np.eye(6))
    target[3:7] = [0.0, math.cos(0.05), math.sin(0.05), 0.0]  # turned by 0.1 rad
    stream._arrive(numbers, target, 0.0, 0.0, False)
    assert record.turn == pytest.approx(0.4) and record.way == pytest.approx(1.0)


def test_a_reference_that_is_late_is_moved_to_its_usual_time(rng):
    for late in (0.004, -0.004, 0.03):
        numbers, record = memory_of(age=0.01, delay=0.002, of_joints=0.0)
        stream.newest(numbers).place[:] = HERE
        target = target_of(rng)
        target[TWIST_OF] *= 0.1
        last = np.empty_like(target)
        stream.newest(numbers).twist[:] = target[TWIST_OF]
        stream.use(numbers, last, target, 0.002 + late, 0.0, 7.0, True)
        # The first one is usual.
        np.testing.assert_allclose(last, target)
        record.age, record.delay = 0.01, 0.002
        stream.use(numbers, last, target, 0.002 + late, 0.0, 8.0, False)
        assert record.delay == pytest.approx(0.002 + stream.DELAY_SHARE * late)
        shift = late if abs(late) < stream.LARGEST_SHIFT_S else 0.0
        expected = target.copy()
        if shift:
            stream.extrapolate(expected, shift, 0.0)
        assert (stream.newest(numbers).distrusted <= 0.0).all()
        np.testing.assert_allclose(last, expected, atol=1e-9)
        assert record.fresh == record.resumable == 1.0 and record.sequence == 8.0
        # After a gap it is usual again.
        record.age = 2.0 * stream.DELAY_GAP_S
        stream.use(numbers, last, target, 0.02, 0.0, 9.0, False)
        assert record.delay == pytest.approx(0.02)


@pytest.mark.parametrize('part', [0, 1])
def test_a_twist_that_is_not_trusted_is_not_used(rng, part):
    numbers, _ = memory_of(age=0.01)
    known, target = stream.newest(numbers), target_of(rng)
    known.place[:] = HERE
    known.distrusted[part] = 1.0
    known.twist[:] = target[TWIST_OF] = 0.0
    target[TWIST + 3 * part:TWIST + 3 * part + 3] = 1e-3
    last = np.empty_like(target)
    stream.use(numbers, last, target, 0.0, 0.0, 7.0, False)
    for first in (TWIST, ACCELERATION):
        assert not last[first + 3 * part:first + 3 * part + 3].any()
    other = ACCELERATION + 3 * (1 - part)
    np.testing.assert_array_equal(last[other:other + 3], target[other:other + 3])


def test_joints_that_jump_are_told(rng):
    numbers, _ = memory_of(of_joints=1.0, jump_joints=0.05)
    last = resting_joints(rng.normal(size=7), np.full(7, 200.0))
    for joint in range(7):
        for step, jumps in ((0.04, False), (-0.04, False), (0.06, True), (-0.06, True),
                            (math.nan, True)):
            target = last.copy()
            target[joint] += step
            assert stream._jumps(numbers, last, target) == jumps
