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
from gdmp_ros.control.kinematics import chain_state
from gdmp_ros.control.limits import (
    ENERGY,
    JOINT_POSITION,
    JOINT_SPEED,
    LIMITS,
    STIFFNESS_RATE,
    TOOL_SPEED,
)
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
    resting_target,
    STIFFNESS,
    TARGET_SIZE,
)
from gdmp_ros.control.target import (
    TWIST as TARGET_TWIST,
)
from gdmp_ros.control.weight import is_weightless
from gdmp_ros.manifolds import SymmetricPositiveDefinite
from gdmp_ros.scene.volume import HALF, MARGIN, POSE, RADIUS, THERE, TWIST, VOLUME_SIZE
from gdmp_ros.sim import Arm, ClosedLoop
from gdmp_ros.util.settings import numbers as numbers_of

DRAWS = 50
TWIST_OF = slice(TARGET_TWIST, TARGET_TWIST + 6)


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
        assert violation[ENERGY] == pytest.approx(max(most - budget, 0.0), abs=1e-12)


def test_the_stiffness_of_a_joint_falls_only_as_fast_as_the_torque_may():
    for error in (0.05, 0.5):
        reference = np.array([100.0])
        joint_spring._change_stiffness(0, error, reference, np.array([10.0]), 1e9, 1000.0, 1.0,
                                       1e-3, np.zeros(len(LIMITS)))
        fallen = (100.0 - reference[0]) * min(error, joint_spring.CLIP)
        assert fallen == pytest.approx(joint_spring.FALL_SHARE * 1000.0 * 1e-3)


def test_one_joint_goes_where_it_can_be_in_a_tick_and_else_as_fast_as_it_may():
    limits, violation = np.array([[-3.0], [3.0], [2.0], [0.0], [0.0]]), np.zeros(len(LIMITS))

    def after(goal, desired, q=0.0, v=0.5):
        return joint_spring._govern_joint(0, 1, np.array([q, v, 100.0, 1.0]),
                                          np.array([goal, desired, 100.0, 1.0]), limits, 10.0,
                                          1e-3, violation)
    assert after(0.0005, 0.505) == (0.0005, 0.505)
    assert after(1.0005, 0.505, q=1.0) == (1.0005, 0.505)
    # Its velocity would have to change by more than 10 rad/s² allow.
    assert after(0.0005, 0.6) == pytest.approx((0.51e-3, 0.51))
    assert after(1.0, 0.5) == pytest.approx((0.51e-3, 0.51))
    assert after(-1.0, 0.5) == pytest.approx((0.49e-3, 0.49))
    assert not violation.any()
    assert after(3.5, 2.5, v=2.0) == pytest.approx((2e-3, 2.0))
    assert violation[JOINT_POSITION] == pytest.approx(0.5) and violation[JOINT_SPEED] > 0.5
    violation[:] = 0.0
    after(-3.2, 0.0)
    assert violation[JOINT_POSITION] == pytest.approx(0.2)


@pytest.fixture
def loop():
    """An arm that has made a tick."""
    made = ClosedLoop(Arm(), ControllerSettings())
    made.tick()
    return made


def test_joints_that_move_away_draw_what_there_is(loop, rng):
    numbers = loop.controller.numbers
    arm, n = memory.parts(numbers), 7
    for _ in range(DRAWS):
        arm.joint_reference[:] = np.concatenate(
            [arm.position + 0.05, np.full(n, 0.3), np.full(n, 500.0), [1.0]])
        arm.joint_target[:] = arm.joint_reference
        arm.joint_target[:n] += 0.3e-3
        before = joint_spring.joint_energy(arm.position, arm.joint_reference)
        moved = arm.joint_reference.copy()
        moved[:n] += 0.3e-3
        most = joint_spring.joint_energy(arm.position, moved) - before
        budget = rng.uniform(0.0, 1.5) * most
        drawn, stored = joint_spring.move_joint_reference(numbers, 1.0, budget)
        assert drawn == pytest.approx(min(budget, most), rel=1e-3)
        after = joint_spring.joint_energy(arm.position, arm.joint_reference)
        assert stored == after and after - before == pytest.approx(drawn, abs=1e-12)
        share = (arm.joint_reference[:n] - arm.position - 0.05) / 0.3e-3
        np.testing.assert_allclose(share, min(budget / most, 1.0), rtol=2e-2)
        np.testing.assert_allclose(arm.joint_reference[n:2 * n], 0.3 * share, rtol=1e-3)
        assert arm.violation[ENERGY] == pytest.approx(max(most - budget, 0.0), rel=1e-3, abs=1e-9)
        arm.violation[:] = 0.0


