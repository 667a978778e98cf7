"""
Kernels of wrenches and torques against their formulas, written in NumPy, at random numbers.

Tests of behaviour cannot tell every sign: a lever arm, a coupling or a damping changes a motion of
the arm too little. Each kernel is tried here by itself.
"""
import math

import numpy as np
import pytest

from gdmp_ros.control import (
    admittance,
    contact,
    impedance,
    joint_path,
    joint_spring,
    law,
    memory,
    plain_tick,
    spring,
    tank,
    torque_limits,
)
from gdmp_ros.control.friction import (
    friction_torque,
    LEAST_SCALE,
    REST_DELAY_S,
    rest_scale,
    without_friction,
)
from gdmp_ros.control.limits import (
    ENERGY,
    JOINT_POSITION,
    LIMITS,
    STIFFNESS_RATE,
    TOOL_SPEED,
)
from gdmp_ros.control.memory import JOINT_SPRINGS, TOOL_SPRING
from gdmp_ros.control.settings import (
    ControllerSettings,
    GAIN_NUMBERS,
    ImpedanceGains,
    LimitSettings,
    TANK_NUMBERS,
)
from gdmp_ros.control.target import (
    DAMPING_RATIO,
    resting_target,
    STIFFNESS,
    TARGET_SIZE,
    WRENCH,
    WRENCH_GAIN,
)
from gdmp_ros.kernels import records_at
from gdmp_ros.sim import Arm, ClosedLoop
from gdmp_ros.util.settings import numbers as numbers_of
from test.control.formulas import (
    coupled,
    DRAWS,
    limit_record,
    PLAIN,
    pose_of,
    record,
    turn_of,
    within,
)


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
        law._springs_at_joints(loop.controller.numbers, np.zeros(7), limit_record())
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


def test_the_next_torque_begins_in_the_middle_of_those_that_are_compared(loop, rng):
    arm, taken = memory.parts(loop.controller.numbers), rng.normal(size=(2, 7))
    taken[1] = taken[0] + rng.uniform(0.0, 0.1, 7)
    law.compare_with(loop.controller.numbers, taken, 1e-3)
    np.testing.assert_allclose(arm.last, taken.mean(axis=0))
    widest = (taken[1] - taken[0]).max()
    assert arm.scalars.cycle == pytest.approx(
        1e-3 - 0.5 * widest / LimitSettings().torque_slew)


def missing_of(arm, energy, torque, power):
    """What a torque would draw from a tank beyond what it may give [J]."""
    scalars = record(memory.SCALARS, dt=arm.scalars.dt, energy=energy,
                     coriolis=arm.scalars.coriolis)
    return tank.missing_energy(scalars, record(TANK_NUMBERS, passive=1.0), arm.credit,
                               arm.velocity, arm.rates, arm.bias, torque, power)


def test_a_torque_without_energy_gives_way_to_a_brake_and_the_spring_pays_the_rest(rng):
    made = ClosedLoop(Arm(), ControllerSettings(limits=LimitSettings(torque_slew=1e6)))
    made.tick()
    numbers, dt = made.controller.numbers, 1e-3
    arm, braked, paid = memory.parts(numbers), 0, 0
    kept = numbers.copy()
    for _ in range(DRAWS):
        numbers[:] = kept
        s = arm.scalars
        arm.velocity[:], s.law = rng.uniform(0.0, 0.3) * rng.normal(size=7), TOOL_SPRING
        arm.twist[:] = arm.jacobian @ arm.velocity
        arm.reference[:3] += 0.02 * rng.normal(size=3)
        whole = arm.bias + 3.0 * rng.normal(size=7)
        arm.torque[:], arm.push[:] = whole, 0.0
        s.energy, s.stored = rng.uniform(-0.01, 0.02), spring.stored_energy(
            arm.pose, arm.reference, arm.gains)
        arm.violation[:] = 0.0
        power = spring.spring_power(arm.pose, arm.twist, arm.reference, arm.gains, s.stored, dt)
        energy, stored = float(s.energy), float(s.stored)
        missing = missing_of(arm, energy, whole, power)
        law._pay(numbers)
        if missing <= 0.0:
            np.testing.assert_array_equal(arm.torque, whole)
            continue
        assert arm.violation[ENERGY] == pytest.approx(missing)
        driving = dt * arm.velocity @ (whole - arm.bias)
        brake = min(max(missing - driving, 0.0) / (dt * arm.velocity @ arm.velocity),
                    LimitSettings().joint_brake)
        least = arm.bias - brake * arm.velocity
        driving = dt * arm.velocity @ (whole - least)
        left = max(1.0 - missing / driving, 0.0) if driving > 0.0 else 1.0
        np.testing.assert_allclose(arm.torque, least + left * (whole - least), atol=1e-9)
        braked += brake > 0.0
        released = stored - s.stored
        assert s.energy - energy == pytest.approx(released, abs=1e-12) and released >= 0.0
        rest = missing_of(arm, energy, arm.torque, power)
        if rest < 1e-9:
            assert released < 1e-6  # what the halvings leave
        else:
            paid += 1
            after = spring.stored_energy(arm.pose, arm.reference, arm.gains)
            assert released > 0.0 and after == pytest.approx(stored - released)
    assert braked > 5 and paid > 5


