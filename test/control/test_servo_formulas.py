"""Kernels of an arm that takes positions against their formulas, at random numbers."""
import math

import numpy as np
import pytest

from gdmp_ros.control import memory, servo
from gdmp_ros.control.admittance import AdmittanceSettings, advance, external_wrench
from gdmp_ros.control.kinematics import place_links
from gdmp_ros.control.weight import GRAVITY
from gdmp_ros.kernels import records_at
from gdmp_ros.manifolds.poses import compose
from gdmp_ros.sim import Arm
from test.control.formulas import DRAWS, pose_of

CYCLE = 2e-3


@pytest.fixture(scope='module')
def arm():
    return Arm()


@pytest.fixture
def known(arm):
    """Arrays of an arm, and their scalars."""
    made = servo.servo_of(arm.chain, arm.limits, AdmittanceSettings(servo_delay=0.01), CYCLE)
    return made, records_at(made.numbers, 0, 1, servo.SCALARS)[0]


@pytest.mark.parametrize('cycles', [1, 2, 9])
def test_rows_of_cycles_that_have_passed_are_interpolated(rng, cycles):
    rows, newest = rng.normal(size=(5, 3)), rng.normal(size=3)
    before = rows.copy()
    servo.remember(rows, newest, cycles)
    np.testing.assert_allclose(rows[0], newest)
    for k in range(5):
        expected = (before[k - cycles] if k >= cycles else
                    newest + k / cycles * (before[0] - newest))
        np.testing.assert_allclose(rows[k], expected)


def test_an_arm_is_compared_with_its_command_a_delay_ago(known, rng):
    made, s = known
    for _ in range(DRAWS):
        s.delay = rng.uniform(0.0, 0.03)
        made.past[:] = rng.normal(size=made.past.shape)
        ago, share = divmod(s.delay / CYCLE, 1.0)
        then = (1.0 - share) * made.past[int(ago)] + share * made.past[int(ago) + 1]
        made.measured[0] = then
        assert servo._astray(made) == servo.FINE and s.found < 1e-9
        away = 0.02 * rng.normal(size=7)
        joint = int(rng.integers(7))
        away[joint] = rng.choice([-0.2, 0.2])
        made.measured[0] += away
        assert servo._astray(made) == servo.ASTRAY
        assert s.joint == joint and s.found == pytest.approx(0.2)
    s.delay = 2.0 * s.delay_max
    assert servo._astray(made) == servo.LATE


@pytest.mark.parametrize('delay', [0.0, 0.004, 0.0131, 0.03])
def test_the_delay_is_where_commands_and_motion_are_alike(known, delay):
    made, s = known

    def at(t):
        return 0.3 * np.sin(2.0 * math.pi * t + np.arange(7.0))
    made.past[:] = at(0.0)
    for k in range(1, 3000):
        t = k * CYCLE
        made.command[0] = at(t - CYCLE)
        made.command[1] = (at(t) - at(t - CYCLE)) / CYCLE
        made.measured[0] = at(t - delay)
        servo._estimate_delay(made)
    assert s.delay == pytest.approx(delay, abs=0.2e-3)
    before, errors = s.delay, made.errors.copy()
    # At rest nothing is learned.
    made.command[0], made.command[1] = made.past[0], 0.0
    made.measured[0] = 0.0
    for _ in range(500):
        servo._estimate_delay(made)
    assert s.delay == before
    np.testing.assert_array_equal(made.errors, errors)


def test_a_late_tick_counts_as_the_cycles_that_have_passed(known):
    made, s = known
    made.past[:] = np.arange(len(made.past))[::-1, None]
    for cycles in (1, 2, 3):
        s.dt, before = cycles * CYCLE, made.past.copy()
        made.command[0], made.command[1] = before[0], 0.0
        servo._estimate_delay(made)
        np.testing.assert_allclose(made.past[cycles:], before[:-cycles])


def test_what_was_learned_of_the_delay_is_forgotten_slowly(known, rng):
    made, s = known
    made.past[:] = rng.normal(size=made.past.shape)
    made.command[:], made.measured[0] = rng.normal(size=(2, 7)), rng.normal(size=7)
    made.errors[:] = rng.uniform(1.0, 2.0, len(made.errors))
    before = made.errors.copy()
    servo._estimate_delay(made)
    error = ((made.past - made.measured[0]) ** 2).sum(axis=1)
    np.testing.assert_allclose(
        made.errors, math.exp(-s.dt / servo.FORGETS_S) * before + s.dt * error)


def test_a_delay_that_is_longer_than_all_is_the_longest(known):
    made, s = known
    made.errors[:], made.measured[0] = np.arange(len(made.errors))[::-1], 0.0
    made.command[1] = 1e-2
    servo._estimate_delay(made)
    assert s.delay == pytest.approx(CYCLE * (len(made.errors) - 1))


