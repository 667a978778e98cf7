"""What a stream says of itself does not move the arm: its twists, its jumps, its silence."""
import numpy as np
import pytest

from gdmp_ros.control.guard import ReferenceGuard
from gdmp_ros.control.modes import StreamMode
from gdmp_ros.control.reference_check import Origin
from gdmp_ros.control.settings import GuardSettings
from gdmp_ros.control.target import resting_target
from gdmp_ros.util.profiles import smoothstep
from test.control.plants import CLEAN, on_every_plant

DT = 1e-3
RADIUS, RATE = 0.1, np.pi


def turned(vector):
    """A vector in a frame that is turned by 90 degrees, as one of a tool may be."""
    return np.array([-vector[1], vector[0], vector[2]])


def circle(home, k):
    """A place and a velocity on a circle of 0.1 m at 0.5 Hz, which begins slowly."""
    t = k * DT
    angle = RATE * (t * smoothstep(min(t, 1.0)) if t < 1.0 else t)
    rate = RATE
    if t < 1.0:
        rate = RATE * (smoothstep(t) + t * 6.0 * t * (1.0 - t))
    place = home.copy()
    place[:3] += RADIUS * np.array([np.cos(angle) - 1.0, np.sin(angle), 0.0])
    return place, RADIUS * rate * np.array([-np.sin(angle), np.cos(angle), 0.0])


def furthest(loop, poses, claimed, seconds):
    """Largest distance of the tool from the poses of a stream that claims a velocity [m]."""
    away, home = 0.0, loop.arm.measure().pose.copy()
    for k in range(round(seconds / DT)):
        place, velocity = poses(home, k)
        target = resting_target(place)
        # At the beginning an arm compares the velocity with its own one.
        target[7:10] = claimed(velocity) if k > 200 else velocity
        loop.controller.guard.offer(target, Origin('panda_link0', 0.0, k + 1))
        tick = loop.tick()
        away = max(away, np.linalg.norm(tick.measurement.pose[:3] - place[:3]))
    return away


def still(home, k):
    return home, np.zeros(3)


@on_every_plant
@pytest.mark.parametrize('poses, claim', [
    (still, lambda v: np.array([1.0, 0.0, 0.0])), (circle, turned), (circle, lambda v: -v),
    (circle, lambda v: 3.0 * v)], ids=['moves', 'turned', 'reversed', 'scaled'])
def test_a_wrong_twist_is_not_used(plant, poses, claim):
    without = furthest(plant.loop(), poses, np.zeros_like, 1.5)
    loop = plant.loop()
    assert furthest(loop, poses, claim, 1.5) <= without + 0.002
    guard = loop.controller.guard
    for _ in range(3):
        guard.look()
    assert guard.refused == 1 and 'twist of the references is not that' in guard.last_refusal


@on_every_plant
@pytest.mark.parametrize('axis', range(3))
def test_a_wrong_rotation_is_not_used(plant, axis):
    loop = plant.loop()
    home, guard, away = loop.arm.measure().pose.copy(), loop.controller.guard, 0.0
    for k in range(1500):
        target = resting_target(home)
        target[10 + axis] = 2.0 if k > 200 else 0.0
        guard.offer(target, Origin('panda_link0', 0.0, k + 1))
        pose = loop.tick().measurement.pose
        away = max(away, 2.0 * np.arccos(min(abs(home[3:] @ pose[3:]), 1.0)))
        guard.look()
    # What a twist may be wrong by before it is not used.
    assert away < 0.005
    assert guard.refused == 1 and 'twist of the references is not that' in guard.last_refusal


def test_a_right_twist_is_used_although_messages_come_late_and_together(rng):
    usual = furthest(CLEAN.loop(), circle, np.copy, 3.0)
    loop = CLEAN.loop()
    guard, home, away, waiting = loop.controller.guard, loop.arm.measure().pose.copy(), 0.0, []
    for k in range(3000):
        place, velocity = circle(home, k)
        target = resting_target(place)
        target[7:10] = velocity
        waiting.append((target, k))
        if rng.random() < 0.7:
            for late, at in waiting:
                guard.offer(late, Origin('panda_link0', DT * (k - at), at + 1))
            waiting.clear()
        tick = loop.tick()
        away = max(away, np.linalg.norm(tick.measurement.pose[:3] - place[:3]))
        guard.look()
    assert guard.refused == 0 and away < 1.1 * usual


