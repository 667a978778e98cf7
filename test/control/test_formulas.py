"""
Kernels of a tick against their formulas, written in NumPy, at random numbers.

Tests of behaviour cannot tell every sign: a lever arm, a coupling or a damping changes a motion of
the arm too little. Each kernel is tried here by itself.
"""
import math

import numpy as np
import pytest
from scipy.optimize import approx_fprime
from scipy.spatial.transform import Rotation

from gdmp_ros.control import (
    admittance,
    energy_budget,
    governor,
    impedance,
    joint_spring,
    law,
    memory,
    own_body,
    plain_tick,
    spring,
    surroundings,
    tank,
    torque_limits,
)
from gdmp_ros.control.friction import friction_torque, rest_scale
from gdmp_ros.control.limits import LIMITS
from gdmp_ros.control.memory import JOINT_SPRINGS, TOOL_SPRING
from gdmp_ros.control.settings import (
    ControllerSettings,
    ImpedanceGains,
    LIMIT_NUMBERS,
    LimitSettings,
    TANK_NUMBERS,
)
from gdmp_ros.control.target import (
    ACCELERATION,
    DAMPING_RATIO,
    STIFFNESS,
    TARGET_SIZE,
)
from gdmp_ros.manifolds import SymmetricPositiveDefinite
from gdmp_ros.scene.volume import HALF, POSE, RADIUS, TWIST, VOLUME_SIZE
from gdmp_ros.sim import Arm, ClosedLoop
from gdmp_ros.util.settings import numbers as numbers_of

DRAWS = 50


def pose_of(rng):
    """A random pose (x, y, z, qw, qx, qy, qz)."""
    turn = Rotation.random(random_state=int(rng.integers(1 << 30)))
    return np.concatenate([rng.normal(size=3), np.roll(turn.as_quat(), 1)])


def turn_of(pose):
    return Rotation.from_quat(np.roll(pose[3:], -1)).as_matrix()


def coupled(rng):
    """A stiffness with coupling of position and rotation."""
    scale = np.diag([20.0] * 3 + [5.0] * 3)
    return scale @ SymmetricPositiveDefinite(6).random_point(rng) @ scale


def within(v, limit):
    """A vector, shortened to a limit."""
    return v * min(1.0, limit / max(np.linalg.norm(v), 1e-300))


def record(dtype, **fields):
    """One record as a kernel takes it; what is not given is 0."""
    result = np.zeros(1, dtype=dtype)[0]
    for name, value in fields.items():
        result[name] = value
    return result


# Springs


def test_the_force_of_a_coupled_spring_is_linear_below_its_bounds(rng):
    for _ in range(DRAWS):
        stiffness, numbers = coupled(rng), np.empty(spring.SPRING_SIZE)
        spring.make_spring(stiffness.reshape(-1), numbers_of(ImpedanceGains()), numbers)
        error, force = 1e-4 * rng.normal(size=6), np.empty(6)
        assert spring.spring_force(numbers, error, force) == (1.0, 1.0)
        np.testing.assert_allclose(force, stiffness @ error, rtol=1e-9, atol=1e-9)
        assert spring.spring_energy(numbers, error) == pytest.approx(
            0.5 * error @ stiffness @ error)


def test_the_force_of_a_coupled_spring_is_the_gradient_of_its_energy_beyond_its_bounds(rng):
    for _ in range(DRAWS):
        stiffness, numbers = coupled(rng), np.empty(spring.SPRING_SIZE)
        spring.make_spring(stiffness.reshape(-1), numbers_of(ImpedanceGains()), numbers)
        error, force = rng.normal(size=6), np.empty(6)
        spring.spring_force(numbers, error, force)
        slope = approx_fprime(error, lambda e, n=numbers: spring.spring_energy(n, e), 1e-7)
        np.testing.assert_allclose(force, slope, rtol=1e-4, atol=1e-3)


def test_a_stiffness_that_is_shed_releases_what_is_asked(rng):
    gains = numbers_of(ImpedanceGains())
    for _ in range(DRAWS):
        stiffness, error = coupled(rng), 0.02 * rng.normal(size=6)
        numbers = np.empty(spring.SPRING_SIZE)
        spring.make_spring(stiffness.reshape(-1), gains, numbers)
        before = spring.spring_energy(numbers, error)
        softer = stiffness.reshape(-1).copy()
        released = energy_budget.soften(softer, error, gains, 0.5, 0.1 * before)
        assert released == pytest.approx(0.1 * before, rel=1e-4)
        np.testing.assert_allclose(softer / stiffness.reshape(-1), softer[0] / stiffness[0, 0])
        spring.make_spring(softer, gains, numbers)
        assert before - spring.spring_energy(numbers, error) == pytest.approx(released)