def test_what_hangs_at_the_sensor_is_subtracted_with_its_inertia(known, arm, rng):
    made, s = known
    s.senses, s.mass = 1.0, 1.3
    for _ in range(DRAWS):
        made.measured[0] = arm.home + 0.3 * rng.normal(size=7)
        s.delay = rng.uniform(0.0, 0.03)
        made.ends[:] = [pose_of(rng) for _ in range(3)]
        made.bias[:], made.center[:] = rng.normal(size=6), rng.normal(size=3)
        made.felt[:] = rng.normal(size=6)
        made.twists[:] = 0.01 * rng.normal(size=made.twists.shape)
        servo.feel(made)
        links, turns = np.empty((8, 7)), np.empty((7, 3))
        place_links(made.frames, made.axes, made.measured[0], links, turns)
        places = [compose(links[7], end) for end in made.ends]
        np.testing.assert_allclose(made.pose, places[1])
        ago = int(np.clip(np.floor((s.delay - s.dt) / CYCLE + 1.5), 1, len(made.twists) - 1))
        carried = -1.3 / CYCLE * (made.twists[ago - 1] - made.twists[ago])[:3]
        carried[2] -= 1.3 * GRAVITY
        expected = np.empty(6)
        external_wrench(made.felt - made.bias, places[0], places[1], places[2],
                        made.center, carried, expected)
        np.testing.assert_allclose(made.wrench, expected, atol=1e-9)
    s.senses = 0.0
    servo.feel(made)
    assert not made.wrench.any()


def test_the_tank_pays_what_the_real_arm_gives_more_than_the_virtual_one(known, loop, rng):
    made, s = known
    numbers = loop.controller.numbers
    parts = memory.parts(numbers)
    for _ in range(DRAWS):
        parts.scalars.energy = 1.0
        made.wrench[:], made.virtual[1], made.measured[1] = (
            rng.normal(size=6), rng.normal(size=7), rng.normal(size=7))
        servo.pay(made, numbers)
        power = made.wrench @ parts.jacobian @ (made.virtual[1] - made.measured[1])
        assert parts.scalars.energy == pytest.approx(1.0 - s.dt * power)


def test_what_is_known_of_the_motion_is_sent_a_delay_earlier(known, loop, rng):
    made, s = known
    parts, n = memory.parts(loop.controller.numbers), 7
    for _ in range(DRAWS):
        made.virtual[0], made.virtual[1] = loop.arm.home, 0.0
        made.command[0], made.ahead[:] = loop.arm.home, 0.5 * rng.normal(size=n)
        made.wrench[:], s.delay = 0.0, 0.012
        before, twists = made.ahead.copy(), made.twists.copy()
        parts.rates[:] = made.ahead + 0.05 * rng.normal(size=n)
        driving = rng.normal(size=n)
        servo.answer(made, loop.controller.numbers, parts.bias + driving)
        most = servo.AHEAD_ACCELERATION * s.dt
        np.testing.assert_allclose(made.ahead,
                                   before + np.clip(parts.rates - before, -most, most))
        np.testing.assert_allclose(made.twists[0], parts.jacobian @ made.ahead)
        np.testing.assert_allclose(made.twists[1:], twists[:-1])
        wanted = np.clip(made.virtual[0] + s.delay * made.ahead, *made.bounds)
        np.testing.assert_allclose(made.command[0], wanted)
        np.testing.assert_allclose(made.command[1], (wanted - loop.arm.home) / s.dt)
        # The virtual arm is driven by the torque beyond its weight.
        position, velocity, damping = loop.arm.home.copy(), np.zeros(n), np.empty(2)
        damping[:] = s.damping * s.contact_stiffness * s.delay * np.array(
            [1.0, servo.LEVER_M ** 2])
        advance(position, velocity, parts.inertia.copy(), parts.jacobian.copy(), driving,
                np.zeros(6), parts.jacobian @ parts.rates, damping, s.dt)
        np.testing.assert_allclose(made.virtual, [position, velocity])


def test_a_virtual_arm_obeys_its_equation_of_motion(rng):
    for _ in range(DRAWS):
        dt, root, jacobian = 2e-3, rng.normal(size=(7, 7)), rng.normal(size=(6, 7))
        inertia, (torque, before) = root @ root.T + np.eye(7), rng.normal(size=(2, 7))
        wrench, twist = rng.normal(size=(2, 6))
        damping = np.diag([50.0] * 3 + [2.0] * 3)
        position, velocity = np.zeros(7), before.copy()
        advance(position, velocity, inertia, jacobian, torque, wrench, twist,
                np.array([50.0, 2.0]), dt)
        expected = np.linalg.solve(
            inertia + dt * jacobian.T @ damping @ jacobian,
            inertia @ before + dt * (torque + jacobian.T @ (wrench + damping @ twist)))
        np.testing.assert_allclose(velocity, expected, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(position, dt * velocity)