def test_the_share_of_a_motion_of_the_joints_that_a_bounded_wrench_leaves(measured, rng):
    gains, limited = numbers_of(ImpedanceGains()), 0
    for _ in range(DRAWS):
        wanted = measured.position + rng.uniform(0.0, 0.1) * rng.normal(size=7)
        torque, twist, pushed = np.empty(7), np.empty(6), np.empty(6)
        reduced = law._follow_joints(
            measured.position, np.zeros(7), measured.bias, measured.jacobian, measured.inertia,
            wanted, np.zeros(7), gains.view(GAIN_NUMBERS)[0], torque, twist)
        active = measured.inertia @ (law.BANDWIDTH ** 2 * (wanted - measured.position))
        impedance.external_wrench(measured.jacobian, measured.inertia, active,
                                  ImpedanceGains().singularity, pushed)
        share = min(1.0, *(most / np.linalg.norm(part) for most, part in zip(
            ImpedanceGains().wrench_max, (pushed[:3], pushed[3:]))))
        np.testing.assert_allclose(torque, measured.bias + share * active, atol=1e-9)
        assert reduced == pytest.approx(1.0 - share, abs=1e-12)
        limited += share < 1.0
    assert 5 < limited < DRAWS


@pytest.mark.parametrize('does', [TOOL_SPRING, JOINT_SPRINGS])
def test_the_state_has_a_reference_of_the_joints_only_if_they_follow_one(loop, does):
    numbers = loop.controller.numbers
    memory.parts(numbers).scalars.does = does
    target, state = np.ones(TARGET_SIZE), np.zeros(99 + len(LIMITS) + 6 * 7)
    assert plain_tick.write_state(numbers, target, state) == (does == JOINT_SPRINGS)
    assert (state[55] == 1.0) == (does == TOOL_SPRING)


@pytest.fixture(scope='module')
def measured():
    return Arm().measure()


def torque_at(measured, target, gains, external=0.0, dry=0.0, off=0.0):
    """
    Torque of an arm at rest, its external wrench, and the wrench that it commands.

    :param external: torque of the environment [Nm]
    :param dry: friction that is compensated [Nm]
    :param off: how far the posture of the null space is away [rad]
    """
    torque, wrench, force = np.empty(7), np.empty(6), np.empty(6)
    impedance.impedance_torque(
        measured.position, np.zeros(7), measured.pose, measured.jacobian, measured.inertia,
        measured.bias, np.array([np.zeros(7), np.full(7, dry)]), target,
        measured.position + off, np.zeros(7), numbers_of(gains), 1.7, np.full(7, external),
        torque, wrench, force)
    return torque, wrench, force


def test_an_external_wrench_is_found_from_the_torques_that_it_makes(measured, rng):
    for _ in range(DRAWS):
        wrench, found = rng.normal(size=6), np.empty(6)
        external = measured.jacobian.T @ wrench
        impedance.external_wrench(measured.jacobian, measured.inertia, external, 1e-9, found)
        np.testing.assert_allclose(found, wrench, atol=1e-5)
        _, found, _ = torque_at(measured, resting_target(measured.pose, np.eye(6)),
                                ImpedanceGains(singularity=1e-9), external)
        np.testing.assert_allclose(found, wrench, atol=1e-5)