def energy_of_joint(stiffness, error):
    bent = min(error, joint_spring.CLIP)
    return stiffness * (0.5 * bent ** 2 + (error - bent) * bent)


@pytest.mark.parametrize('error', [0.01, 0.15, 0.4])
def test_the_stiffness_of_a_joint_grows_as_far_as_there_is_energy(error):
    for budget in (0.0, 0.01, 1e9):
        reference, violation = np.array([100.0]), np.zeros(len(LIMITS))
        joint_spring._change_stiffness(0, error, reference, np.array([200.0]), math.log(1.5),
                                       1e9, budget, 1e-3, violation)
        drawn = energy_of_joint(reference[0], error) - energy_of_joint(100.0, error)
        most = energy_of_joint(150.0, error) - energy_of_joint(100.0, error)
        assert drawn == pytest.approx(min(budget, most), abs=1e-12)


def test_the_stiffness_of_a_joint_falls_only_as_fast_as_the_torque_may():
    for error in (0.05, 0.5):
        reference = np.array([100.0])
        joint_spring._change_stiffness(0, error, reference, np.array([10.0]), 1e9, 1000.0, 1.0,
                                       1e-3, np.zeros(len(LIMITS)))
        fallen = (100.0 - reference[0]) * min(error, joint_spring.CLIP)
        assert fallen == pytest.approx(joint_spring.FALL_SHARE * 1000.0 * 1e-3)


# Energy


def test_the_friction_that_counts_is_that_at_the_common_speed(rng):
    for _ in range(DRAWS):
        credit, velocity, wanted = rng.uniform(size=(4, 7)), *rng.normal(size=(2, 7))
        speed = np.abs(velocity)
        common = np.where(velocity * wanted > 0.0, np.minimum(speed, np.abs(wanted)), 0.0)
        power = np.maximum((credit[0] * speed + credit[1]) * speed,
                           (credit[2] * common + credit[3]) * common).sum()
        assert tank._credited(credit, velocity, wanted) == pytest.approx(power)


def test_the_tank_pays_the_torque_that_draws_most(rng):
    numbers = record(TANK_NUMBERS, capacity=100.0, energy=10.0, passive=1.0)
    for _ in range(DRAWS):
        dt, before, after = 1e-3, *rng.normal(size=(2, 7))
        sent, credit, wanted = rng.normal(size=(3, 7)), rng.uniform(size=(4, 7)), np.zeros(7)
        scalars = record(memory.SCALARS, dt=dt, known=1.0, torques=2.0, energy=10.0,
                         potential=0.3, potential_before=0.1, stored_before=0.2)
        tank.measure_energy(scalars, numbers, sent, credit, after, before, wanted, np.zeros(7),
                            0.5)
        mean = 0.5 * (before + after)
        work = dt * max(sent[0] @ mean, sent[1] @ mean)
        lost = 0.5 * dt * sum(((credit[0] * abs(v) + credit[1]) * abs(v)).sum()
                              for v in (before, after))
        drawn = work - 0.2 + 0.5 - 0.2 - lost
        assert scalars['energy'] == pytest.approx(10.0 - drawn)


def test_what_a_torque_would_draw_is_its_power_beyond_the_weight(rng):
    numbers = record(TANK_NUMBERS, capacity=100.0, passive=1.0)
    for _ in range(DRAWS):
        velocity, torque, bias = rng.normal(size=(3, 7))
        scalars = record(memory.SCALARS, dt=1e-3, energy=1.0, coriolis=0.004)
        missing = tank.missing_energy(scalars, numbers, np.zeros((4, 7)), velocity, velocity,
                                      bias, torque, 2.0)
        may = (1.0 - tank.RESERVE) * 1e-3 / tank.SPENDING_S
        assert missing == pytest.approx(
            1e-3 * (velocity @ (torque - bias) + 2.0) + 0.004 - may)