def test_the_stiffness_of_joints_grows_with_what_a_motion_leaves(loop):
    numbers = loop.controller.numbers
    arm, n = memory.parts(numbers), 7
    for share in (0.5, 1.2, 2.0):
        arm.joint_reference[:] = np.concatenate(
            [arm.position + 0.05, np.full(n, 0.3), np.full(n, 500.0), [1.0]])
        arm.joint_target[:] = arm.joint_reference
        arm.joint_target[:n] += 0.3e-3
        arm.joint_target[2 * n:3 * n] = 2000.0
        moved = arm.joint_reference.copy()
        moved[:n] += 0.3e-3
        most = (joint_spring.joint_energy(arm.position, moved)
                - joint_spring.joint_energy(arm.position, arm.joint_reference))
        drawn, _ = joint_spring.move_joint_reference(numbers, 1.0, share * most)
        assert drawn == pytest.approx(share * most, rel=1e-3)


def test_a_stiffness_that_grows_uses_what_others_release():
    error, old = np.array([0.1, 0.05, 0.0, 0.0, 0.0, 0.0]), np.diag(np.full(6, 100.0))
    target, violation = np.diag([50.0, 400.0, 400.0, 100.0, 100.0, 100.0]), np.zeros(len(LIMITS))
    target = target.reshape(-1)
    missing = energy_budget._limit_modes(old.reshape(-1), target, error, math.log(2.0), 0.0,
                                         violation)
    # 0.25 J are released, an equal part for each of six modes; the second one needs 0.125 J.
    part = 0.25 / 6.0
    grown = 1.0 + min(part / 0.125, 1.0)
    np.testing.assert_allclose(np.diag(target.reshape(6, 6)),
                               [50.0, 100.0 * grown, 200.0, 100.0, 100.0, 100.0])
    assert missing == pytest.approx(max(0.125 - part, 0.0))
    assert violation[STIFFNESS_RATE] == pytest.approx(math.log(2.0))


def test_a_stiffness_grows_by_what_may_be_drawn_also_beyond_the_bounds_of_its_force(rng):
    gains, reached = numbers_of(ImpedanceGains()), 0
    for _ in range(4 * DRAWS):
        old, target = coupled(rng).reshape(-1), coupled(rng).reshape(-1)
        error, numbers, wanted = 0.3 * rng.normal(size=6), np.empty(spring.SPRING_SIZE), target
        budget = rng.uniform(0.0, 0.5)
        spring.make_spring(old, gains, numbers)
        before = spring.spring_energy(numbers, error)
        target = wanted.copy()
        drawn, missing = energy_budget._change_stiffness(old, target, error, gains, 10.0, budget,
                                                         numbers, np.zeros(len(LIMITS)))
        spring.make_spring(target, gains, numbers)
        assert spring.spring_energy(numbers, error) - before == pytest.approx(drawn, abs=1e-9)
        assert drawn <= budget + 1e-9 and missing >= 0.0
        reached += abs(drawn - budget) < 1e-4
        assert np.linalg.eigvalsh(target.reshape(6, 6)).min() > 0.0
    assert reached > 10