def test_the_friction_that_is_known_is_taken_from_an_external_torque(rng):
    external, velocity, result = *rng.normal(size=(2, 7)), np.empty(7)
    dry = np.array([0.0, 1.0, 2.0, 0.0, 0.5, 1.5, 1.0])
    without_friction(external, velocity, dry, 0.1, result)
    np.testing.assert_allclose(result, external + dry * np.tanh(velocity / 0.1))


def test_walls_push_a_tool_that_follows_poses_only(loop):
    arm = memory.parts(loop.controller.numbers)
    arm.pose[2], arm.outside[:] = LimitSettings().workspace_min[2] - 0.002, 0.0
    for does in (TOOL_SPRING, JOINT_SPRINGS):
        arm.scalars.does = does
        law.finish(loop.controller.numbers, False)
        assert arm.push.any() == (does == TOOL_SPRING)


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
    margin, limits = settings.joint_margin, limit_record()
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


def test_a_wrench_that_is_wished_is_corrected_by_what_is_missing(rng):
    for _ in range(DRAWS):
        reference, felt, before = np.zeros(TARGET_SIZE), rng.normal(size=6), rng.normal(size=6)
        wished, gain = rng.normal(size=6), rng.choice([0.0, 3.0], 6)
        reference[WRENCH:WRENCH + 6], reference[WRENCH_GAIN:WRENCH_GAIN + 6] = wished, gain
        before[0], gain[0] = 0.9e-6, 0.0
        reference[WRENCH_GAIN] = 0.0
        correction = before.copy()
        contact.correct(record(memory.SCALARS, dt=1e-3, feedback_force=1.5, feedback_torque=1e9),
                        felt, correction, reference)
        expected = np.where(gain > 0.0, before + 1e-3 * gain * (wished + felt),
                            before * (1.0 - 1e-3 / contact.DECAY_S))
        expected[:3] = within(expected[:3], 1.5)
        expected[np.abs(expected) < 1e-6] = 0.0
        np.testing.assert_allclose(correction, expected)
        np.testing.assert_allclose(reference[WRENCH:WRENCH + 6], wished + expected)


@pytest.mark.parametrize('part', [0, 1])
def test_what_opposes_a_motion_is_a_collision_from_its_limit_on(part):
    twist, at = np.zeros(6), slice(3 * part, 3 * part + 3)
    twist[at] = [0.3, -0.4, 0.0]

    def event(size, exerted=0.0):
        scalars = record(memory.SCALARS, dt=1.0, collision_force=10.0, collision_torque=10.0)
        felt, wrench, own = np.zeros((3, 6))
        wrench[at], own[at] = -size * np.array([0.6, -0.8, 0.0]), exerted * np.array(
            [0.6, -0.8, 0.0])
        return contact.feel(scalars, felt, wrench, twist, own), scalars['against']
    assert event(9.9)[0] == event(-20.0)[0] == contact.NOTHING
    found, against = event(12.0)
    assert found == (contact.FORCE, contact.TORQUE)[part] and against == pytest.approx(12.0)
    # What the reference exerts itself is no collision.
    assert event(12.0, exerted=5.0)[0] == contact.NOTHING
    twist *= 0.02  # a speed of 0.01 m/s counts as a motion, 0.01 rad/s does not
    assert event(12.0)[0] == (contact.FORCE, contact.NOTHING)[part]
    twist *= 0.1
    assert event(12.0)[0] == contact.NOTHING


def test_the_wrench_of_a_reference_acts_at_the_tool(measured, rng):
    target, wrench = resting_target(measured.pose, PLAIN), rng.normal(size=6)
    target[DAMPING_RATIO] = 0.7
    before, _, _ = torque_at(measured, target, ImpedanceGains())
    target[WRENCH:WRENCH + 6] = wrench
    torque, _, force = torque_at(measured, target, ImpedanceGains())
    np.testing.assert_allclose(force, wrench, atol=1e-12)
    np.testing.assert_allclose(torque - before, measured.jacobian.T @ wrench, atol=1e-9)


