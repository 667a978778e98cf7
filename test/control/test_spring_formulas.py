"""
Kernels of springs and of the energy against their formulas, written in NumPy, at random numbers.

Tests of behaviour cannot tell every sign: a lever arm, a coupling or a damping changes a motion of
the arm too little. Each kernel is tried here by itself.
"""
import math

import numpy as np
import pytest
from scipy.optimize import approx_fprime

from gdmp_ros.control import (
    energy_budget,
    joint_spring,
    law,
    memory,
    spring,
    tank,
)
from gdmp_ros.control.kinematics import chain_state
from gdmp_ros.control.limits import (
    ENERGY,
    JOINT_POSITION,
    JOINT_SPEED,
    LIMITS,
    STIFFNESS_RATE,
)
from gdmp_ros.control.settings import (
    ImpedanceGains,
    TANK_NUMBERS,
)
from gdmp_ros.control.target import STIFFNESS
from gdmp_ros.util.settings import numbers as numbers_of
from test.control.formulas import coupled, DRAWS, PLAIN, record, TWIST_OF


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
        assert violation[STIFFNESS_RATE] == pytest.approx((math.log(2.0) - math.log(1.5)) / 1e-3)


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
    # A little off, it closes the lag that is left after its own velocity.
    assert after(0.0006, 0.5)[1] == pytest.approx(0.5 + 1e-4 / joint_spring.CATCH_UP_S)
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


def move_away(arm):
    """Let all joints of a reference move away; energy before, and what the motion needs [J]."""
    n = 7
    arm.joint_reference[:] = np.concatenate(
        [arm.position + 0.05, np.full(n, 0.3), np.full(n, 500.0), [1.0]])
    arm.joint_target[:] = arm.joint_reference
    arm.joint_target[:n] += 0.3e-3
    before, after = (joint_spring.joint_energy(arm.position, numbers)
                     for numbers in (arm.joint_reference, arm.joint_target))
    return before, after - before


def test_joints_that_move_away_draw_what_there_is(loop, rng):
    numbers = loop.controller.numbers
    arm, n = memory.parts(numbers), 7
    for _ in range(DRAWS):
        before, most = move_away(arm)
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
        _, most = move_away(arm)
        arm.joint_target[2 * n:3 * n] = 2000.0
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
    gains, reached, shortened = numbers_of(ImpedanceGains()), 0, 0
    for _ in range(4 * DRAWS):
        old, target = coupled(rng).reshape(-1), coupled(rng).reshape(-1)
        error, numbers = 0.3 * rng.normal(size=6), np.empty(spring.SPRING_SIZE)
        budget = rng.uniform(0.0, 0.5)
        spring.make_spring(old, gains, numbers)
        before = spring.spring_energy(numbers, error)
        by_modes, force = target.copy(), np.empty(6)
        share = np.repeat(np.sqrt(spring.spring_force(numbers, error, force)), 3)
        of_modes = energy_budget._limit_modes(old, by_modes, share * error, 10.0, budget,
                                              np.zeros(len(LIMITS)))
        drawn, missing = energy_budget._change_stiffness(old, target, error, gains, 10.0, budget,
                                                         numbers, np.zeros(len(LIMITS)))
        # What the modes do not explain shortens the whole change.
        spring.make_spring(by_modes, gains, numbers)
        beyond = max(spring.spring_energy(numbers, error) - before - budget, 0.0)
        assert missing == pytest.approx(of_modes + beyond, abs=1e-12)
        left = ((target - old) @ (by_modes - old)) / ((by_modes - old) @ (by_modes - old))
        assert 0.0 <= left <= 1.0 and (left == pytest.approx(1.0)) == (beyond == 0.0)
        np.testing.assert_allclose(target, old + left * (by_modes - old), atol=1e-9)
        shortened += beyond > 0.0
        spring.make_spring(target, gains, numbers)
        assert spring.spring_energy(numbers, error) - before == pytest.approx(drawn, abs=1e-9)
        assert drawn <= budget + 1e-9 and missing >= 0.0
        reached += abs(drawn - budget) < 1e-4
        assert np.linalg.eigvalsh(target.reshape(6, 6)).min() > 0.0
    assert reached > 10 and shortened > 10


def test_modes_that_need_no_energy_grow_whatever_others_need():
    gains, spring_numbers = numbers_of(ImpedanceGains()), np.empty(spring.SPRING_SIZE)
    old, wanted = PLAIN, 2.0 * PLAIN
    error = np.array([0.0, 0.0, 0.0, 0.02, 0.0, 0.0])
    for budget, grown in ((1e9, 2.0), (0.003, 1.0 + 0.0005 / 0.006)):
        target = wanted.reshape(-1).copy()
        spring.make_spring(old.reshape(-1), gains, spring_numbers)
        drawn, missing = energy_budget._change_stiffness(
            old.reshape(-1), target, error, gains, 1.0, budget, spring_numbers,
            np.zeros(len(LIMITS)))
        np.testing.assert_allclose(np.diag(target.reshape(6, 6)),
                                   [800.0] * 3 + [30.0 * grown, 60.0, 60.0])
        assert drawn == pytest.approx(0.006 * (grown - 1.0))
        assert missing == pytest.approx(0.006 * (2.0 - grown), abs=1e-12)