def test_a_reference_moves_as_far_as_there_is_energy(loop, rng):
    numbers, spring_numbers = loop.controller.numbers, np.empty(spring.SPRING_SIZE)
    arm, home, limited = memory.parts(numbers), loop.arm.home, 0
    jacobian, pose = np.empty((6, 7)), np.empty(7)
    for _ in range(DRAWS):
        arm.governed[:] = home + 0.05 * rng.normal(size=7)
        chain_state(*loop.arm.chain, arm.end, arm.governed, pose, jacobian)
        arm.reference[:7] = pose
        arm.governed_rate[:] = rng.normal(size=7)
        arm.reference[TWIST_OF] = jacobian @ arm.governed_rate
        spring.make_spring(arm.reference[STIFFNESS:STIFFNESS + 36], arm.gains, spring_numbers)
        rate, twist = arm.governed_rate.copy(), arm.reference[TWIST_OF].copy()
        before = energy_budget._energy(arm.pose, arm.reference, spring_numbers, np.empty(6))
        most = energy_budget._energy_after(numbers, arm.scalars.dt, spring_numbers, np.empty(7),
                                           np.empty(7), np.empty(6)) - before
        drawn, missing = energy_budget._move_reference(numbers, spring_numbers, 0.4 * most)
        if most > 0.0:
            limited += 1
            assert drawn == pytest.approx(0.4 * most, rel=1e-3)
            assert missing == pytest.approx(0.6 * most)
            share = arm.governed_rate[0] / rate[0]
            assert 0.0 < share < 1.0
            np.testing.assert_allclose(arm.governed_rate, share * rate)
            np.testing.assert_allclose(arm.reference[TWIST_OF], share * twist)
        chain_state(*loop.arm.chain, arm.end, arm.governed, pose, jacobian)
        np.testing.assert_allclose(arm.reference[:7], pose, atol=1e-12)
        after = energy_budget._energy(arm.pose, arm.reference, spring_numbers, np.empty(6))
        assert after - before == pytest.approx(drawn, abs=1e-9)
    assert limited > 10


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


def test_what_drives_a_tool_that_is_too_fast_is_reduced_and_it_is_braked(rng):
    largest = 0.5
    slow = max(largest - impedance.SPEED_MARGIN, 0.5 * largest)
    for _ in range(DRAWS):
        jacobian, dq, force = rng.normal(size=(6, 7)), 0.1 * rng.normal(size=7), np.empty(6)
        force[:] = 10.0 * rng.normal(size=6)
        before, velocity = force.copy(), jacobian[:3] @ dq
        excess = impedance._limit_tool_speed(jacobian, dq, largest, force)
        speed = np.linalg.norm(velocity)
        assert excess == pytest.approx(max(speed - slow, 0.0))
        if excess == 0.0:
            np.testing.assert_array_equal(force, before)
            continue
        way = velocity / speed
        along = before[:3] @ way
        left = along * max(1.0 - excess / (largest - slow), 0.0) if along > 0.0 else along
        expected = before[:3] + (left - along - impedance.TOOL_BRAKE * excess) * way
        np.testing.assert_allclose(force, [*expected, *before[3:]])


def test_a_tool_that_the_joints_move_too_fast_is_reported(loop):
    arm = memory.parts(loop.controller.numbers)
    for rate, fast in ((0.01, False), (3.0, True)):
        arm.velocity[:], arm.violation[:] = rate, 0.0
        law._springs_at_joints(loop.controller.numbers, np.zeros(7),
                               numbers_of(LimitSettings()).view(LIMIT_NUMBERS)[0])
        assert (arm.violation[TOOL_SPEED] > 0.0) == fast


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


def test_joints_are_slowed_where_the_tool_would_be_too_fast(loop, rng):
    numbers, settings = loop.controller.numbers, LimitSettings()
    arm, home = memory.parts(numbers), loop.arm.home
    jacobian, pose = np.empty((6, 7)), np.empty(7)
    fastest = min(settings.speed, governor.TOOL_SPEED_SHARE * settings.tool_speed)
    slowed = 0
    for scale in (0.01, 0.3, 2.0, 4.0) * 5:
        arm.joint_reference[:7], arm.joint_target[:7] = home, home + 1.0
        asked = scale * rng.normal(size=7)
        rates = asked.copy()
        changed = governor.keep_joints_inside(numbers, asked, rates)
        chain_state(*loop.arm.chain, arm.end, home, pose, jacobian)
        speed = np.linalg.norm(jacobian[:3] @ asked)
        share = min(1.0, fastest / speed)
        assert changed == (share < 1.0)
        np.testing.assert_allclose(rates, share * asked, atol=1e-9)
        slowed += changed
    assert 5 <= slowed < 20


def test_the_share_of_the_way_follows_smoothly():
    s = record(memory.SCALARS, dt=1e-3, permitted=1.0, allowed=0.5)
    governor.hold_back_smoothly(s)
    assert s['allowed'] == pytest.approx(0.5 + 1e-3 / governor.HELD_IN_S)
    s['permitted'] = 0.0
    for _ in range(2):
        governor.hold_back_smoothly(s)
    assert s['allowed'] == pytest.approx(0.5 - 1e-3 / governor.HELD_IN_S)


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