def test_the_help_over_friction_is_as_large_as_a_delay_allows():
    for dry, share, stiffness, inertia, ratio in ((1.0, 0.5, 100.0, 1.0, 0.7),
                                                  (0.4, 0.3, 2000.0, 0.2, 1.0)):
        factor = 2.0 * ratio * math.sqrt(inertia / stiffness) / REST_DELAY_S - 1.0
        assert rest_scale(dry, share, stiffness, inertia, ratio) == pytest.approx(
            max(share * dry / factor, LEAST_SCALE * dry))


def test_joints_are_slowed_by_what_the_tool_is_too_fast(rng):
    for _ in range(DRAWS):
        velocity, bias, torque = 0.2 * rng.normal(size=7), *rng.normal(size=(2, 7))
        jacobian, before = rng.normal(size=(6, 7)), torque.copy()
        excess = law._slow_tool(jacobian, velocity, bias, 0.5, 40.0, torque)
        moving, band = jacobian[:3] @ velocity, min(law.TOOL_SPEED_BAND, 0.25)
        speed = np.linalg.norm(moving)
        assert excess == pytest.approx(max(speed - 0.5 + band, 0.0))
        if excess == 0.0:
            np.testing.assert_array_equal(torque, before)
            continue
        left = max(1.0 - excess / band, 0.0) if (before - bias) @ velocity > 0.0 else 1.0
        expected = bias + left * (before - bias) - jacobian[:3].T @ moving * 40.0 * excess / speed
        np.testing.assert_allclose(torque, expected)


def test_the_inertia_of_the_tool_is_damped_at_singularities_on_its_diagonal(rng):
    for _ in range(DRAWS):
        jacobian, root = rng.normal(size=(6, 7)), rng.normal(size=(7, 7))
        inertia, solved, inverse = root @ root.T + np.eye(7), np.empty((7, 6)), np.empty((6, 6))
        impedance.task_inertia_inverse(inertia, jacobian, 0.3, solved, inverse)
        expected = np.linalg.solve(inertia, jacobian.T)
        np.testing.assert_allclose(solved, expected)
        np.testing.assert_allclose(inverse, jacobian @ expected + 0.09 * np.eye(6))


def test_a_wrench_is_scaled_as_a_whole(rng):
    for _ in range(DRAWS):
        wrench = 10.0 * rng.normal(size=6)
        before = wrench.copy()
        scale = impedance._limit_wrench(wrench, np.array([12.0, 9.0]))
        sizes = np.linalg.norm(before[:3]), np.linalg.norm(before[3:])
        assert scale == pytest.approx(min(1.0, 12.0 / sizes[0], 9.0 / sizes[1]))
        np.testing.assert_allclose(wrench, scale * before)


def test_springs_of_tool_and_posture_are_helped_over_friction(measured):
    """The help at rest knows the torque of both springs, not that of the weight."""
    gains = ImpedanceGains(friction_at_rest=0.5)
    target = resting_target(measured.pose, PLAIN)
    target[:3] += [0.002, -0.001, 0.003]
    target[DAMPING_RATIO] = 0.7
    without, helped = (torque_at(measured, target, gains, dry=dry, off=0.05)[0]
                       for dry in (0.0, 1.1))
    pull = without - measured.bias
    along = (np.diag(measured.jacobian.T @ target[STIFFNESS:STIFFNESS + 36].reshape(6, 6)
                     @ measured.jacobian) + gains.posture_stiffness)
    expected = [friction_torque(0.0, 1.1, 0.0, pull[i], gains.friction_smoothing, 0.5,
                                rest_scale(1.1, 0.5, along[i], measured.inertia[i, i], 0.7))
                for i in range(7)]
    assert np.abs(expected).max() > 0.1
    np.testing.assert_allclose(helped - without, expected, atol=1e-9)


def test_what_the_joints_follow_depends_on_what_the_arm_does(loop, rng):
    arm = memory.parts(loop.controller.numbers)
    governed, reference, wanted = rng.normal(size=(3, 7))
    arm.governed_rate[:], arm.joint_reference[7:14], arm.wanted_rate[:] = (governed, reference,
                                                                           wanted)
    for does, expected in ((TOOL_SPRING, governed), (JOINT_SPRINGS, reference),
                           (memory.JOINT_MOTION, wanted), (memory.FREE, np.zeros(7))):
        arm.scalars.does = does
        law.finish(loop.controller.numbers, False)
        np.testing.assert_array_equal(arm.rates, expected)