def missing_apart(numbers, budget):
    """Energy that stiffness and motion miss, one after the other; the memory stays [J]."""
    kept, arm = numbers.copy(), memory.parts(numbers)
    error, spring_numbers = np.empty(6), np.empty(spring.SPRING_SIZE)
    spring.pose_error(arm.pose, arm.reference, error)
    stiffness, wanted = (part[STIFFNESS:STIFFNESS + 36] for part in (arm.reference, arm.target))
    spring.make_spring(stiffness, arm.gains, spring_numbers)
    drawn, short = energy_budget._change_stiffness(
        stiffness, wanted, error, arm.gains, 1.0, budget, spring_numbers, np.zeros(len(LIMITS)))
    stiffness[:] = wanted
    _, missing = energy_budget._move_reference(numbers, spring_numbers, budget - drawn)
    numbers[:] = kept
    return short + missing


def test_stiffness_and_motion_together_draw_what_there_is(loop, rng):
    numbers = loop.controller.numbers
    arm, limited = memory.parts(numbers), 0
    pose, jacobian = np.empty(7), np.empty((6, 7))
    for draw in range(DRAWS):
        arm.governed[:] = loop.arm.home + 0.03 * rng.normal(size=7)
        chain_state(*loop.arm.chain, arm.end, arm.governed, pose, jacobian)
        arm.reference[:7], arm.governed_rate[:] = pose, rng.normal(size=7)
        arm.reference[STIFFNESS:STIFFNESS + 36] = PLAIN.reshape(-1)
        wished = PLAIN if draw % 2 else np.diag([500.0] * 3 + [35.0] * 3)
        arm.target[STIFFNESS:STIFFNESS + 36] = wished.reshape(-1)
        arm.violation[:] = 0.0
        before = spring.stored_energy(arm.pose, arm.reference, arm.gains)
        budget = rng.uniform(0.0, 0.005 if draw % 2 else 0.1)
        wanted = missing_apart(numbers, budget)
        drawn, stored = energy_budget.apply_energy_budget(numbers, 1.0, budget)
        after = spring.stored_energy(arm.pose, arm.reference, arm.gains)
        assert stored == pytest.approx(after) and drawn == pytest.approx(after - before, abs=1e-9)
        assert drawn <= budget + 1e-9
        short = arm.violation[ENERGY]
        assert short == pytest.approx(wanted, abs=1e-12)
        limited += short > 0.0
        if short == 0.0:
            np.testing.assert_allclose(arm.reference[STIFFNESS], wished[0, 0])
    assert 5 < limited < DRAWS


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
        credit = rng.uniform(size=(4, 7))
        missing = tank.missing_energy(scalars, numbers, credit, velocity, velocity, bias, torque,
                                      2.0)
        lost = tank._credited(credit, velocity, velocity)
        may = (1.0 - tank.RESERVE) * 1e-3 / tank.SPENDING_S
        assert missing == pytest.approx(
            1e-3 * (velocity @ (torque - bias) + 2.0 - lost) + 0.004 - may)


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


def test_the_power_of_coriolis_forces_is_smoothed():
    numbers = record(TANK_NUMBERS, capacity=100.0, passive=1.0)
    scalars = record(memory.SCALARS, dt=1e-3, known=1.0, torques=1.0, energy=10.0,
                     potential=0.3, potential_before=0.1, coriolis=0.5)
    before, bias = np.array([1.0, 2.0]), np.array([30.0, -5.0])
    tank.measure_energy(scalars, numbers, np.zeros((3, 2)), np.zeros((4, 2)), np.zeros(2),
                        before, np.zeros(2), bias, 0.0)
    change = 1e-3 * (30.0 - 10.0) - 0.2 - 0.5
    assert scalars['coriolis'] == pytest.approx(0.5 + 1e-3 / tank.CORIOLIS_S * change)


def test_springs_of_joints_are_softened_until_they_have_released_an_energy(rng):
    for share in (0.05, 0.9):
        position = rng.normal(size=7)
        reference = np.concatenate([position + 0.1 * rng.normal(size=7), np.zeros(7),
                                    rng.uniform(100.0, 500.0, 7), [1.0]])
        stiffness, before = reference[14:21].copy(), joint_spring.joint_energy(position, reference)
        released = law._soften_joints(position, reference, share * before)
        softer = max(1.0 - share, energy_budget.LEAST_SOFTENING)
        assert released == pytest.approx((1.0 - softer) * before)
        np.testing.assert_allclose(reference[14:21], softer * stiffness)
    reference[:7] = position
    assert law._soften_joints(position, reference, 1.0) == 0.0


def test_the_rotational_spring_is_exact_for_small_angles_too():
    """The series and the closed form meet where one takes over from the other."""
    axis, v = np.array([0.6, 0.0, 0.8]), np.array([0.3, -0.5, 0.2])
    for angle in (0.9e-3, 1.1e-3, 0.5):
        found, skew = np.empty(3), angle * np.cross(np.eye(3), axis)
        spring.left_jacobian_inverse(angle * axis, v, found)
        left = sum(np.linalg.matrix_power(skew, k) / math.factorial(k + 1) for k in range(20))
        np.testing.assert_allclose(left @ found, v, rtol=1e-9)
    # 1/12 is a part of 1e-7 of the result there: it is compared with its own size.
    for angle in (0.9e-3, 1.1e-3):
        across = np.array([0.8, 0.0, -0.6])
        spring.left_jacobian_inverse(angle * axis, across, found)
        assert (1.0 - found @ across) * 12.0 / angle ** 2 == pytest.approx(1.0, abs=1e-5)