@pytest.mark.parametrize('axis', [0, 1, 2])
def test_a_fast_volume_has_rows_from_further_away(axis, loop):
    """From as far as it comes in the time in which an arm slows down."""
    arm, shape = loop.arm, loop.arm.shape
    chain = arm.chain
    rows, bounds, ids = (np.zeros((surroundings.MOST_ROWS, 7)),
                         *np.zeros((2, surroundings.MOST_ROWS)))
    volumes = np.zeros((1, VOLUME_SIZE))
    volume = volumes[0]
    volume[POSE + 3], volume[RADIUS], volume[MARGIN], volume[THERE] = 1.0, 0.05, 0.02, 1.0
    hand = own_body.placed(chain, shape, arm.home)[-1, :3]
    volume[POSE:POSE + 3] = hand
    volume[POSE + axis] -= 0.9

    def shared(speed):
        volume[TWIST + axis] = speed
        return surroundings.surroundings_rows(
            *chain, arm.home, shape.capsules, volumes, 0.0, 6.5, 0.5, 0.0, 0, rows, bounds, ids,
            0)
    assert shared(0.0)[:2] == (0, 1.0)
    count, share, _, _ = shared(20.0)
    assert count > 0 and share < 1.0


def test_the_end_of_a_link_that_is_the_nearest_point_has_one_row(loop):
    arm, shape = loop.arm, loop.arm.shape
    m, seen = len(shape.capsules), set()
    placed = own_body.placed(arm.chain, shape, arm.home)
    for c in range(m):
        rows, bounds, ids = (np.zeros((surroundings.MOST_ROWS, 7)),
                             *np.zeros((2, surroundings.MOST_ROWS)))
        first, second, radius = placed[c, :3], placed[c, 3:6], placed[c, 6]
        length = np.linalg.norm(second - first)
        if shape.capsules[c, 0] == 0.0 or length < 0.05:
            continue
        for t, places in ((0.0, 2), (1.0, 2), (0.5, 3)):
            volumes = np.zeros((1, VOLUME_SIZE))
            volume = volumes[0]
            way = np.cross(second - first, [0.3, 0.5, 0.8])
            way /= np.linalg.norm(way)
            volume[POSE:POSE + 3] = first + t * (second - first) + (radius + 0.1) * way
            volume[POSE + 3], volume[RADIUS], volume[THERE] = 1.0, 0.01, 1.0
            volume[MARGIN] = 0.02
            count, *_ = surroundings.surroundings_rows(
                *arm.chain, arm.home, shape.capsules[c:c + 1], volumes, 0.0, 0.5, 10.0, 0.0, 0,
                rows, bounds, ids, 0)
            assert count == places
            seen.add(t)
    assert len(seen) == 3


def test_no_weight_is_none_at_any_joint():
    for place in np.ndindex(3, 3):
        moments = np.zeros((3, 3))
        assert is_weightless(moments)
        moments[place] = 0.1
        assert not is_weightless(moments)


def test_a_volume_comes_nearer_by_its_twist(rng):
    for _ in range(DRAWS):
        volume, point, way = np.zeros(VOLUME_SIZE), rng.normal(size=3), rng.normal(size=3)
        volume[POSE:POSE + 7], volume[TWIST:TWIST + 6] = pose_of(rng), rng.normal(size=6)
        velocity = volume[TWIST:TWIST + 3] + np.cross(volume[TWIST + 3:TWIST + 6],
                                                      point - volume[POSE:POSE + 3])
        assert surroundings._coming(volume, point, way) == pytest.approx(
            max(way @ velocity, 0.0))


@pytest.fixture(scope='module')
def measured():
    arm = Arm()
    return arm.measure()


def test_an_external_wrench_is_found_from_the_torques_that_it_makes(measured, rng):
    for _ in range(DRAWS):
        wrench, found = rng.normal(size=6), np.empty((2, 6))
        external = measured.jacobian.T @ wrench
        impedance.external_wrench(measured.jacobian, measured.inertia, external, 1e-9, found[0])
        gains = ImpedanceGains(singularity=1e-9)
        target = resting_target(measured.pose, np.eye(6))
        impedance.impedance_torque(
            measured.position, np.zeros(7), measured.pose, measured.jacobian, measured.inertia,
            measured.bias, np.zeros((2, 7)), target, measured.position, np.zeros(7),
            numbers_of(gains), 1.7, external, np.empty(7), found[1], np.empty(6))
        np.testing.assert_allclose(found, np.tile(wrench, (2, 1)), atol=1e-5)