def test_the_torques_that_may_act_are_the_last_ones():
    numbers, sent = record(TANK_NUMBERS, delay=2e-3), np.zeros((memory.MOST_TORQUES, 2))
    scalars, before = record(memory.SCALARS, dt=1e-3, potential=4.0), np.zeros((2, 2))
    for k in range(1, 6):
        tank.remember(scalars, numbers, sent, np.full(2, 10.0 * k), np.full(2, 20.0 * k),
                      before[0], before[1], np.full(2, float(k)), 0.5)
        assert sent[:3, 0].tolist() == [k, max(k - 1, 1), max(k - 2, 1)]
    assert scalars['torques'] == 3 and scalars['known'] == 1.0
    assert scalars['potential_before'] == 4.0 and scalars['stored_before'] == 0.5
    assert before.tolist() == [[50.0] * 2, [100.0] * 2]


# Friction, wrenches, torques


def test_the_help_over_friction_knows_the_stiffness_at_each_joint(rng):
    gains = ImpedanceGains(friction_at_rest=0.5)
    names = numbers_of(gains).view(impedance.GAIN_NUMBERS)[0]
    for _ in range(DRAWS):
        target, stiffness = np.zeros(TARGET_SIZE), coupled(rng)
        target[STIFFNESS:STIFFNESS + 36] = stiffness.reshape(-1)
        target[DAMPING_RATIO] = 0.8
        jacobian, rates, pull = rng.normal(size=(6, 7)), *rng.normal(size=(2, 7))
        friction, inertia = rng.uniform(0.5, 1.5, (2, 7)), np.diag(rng.uniform(0.1, 2.0, 7))
        torque = np.zeros(7)
        impedance._add_friction(target, rates, friction, names, pull, jacobian, inertia, torque)
        along = np.diag(jacobian.T @ stiffness @ jacobian) + gains.posture_stiffness
        expected = [friction_torque(friction[0, i], friction[1, i], rates[i], pull[i],
                                    gains.friction_smoothing, 0.5,
                                    rest_scale(friction[1, i], 0.5, along[i], inertia[i, i], 0.8))
                    for i in range(7)]
        np.testing.assert_allclose(torque, expected)


def test_a_measured_wrench_is_moved_to_the_tool_without_its_load(rng):
    for _ in range(DRAWS):
        sensor, tool, site = pose_of(rng), pose_of(rng), pose_of(rng)
        wrench, center, carried, external = (rng.normal(size=6), rng.normal(size=3),
                                             rng.normal(size=3), np.empty(6))
        admittance.external_wrench(wrench, sensor, tool, site, center, carried, external)
        force, moment = turn_of(sensor) @ wrench[:3], turn_of(sensor) @ wrench[3:]
        load = site[:3] + turn_of(site) @ center - tool[:3]
        np.testing.assert_allclose(external[:3], force - carried, atol=1e-12)
        np.testing.assert_allclose(
            external[3:], moment + np.cross(sensor[:3] - tool[:3], force)
            - np.cross(load, carried), atol=1e-12)


def test_a_wall_pushes_as_a_spring_that_is_damped_on_the_way_out(rng):
    settings = LimitSettings()
    low, high = np.array(settings.workspace_min), np.array(settings.workspace_max)
    for _ in range(DRAWS):
        position = rng.uniform(low - 0.004, high + 0.004)
        for axis in rng.choice(3, 2, replace=False):
            position[axis] = rng.choice([low[axis] - 0.003, high[axis] + 0.003])
        twist, jacobian, torque = rng.normal(size=6), rng.normal(size=(6, 7)), np.empty(7)
        before = rng.uniform(0.0, 0.004, 3)
        outside = before.copy()
        torque_limits.push_from_walls(position, twist, jacobian, numbers_of(settings), outside,
                                      torque)
        deep = np.maximum(np.maximum(low - position, position - high), 0.0)
        sign = np.where(position < low, 1.0, -1.0)
        np.testing.assert_allclose(outside, np.minimum(before, deep))
        acts = np.maximum(deep - before, 0.0)
        force = sign * np.minimum(torque_limits.WALL_STIFFNESS * acts, torque_limits.WALL_FORCE)
        force -= torque_limits.WALL_DAMPING * twist[:3] * ((sign * twist[:3] < 0.0) & (acts > 0.0))
        np.testing.assert_allclose(torque, jacobian[:3].T @ force, atol=1e-9)