def test_the_posture_changes_slowly(loop):
    arm = memory.parts(loop.controller.numbers)
    arm.scalars.does = TOOL_SPRING
    arm.posture[:], arm.wanted_posture[:] = 0.0, [1.0, -1.0, 1e-6, -1e-6, 0.0, 0.5, -0.5]
    law.compute(loop.controller.numbers)
    step = law.POSTURE_RATE * arm.scalars.dt
    np.testing.assert_allclose(arm.posture, np.clip(arm.wanted_posture, -step, step))


def test_limits_that_are_exceeded_are_counted_with_the_largest_excess(loop):
    arm = memory.parts(loop.controller.numbers)
    arm.counts[:], arm.recent[:] = 0.0, 0.0
    for excess in (0.5, 0.7, 0.6):
        arm.violation[:] = 0.0
        arm.violation[STIFFNESS_RATE] = excess
        law.finish(loop.controller.numbers, False)
    assert arm.counts[STIFFNESS_RATE] == 3.0 and arm.recent[STIFFNESS_RATE] == 0.7
    others = np.delete(np.arange(len(LIMITS)), STIFFNESS_RATE)
    assert not arm.counts[others].any() and not arm.recent[others].any()


@pytest.fixture
def path(loop):
    """A motion of the joints: they stand for a second, the torque of the second is measured."""
    home = loop.arm.home
    coefficients = np.zeros((1, joint_path.ORDER, 7))
    coefficients[0, 0] = home
    made = joint_path.JointPath(
        np.zeros(len(joint_path.PROGRESS.names)), np.zeros(1), coefficients,
        np.array([1]), np.zeros((1, 2)), np.zeros((5, 9)))
    return made, records_at(made.progress, 0, 1, joint_path.PROGRESS)[0]


def test_torques_are_summed_and_sampled_at_their_times(path):
    made, p = path
    position, due = np.arange(7.0), joint_path.SAMPLE_S
    for k, time in enumerate((0.0, 0.4 * due, 1.1 * due, 1.2 * due)):
        p.time = time
        joint_path._sample(made, 0, position + k, 2.0 + k)
    assert made.sums[0].tolist() == [2.0 + 3.0 + 4.0 + 5.0, 4.0] and p.sampled == 2.0
    np.testing.assert_array_equal(made.samples[:2, :2], [[0.0, 2.0], [0.0, 4.0]])
    np.testing.assert_array_equal(made.samples[1, 2:], position + 2)
    assert p.next == pytest.approx(2.1 * due)


def test_a_motion_of_the_joints_goes_on_until_it_has_arrived_or_has_a_problem(loop, path):
    (made, p), numbers = path, loop.controller.numbers
    p.seconds = 0.01
    said = [joint_path.make_way(numbers, made, 1e-3) for _ in range(11)]
    assert said[:9] == [0] * 9 and said[10] == joint_path.CALLED
    assert p.time == pytest.approx(0.011) and p.problem == joint_path.FINE
    p.time, made.coefficients[0, 0] = 0.0, loop.arm.home + 0.5
    assert joint_path.make_way(numbers, made, 1e-3) == joint_path.CALLED
    assert p.problem == joint_path.HELD and p.time == 0.0 and p.apart > 0.4


@pytest.mark.parametrize('retreat', [0.0, 0.2])
def test_an_arm_beside_what_comes_is_braked_unless_it_may_retreat(retreat):
    loop = ClosedLoop(Arm(), ControllerSettings(limits=LimitSettings(retreat_speed=retreat)))
    loop.tick()
    arm = memory.parts(loop.controller.numbers)
    arm.velocity[:] = np.linspace(-0.02, 0.03, 7)
    for slowed in (0.4, 1.0):
        arm.scalars.slowed = slowed
        law.finish(loop.controller.numbers, False)
        left = 1.0 if retreat else slowed
        np.testing.assert_allclose(
            arm.push, -(1.0 - left) / law.STANDS_S * arm.inertia @ arm.velocity, atol=1e-12)