def test_friction_at_a_guided_tool_is_against_its_motion(rng):
    for _ in range(DRAWS):
        velocity, bias, jacobian = rng.normal(size=7), rng.normal(size=7), rng.normal(size=(6, 7))
        torque, twist = np.empty(7), np.ones(6)
        law._free(velocity, bias, jacobian, 2.0, 1.5, torque, twist)
        moving = jacobian[:3] @ velocity
        speed = np.linalg.norm(moving)
        hold = 1.5 * math.tanh(speed / law.FREE_SMOOTHING) * moving / speed
        np.testing.assert_allclose(torque, bias - 2.0 * velocity - jacobian[:3].T @ hold)
        assert not twist.any()


def test_the_power_of_the_joint_springs_is_that_of_the_motion(rng):
    for _ in range(DRAWS):
        position, velocity = rng.normal(size=(2, 7))
        error = 0.1 * rng.normal(size=7)
        reference = np.concatenate([position + error, np.zeros(7), np.full(7, 300.0), [1.0]])
        stored = joint_spring.joint_energy(position, reference)
        bent = np.clip(error, -joint_spring.CLIP, joint_spring.CLIP)
        assert law._joint_power(position, velocity, reference, stored, 1e-7) == pytest.approx(
            -300.0 * bent @ velocity, abs=1e-2)


@pytest.mark.parametrize('side', [-1.0, 1.0])
def test_a_joint_near_its_limit_is_pushed_and_only_its_approach_is_damped(side):
    settings = LimitSettings()
    margin, limits = settings.joint_margin, numbers_of(settings).view(LIMIT_NUMBERS)[0]
    lower, upper, inertia = np.array([-1.0]), np.array([1.0]), np.eye(1)
    largest, fastest = np.array([80.0]), np.array([2.0])
    for deep, kept, rate in ((0.5, 0.0, 0.0), (0.5, 0.2, 0.0), (0.3, 0.0, 0.05),
                             (0.3, 0.0, -0.05), (-0.5, 0.0, 0.0)):
        position, velocity = np.array([side * (1.0 - margin * (1.0 - deep))]), side * rate
        relief, torque, depth = np.array([kept * margin]), np.empty(1), np.empty(1)
        violation = np.zeros(len(LIMITS))
        torque_limits._guard_torque(position, np.array([velocity]), inertia, lower, upper,
                                    largest, fastest, limits, relief, torque, depth, violation)
        share = max(deep - kept, 0.0)
        expected = -side * share * min(settings.joint_repulsion,
                                       torque_limits.REPULSION_SHARE * 80.0)
        if share > 0.0 and rate > 0.0:
            expected -= share * settings.joint_brake * velocity
        assert torque[0] == pytest.approx(expected)
        assert depth[0] == pytest.approx(-side * share)
        assert violation[JOINT_POSITION] == pytest.approx(max(deep, 0.0) * margin)
        assert relief[0] == pytest.approx(kept * margin if deep > 0.0 else 0.0)


def test_a_link_is_pushed_from_a_volume_by_a_potential(loop, rng):
    arm, shape = loop.arm, loop.arm.shape
    hand = own_body.placed(arm.chain, shape, arm.home)[-1]
    volumes, relief = np.zeros((1, VOLUME_SIZE)), np.zeros((1, len(shape.capsules)))
    volume = volumes[0]
    volume[POSE + 3], volume[RADIUS], volume[MARGIN], volume[THERE] = 1.0, 0.05, 0.02, 1.0
    reach = volume[MARGIN] + surroundings.SLACK

    def deep_at(position):
        depth = np.zeros((1, len(shape.capsules)))
        surroundings._depths(*arm.chain, position, shape.capsules, volumes, depth)
        return np.maximum(depth + surroundings.SLACK, 0.0)

    def torque_at(velocity):
        torque = np.zeros(7)
        surroundings.push_away(*arm.chain, arm.home, velocity, shape.capsules, volumes, 1e-3,
                               relief.copy(), torque)
        return torque
    for deep in (0.1, 0.9):  # the first is within the slack, outside of the margin
        way = rng.normal(size=3)
        way[2] = -abs(way[2])
        way /= np.linalg.norm(way)
        volume[POSE:POSE + 3] = hand[:3] + (hand[6] + 0.05 + (1.0 - deep) * reach) * way
        slope = approx_fprime(arm.home, lambda q: float(
            0.5 * surroundings.BARRIER * (deep_at(q) ** 2).sum()), 1e-7)
        still = torque_at(np.zeros(7))
        assert np.abs(still).max() > 1e-3
        if surroundings.BARRIER * deep_at(arm.home).max() < surroundings.MOST_FORCE:
            np.testing.assert_allclose(still, -slope, atol=1e-3 * np.abs(slope).max() + 1e-4)