def test_the_next_torque_begins_in_the_middle_of_those_that_are_compared(rng):
    loop = ClosedLoop(Arm(), ControllerSettings())
    arm, taken = memory.parts(loop.controller.numbers), rng.normal(size=(2, 7))
    taken[1] = taken[0] + rng.uniform(0.0, 0.1, 7)
    law.compare_with(loop.controller.numbers, taken, 1e-3)
    np.testing.assert_allclose(arm.last, taken.mean(axis=0))
    widest = (taken[1] - taken[0]).max()
    assert arm.scalars.cycle == pytest.approx(
        1e-3 - 0.5 * widest / LimitSettings().torque_slew)


@pytest.mark.parametrize('does', [TOOL_SPRING, JOINT_SPRINGS])
def test_the_state_has_a_reference_of_the_joints_only_if_they_follow_one(does):
    loop = ClosedLoop(Arm(), ControllerSettings())
    loop.tick()
    numbers = loop.controller.numbers
    memory.parts(numbers).scalars.does = does
    target, state = np.ones(TARGET_SIZE), np.zeros(99 + len(LIMITS) + 6 * 7)
    assert plain_tick.write_state(numbers, target, state) == (does == JOINT_SPRINGS)
    assert (state[55] == 1.0) == (does == TOOL_SPRING)


# The reference


def test_the_acceleration_and_its_change_are_limited_together(rng):
    for _ in range(DRAWS):
        velocity, present, last, change = (*rng.normal(size=(2, 6)), rng.normal(size=6),
                                           np.zeros(6))
        limit, jerk, dt, first = 5.0, 800.0, 1e-2, int(rng.choice([0, 3]))
        part = slice(first, first + 3)
        exceeded, jerked = governor._accelerate(velocity, present, last, first, limit, jerk, dt,
                                                change)
        asked, most = (velocity - present)[part] / dt, jerk * dt
        size = np.linalg.norm(asked)
        asked = within(asked, 0.5 * (math.sqrt(most * (most + 8.0 * size)) - most))
        assert exceeded == pytest.approx(max(np.linalg.norm(asked) - limit, 0.0))
        step = within(asked, limit) - last[part]
        assert jerked == pytest.approx(max(np.linalg.norm(step) - most, 0.0) / dt)
        np.testing.assert_allclose(change[part], last[part] + within(step, most))


def test_the_acceleration_of_a_target_counts_near_the_mean(rng):
    for _ in range(DRAWS):
        reference, target, mean = np.zeros(TARGET_SIZE), np.zeros(TARGET_SIZE), rng.normal(size=6)
        target[ACCELERATION:ACCELERATION + 6] = 3.0 * rng.normal(size=6)
        first = int(rng.choice([0, 3]))
        part, at = slice(first, first + 3), slice(ACCELERATION + first, ACCELERATION + first + 3)
        governor._feed_forward(reference, mean, target, first, 2.0, 1.5)
        expected = within(mean[part] + within(target[at] - mean[part], 1.5), 2.0)
        np.testing.assert_allclose(reference[at], expected)


def test_a_velocity_makes_way_as_far_as_it_goes_along(rng):
    for _ in range(DRAWS):
        asked, made = rng.normal(size=(2, 6))
        assert governor._progress(asked, made) == pytest.approx(asked @ made / (asked @ asked))
    assert governor._progress(np.zeros(6), made) == 1.0


def test_the_largest_part_of_a_velocity_satisfies_all_rows(rng):
    for _ in range(DRAWS):
        rates, rows, bounds = rng.normal(size=7), rng.normal(size=(9, 7)), rng.normal(size=9)
        share = governor._largest_share(rates, rows, bounds)
        speeds, most = rows @ rates, np.maximum(bounds, 0.0)
        over = speeds > most
        assert share == pytest.approx(min([1.0, *(most[over] / speeds[over])]))


def test_a_reference_without_way_is_counted_and_named_until_it_makes_way():
    s = record(memory.SCALARS, dt=1e-3, way=1.0, blocking=-1.0)
    for _ in range(400):
        governor._notice_block(s, 0.0, True, 5.0)
    assert s['blocking'] == 5.0 and 0.2 < s['blocked'] < 0.4
    governor._notice_block(s, 0.0, True, -1.0)
    assert s['blocking'] == 5.0  # the last one that is known
    for _ in range(10):
        governor._notice_block(s, 1.0, True, 5.0)
    assert s['blocking'] == -1.0 and s['blocked'] == 0.0
    s['way'] = 0.01
    governor._notice_block(s, 0.0, False, 5.0)
    assert s['way'] == 1.0 and s['blocked'] == 0.0