@pytest.mark.parametrize('period', [0.001, 0.01, 0.05])
def test_streams_of_any_rate_may_use_their_twists(period):
    guard, home = new_guard(), HOME
    count = round(period / DT)
    for k in range(3000):
        if k % count == 0:
            place, velocity = circle(home, k)
            offer(guard, place, velocity, k // count + 1)
        guard.target(DT)
        guard.look()
    assert guard.refused == 0


HOME = np.array([0.4, 0.0, 0.5, 0.0, 1.0, 0.0, 0.0])


def new_guard(**settings):
    return ReferenceGuard(GuardSettings(**settings), HOME, 0.7)


def offer(guard, place, velocity, sequence, age=0.0, mode=StreamMode.STREAMING):
    target = resting_target(np.asarray(place))
    target[7:10] = velocity
    return guard.offer(target, Origin('panda_link0', age, sequence, mode))


def moved(distance):
    place = HOME.copy()
    place[0] += distance
    return place


@pytest.mark.parametrize('speed', [0.0, 1.0, 9.9])
def test_many_jumps_are_no_motion(speed):
    """Each of them is one that is allowed."""
    guard = new_guard()
    assert offer(guard, HOME, np.zeros(3), 1)
    guard.target(DT)
    place, reasons = 0.0, []
    for k in range(10):
        if offer(guard, moved(place + 0.049), [speed, 0.0, 0.0], k + 2):
            place += 0.049
        else:
            reasons.append(guard.last_refusal)
        guard.target(DT)
    assert place <= 0.1 and all('the position jumps by' in reason for reason in reasons)


@pytest.mark.parametrize('speed', [1.0, 9.9])
def test_what_comes_after_a_silence_claims_no_way(speed):
    guard = new_guard()
    assert offer(guard, HOME, np.zeros(3), 1)
    for _ in range(900):
        guard.target(DT)
    assert not offer(guard, moved(0.9 * speed), [speed, 0.0, 0.0], 2)
    assert 'jumps by' in guard.last_refusal


def test_a_motion_whose_beginning_was_lost_claims_little():
    guard = new_guard()
    offer(guard, moved(0.019), np.zeros(3), 1, mode=StreamMode.HOLDING)
    for _ in range(500):
        guard.target(DT)
    assert not offer(guard, moved(0.019 + 0.16), [1.0, 0.0, 0.0], 2)


def test_late_messages_that_come_together_are_followed():
    guard, speed = new_guard(), 1.5
    guard.arm()
    for k in range(100):
        assert offer(guard, moved(speed * k * DT), [speed, 0.0, 0.0], k + 1)
        guard.target(DT)
    for _ in range(90):
        guard.target(DT)
    for k in range(100, 191):
        assert offer(guard, moved(speed * k * DT), [speed, 0.0, 0.0], k + 1, DT * (190 - k)), (
            guard.last_refusal)
    assert guard.following and guard.refused == 0


def test_an_arm_that_lost_ticks_uses_the_twists_it_gets():
    """The process stood still for 20 ms, 10 times: it gets the newest reference only."""
    loop = CLEAN.loop()
    guard, home, k = loop.controller.guard, loop.arm.measure().pose.copy(), 0
    for tick in range(2500):
        k += 20 if tick > 1000 and tick % 150 == 0 else 1
        place, velocity = circle(home, k)
        target = resting_target(place)
        target[7:10] = velocity
        guard.offer(target, Origin('panda_link0', 0.0, k + 1, stamp=1e9 + k * DT))
        loop.tick()
    guard.look()
    assert guard.refused == 0 and np.linalg.norm(guard.targets[0][7:10]) > 0.2