def test_a_reference_may_go_back_to_a_tool_that_is_held_but_not_further_away():
    gains, pose = numbers_of(ImpedanceGains()), np.array([0.4, 0.0, 0.5, 0.0, 1.0, 0.0, 0.0])
    reference = resting_target(pose, np.diag([400.0] * 3 + [30.0] * 3))
    reference[0] += 0.5
    for way, share in (([1.0, 0.0, 0.0], 0.0), ([-1.0, 0.0, 0.0], 1.0), ([0.0, 1.0, 0.0], 1.0)):
        twist = np.array([*way, 0.0, 0.0, 0.0])
        assert governor._share_that_keeps_error(pose, reference, gains, twist) == pytest.approx(
            share, abs=1e-9)


def test_the_velocity_towards_a_target_is_its_own_and_that_of_the_lag(rng):
    settings, dt = LimitSettings(), 1e-3
    limits = numbers_of(settings).view(LIMIT_NUMBERS)[0]
    for _ in range(DRAWS):
        pose = np.array([0.4, 0.0, 0.5, 0.0, 1.0, 0.0, 0.0])
        reference, target = (resting_target(pose, np.eye(6)) for _ in range(2))
        target[:3] += 0.02 * rng.normal(size=3)
        target[TWIST_OF] = 0.1 * rng.normal(size=6)
        target[ACCELERATION:ACCELERATION + 6] = rng.normal(size=6)
        velocity, lag, violation = np.empty(6), np.empty(6), np.zeros(len(LIMITS))
        governor._wanted_velocity(reference, target, limits, dt, velocity, lag, violation)
        own = target[TWIST_OF] - 0.5 * dt * target[ACCELERATION:ACCELERATION + 6]
        apart = np.concatenate([target[:3] - reference[:3], np.zeros(3)]) - dt * own
        expected = own.copy()
        governor.catch_up(apart[:3], 0.5 * settings.acceleration, settings.catch_up_speed,
                          expected[:3])
        governor.catch_up(apart[3:], 0.5 * settings.angular_acceleration,
                          settings.catch_up_angular_speed, expected[3:])
        np.testing.assert_allclose(lag, apart, atol=1e-12)
        np.testing.assert_allclose(velocity, expected)


def test_the_joints_go_to_the_posture_if_a_limit_leaves_no_other_way(loop):
    numbers = loop.controller.numbers
    arm = memory.parts(numbers)
    s, pose, jacobian = arm.scalars, np.empty(7), np.empty((6, 7))
    arm.posture[:] = loop.arm.home
    chain_state(*loop.arm.chain, arm.end, arm.posture, pose, jacobian)

    def returns(blocked=1.0, blocking=3.0, away=0.2, off=0.0):
        s.returns, s.blocked, s.blocking = 0.0, blocked, blocking
        arm.governed[:] = loop.arm.home - away
        arm.target[:7] = pose
        arm.target[0] += off
        governor._decide_return(numbers)
        return s.returns == 1.0
    assert returns() and returns(away=-0.2)
    assert not returns(blocked=0.1) and not returns(blocking=-1.0)
    assert not returns(away=0.0) and not returns(off=0.05)


def test_the_power_of_coriolis_forces_is_smoothed():
    numbers = record(TANK_NUMBERS, capacity=100.0, passive=1.0)
    scalars = record(memory.SCALARS, dt=1e-3, known=1.0, torques=1.0, energy=10.0,
                     potential=0.3, potential_before=0.1, coriolis=0.5)
    before, bias = np.array([1.0, 2.0]), np.array([30.0, -5.0])
    tank.measure_energy(scalars, numbers, np.zeros((3, 2)), np.zeros((4, 2)), np.zeros(2),
                        before, np.zeros(2), bias, 0.0)
    change = 1e-3 * (30.0 - 10.0) - 0.2 - 0.5
    assert scalars['coriolis'] == pytest.approx(0.5 + 1e-3 / tank.CORIOLIS_S * change)