def test_joints_go_to_the_posture_slowly_or_all_together(rng):
    limits = numbers_of(LimitSettings()).view(LIMIT_NUMBERS)[0]
    for _ in range(DRAWS):
        position, posture, last = rng.normal(size=(3, 7))
        rates = np.empty(7)
        s = record(memory.SCALARS, dt=1e-3, returns=0.0)
        assert governor._approach_posture(s, position, posture, limits, last,
                                          rates) == governor.POSTURE_WEIGHT
        np.testing.assert_allclose(rates, np.clip(
            (posture - position) / governor.POSTURE_S, -governor.POSTURE_SPEED,
            governor.POSTURE_SPEED))
        s['returns'] = 1.0
        assert governor._approach_posture(s, position, posture, limits, last,
                                          rates) == governor.RETURN_WEIGHT
        furthest, most = np.abs(posture - position).max(), LimitSettings().joint_acceleration
        speed = min(math.sqrt(most * furthest), furthest / governor.CATCH_UP_S)
        np.testing.assert_allclose(rates, np.clip(
            speed / furthest * (posture - position), last - 1e-3 * most, last + 1e-3 * most))


def test_a_lag_is_closed_so_fast_that_it_can_stop(rng):
    for distance in (0.001, 0.02, 0.5):
        lag, before = rng.normal(size=3), rng.normal(size=3)
        lag *= distance / np.linalg.norm(lag)
        velocity = before.copy()
        governor.catch_up(lag, 2.0, 0.25, velocity)
        size = np.linalg.norm(lag)
        speed = min(size / governor.CATCH_UP_S, 0.25, math.sqrt(2.0 * 2.0 * size))
        np.testing.assert_allclose(velocity - before, speed / size * lag)


# Distances


def capsule_of(rng, radius, size):
    """A capsule of link 1, and its ends."""
    ends = rng.normal(size=3) + size * rng.normal(size=(2, 3))
    return np.array([1.0, *np.zeros(6), radius, 0.0]), ends


def test_capsules_that_are_left_out_are_far(rng):
    """Points that are beyond the distance are left out, nothing that is nearer ever is."""
    left_out = 0
    for _ in range(20 * DRAWS):
        size, radii = rng.choice([0.0, 0.3]), rng.uniform(0.0, 0.1, 2)
        (first, a), (second, b) = (capsule_of(rng, radius, size) for radius in radii)
        near, far = np.empty((2, 3))
        own_body.nearest_points(*a, *b, near, far)
        between = np.linalg.norm(far - near) - radii.sum()
        distance = between * rng.choice([0.3, 0.95, 1.05]) if between > 0.0 else 0.1
        is_far = own_body._is_far(np.array([first, second]), np.vstack([a, b]), 0, 1, distance)
        assert not (is_far and between < distance)
        if size == 0.0:
            assert is_far == (distance < between)
        left_out += is_far
    assert left_out > DRAWS


def test_volumes_that_are_left_out_are_far(rng):
    for _ in range(20 * DRAWS):
        size, radius = rng.choice([0.0, 0.3]), rng.uniform(0.0, 0.1)
        capsule, ends = capsule_of(rng, radius, size)
        volume = np.zeros(VOLUME_SIZE)
        volume[POSE:POSE + 7] = pose_of(rng)
        volume[RADIUS] = rng.uniform(0.0, 0.2)
        volume[HALF:HALF + 3] = rng.uniform(0.0, size, 3)
        way = np.empty(3)
        between = surroundings.segment_distance(volume, *ends, way)[0] - radius
        if between < 0.01:
            continue
        distance = between * rng.choice([0.3, 0.95, 1.05])
        is_far = surroundings._is_far(volume, capsule, *ends, distance)
        assert not (is_far and between < distance)
        if size == 0.0:
            assert is_far == (distance < between)


def test_a_volume_comes_nearer_by_its_twist(rng):
    for _ in range(DRAWS):
        volume, point, way = np.zeros(VOLUME_SIZE), rng.normal(size=3), rng.normal(size=3)
        volume[POSE:POSE + 7], volume[TWIST:TWIST + 6] = pose_of(rng), rng.normal(size=6)
        velocity = volume[TWIST:TWIST + 3] + np.cross(volume[TWIST + 3:TWIST + 6],
                                                      point - volume[POSE:POSE + 3])
        assert surroundings._coming(volume, point, way) == pytest.approx(
            max(way @ velocity, 0.0))
