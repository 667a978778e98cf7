"""
Kernels of the reference and of distances against their formulas, at random numbers.

Tests of behaviour cannot tell every sign: a lever arm, a coupling or a damping changes a motion of
the arm too little. Each kernel is tried here by itself.
"""
import math

import numpy as np
import pytest
from scipy.optimize import approx_fprime

from gdmp_ros.control import (
    governor,
    limit_rows,
    memory,
    own_body,
    reference_check,
    surroundings,
)
from gdmp_ros.control.kinematics import chain_state
from gdmp_ros.control.limits import (
    LIMITS,
    SINGULARITY,
)
from gdmp_ros.control.settings import (
    ControllerSettings,
    ImpedanceGains,
    LimitSettings,
)
from gdmp_ros.control.singularity import singular_value
from gdmp_ros.control.target import (
    ACCELERATION,
    resting_target,
    TARGET_SIZE,
)
from gdmp_ros.control.weight import is_weightless
from gdmp_ros.scene.volume import HALF, POSE, RADIUS, TWIST, VOLUME_SIZE
from gdmp_ros.sim import Arm, ClosedLoop
from gdmp_ros.util.settings import numbers as numbers_of
from test.control.formulas import (
    BALL,
    ball,
    coupled,
    DRAWS,
    HERE,
    limit_record,
    MARGIN,
    PLAIN,
    pose_of,
    record,
    too_near,
    TWIST_OF,
    within,
)


def empty_rows(count):
    """Rows, bounds and ids to be written."""
    return np.zeros((count, 7)), *np.zeros((2, count))


def ball_below(arm, position, away):
    """A ball that is this far below the lower end of the hand."""
    hand = own_body.placed(arm.chain, arm.shape, position)[-1]
    lowest = min(hand[:3], hand[3:6], key=lambda end: end[2])
    return ball(lowest - [0.0, 0.0, hand[6] + BALL + away])


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
    limits = limit_record()
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


def test_joints_that_make_no_way_are_noticed_if_they_are_off_their_target(loop):
    numbers, home = loop.controller.numbers, loop.arm.home
    arm = memory.parts(numbers)
    for off in (0.0, 0.1, -0.1):
        arm.scalars.way, arm.scalars.allowed, arm.scalars.permitted = 1.0, 0.0, 0.0
        arm.joint_reference[:7], arm.joint_target[:7] = home, home + off
        rates = np.ones(7)
        assert governor.keep_joints_inside(numbers, np.ones(7), rates) and not rates.any()
        assert (arm.scalars.way < 1.0) == (off != 0.0)


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


@pytest.mark.parametrize('way', [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (1, 0, 1), (0, 1, 1)])
def test_a_fast_volume_has_rows_from_further_away(way, loop):
    """From as far as it comes in the time in which an arm slows down."""
    way = np.array(way) / np.linalg.norm(way)
    arm, shape = loop.arm, loop.arm.shape
    hand = own_body.placed(arm.chain, shape, arm.home)[-1, :3]
    still, fast = (ball(hand - 0.9 * way, speed * way)[None] for speed in (0.0, 20.0))

    def shared(volumes):
        return surroundings.surroundings_rows(
            *arm.chain, arm.home, shape.capsules, volumes, 0.0, 6.5, 0.5, 0.0, 0,
            *empty_rows(surroundings.MOST_ROWS), 0)
    assert shared(still)[:2] == (0, 1.0)
    count, share, _, _ = shared(fast)
    assert count > 0 and share < 1.0
    assert surroundings.push_away(
        *arm.chain, arm.home, np.zeros(7), shape.capsules, fast, 1e-3,
        np.zeros((1, len(shape.capsules))), np.zeros(7)) < 1.0


def test_the_end_of_a_link_that_is_the_nearest_point_has_one_row(loop):
    arm, shape = loop.arm, loop.arm.shape
    seen, placed = set(), own_body.placed(arm.chain, shape, arm.home)
    for c in range(len(shape.capsules)):
        first, second, radius = placed[c, :3], placed[c, 3:6], placed[c, 6]
        length = np.linalg.norm(second - first)
        if shape.capsules[c, 0] == 0.0 or length < 0.05:
            continue
        for t, places in ((0.0, 2), (1.0, 2), (0.5, 3)):
            way = np.cross(second - first, [0.3, 0.5, 0.8])
            way /= np.linalg.norm(way)
            small = ball(first + t * (second - first) + (radius + 0.1) * way, radius=0.01)
            count, *_ = surroundings.surroundings_rows(
                *arm.chain, arm.home, shape.capsules[c:c + 1], small[None], 0.0, 0.5, 10.0, 0.0, 0,
                *empty_rows(surroundings.MOST_ROWS), 0)
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


def test_a_link_is_pushed_from_a_volume_by_a_potential(loop, rng):
    arm, shape = loop.arm, loop.arm.shape
    hand = own_body.placed(arm.chain, shape, arm.home)[-1]
    relief, reach = np.zeros((1, len(shape.capsules))), MARGIN + surroundings.SLACK

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
        volumes = ball(hand[:3] + (hand[6] + BALL + (1.0 - deep) * reach) * way)[None]
        slope = approx_fprime(arm.home, lambda q: float(
            0.5 * surroundings.BARRIER * (deep_at(q) ** 2).sum()), 1e-7)
        still = torque_at(np.zeros(7))
        assert np.abs(still).max() > 1e-3
        if surroundings.BARRIER * deep_at(arm.home).max() < surroundings.MOST_FORCE:
            np.testing.assert_allclose(still, -slope, atol=1e-3 * np.abs(slope).max() + 1e-4)


def test_a_reference_may_go_back_to_a_tool_that_is_held_but_not_further_away():
    gains, reference = numbers_of(ImpedanceGains()), resting_target(HERE, PLAIN)
    reference[0] += 0.5
    for way, share in (([1.0, 0.0, 0.0], 0.0), ([-1.0, 0.0, 0.0], 1.0), ([0.0, 1.0, 0.0], 1.0)):
        twist = np.array([*way, 0.0, 0.0, 0.0])
        assert governor._share_that_keeps_error(HERE, reference, gains, twist) == pytest.approx(
            share, abs=1e-9)


def test_the_velocity_towards_a_target_is_its_own_and_that_of_the_lag(rng):
    settings, dt = LimitSettings(), 1e-3
    limits = limit_record()
    for _ in range(DRAWS):
        reference, target = (resting_target(HERE, np.eye(6)) for _ in range(2))
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


def test_the_rows_of_the_nearest_volumes_are_kept():
    bounds = np.array([9.0, 0.5, 0.3, 0.8, 0.1])
    many = surroundings.MOST_ROWS
    assert surroundings._place_for(bounds, 1, 4, 5.0) == 4
    full = np.linspace(0.1, 1.0, many + 1)
    full[0], full[3] = 9.0, 2.0  # the first one is of another kind
    assert surroundings._place_for(full, 1, many + 1, 1.5) == 3
    assert surroundings._place_for(full, 1, many + 1, 2.5) == -1


def test_what_moves_towards_a_volume_is_pushed_harder(loop):
    arm, shape = loop.arm, loop.arm.shape
    last, volumes = shape.capsules[-1:].copy(), ball_below(arm, arm.home, MARGIN)[None]
    n, depth = 7, np.zeros((1, 1))
    surroundings._depths(*arm.chain, arm.home, last, volumes, depth)
    deep = depth[0, 0] + surroundings.SLACK
    assert 0.0 < 1.5 * deep < surroundings.MOST_FORCE / surroundings.BARRIER

    def torque_at(velocity):
        torque = np.zeros(n)
        surroundings.push_away(*arm.chain, arm.home, velocity, last, volumes, 1e-3,
                               np.zeros((1, 1)), torque)
        return torque
    still = torque_at(np.zeros(n))
    # With 1 N of force this torque is the row: how fast each joint brings the link nearer.
    row = -still / (surroundings.BARRIER * deep)
    away = row / np.linalg.norm(row) ** 2
    np.testing.assert_allclose(torque_at(0.1 * away), (1.0 + 0.1 / own_body.DOUBLED) * still,
                               rtol=1e-6)
    np.testing.assert_allclose(torque_at(-0.1 * away), still, rtol=1e-6)


def test_parts_of_an_arm_that_are_too_near_are_pushed_apart_by_a_potential(loop):
    arm, body, n = loop.arm, loop.arm.shape, 7
    folded = too_near(arm)
    nearest = own_body.clearances(arm.chain, body, folded).argmin()
    body = body._replace(pairs=body.pairs[nearest:nearest + 1])

    def energy(position):
        deep = np.maximum(own_body.KEEP - own_body.clearances(arm.chain, body, position), 0.0)
        return 0.5 * own_body.PUSH / own_body.KEEP * (deep ** 2).sum()

    def torque_at(velocity, relief):
        torque = np.zeros(n)
        own_body.push_apart(*arm.chain, folded, velocity, body.capsules, body.pairs, relief,
                            torque)
        return torque
    relief = np.zeros(len(body.pairs))
    still = torque_at(np.zeros(n), relief)
    slope = approx_fprime(folded, energy, 1e-7)
    np.testing.assert_allclose(still, -slope, atol=1e-3 * np.abs(slope).max())
    assert not relief.any()
    # The force over the depth is the row of the distance.
    deep = own_body.KEEP - own_body.clearances(arm.chain, body, folded)[0]
    row = -still / (own_body.PUSH / own_body.KEEP * deep)
    away = row / np.linalg.norm(row) ** 2
    np.testing.assert_allclose(torque_at(0.1 * away, relief),
                               (1.0 + 0.1 / own_body.DOUBLED) * still, rtol=1e-6)
    np.testing.assert_allclose(torque_at(-0.1 * away, relief), still, rtol=1e-6)
    half = np.array([0.5 * deep])
    np.testing.assert_allclose(torque_at(np.zeros(n), half), 0.5 * still, rtol=1e-6)
    # Parts that are far apart forget what did not act.
    folded = arm.home
    assert not torque_at(np.zeros(n), half).any() and half[0] == 0.0


def test_a_position_is_moved_into_the_workspace(rng):
    settings = LimitSettings()
    low, high = np.array(settings.workspace_min), np.array(settings.workspace_max)
    limits = limit_record()
    for _ in range(DRAWS):
        position = rng.uniform(low - 0.2, high + 0.2)
        before, velocity, present = position.copy(), np.ones(3), 0.5 * (low + high)
        outside = governor._move_into_workspace(position, velocity, present, limits)
        np.testing.assert_allclose(position, np.clip(before, low, high))
        assert outside == pytest.approx(np.linalg.norm(position - before))
        np.testing.assert_array_equal(velocity, np.where(position == before, 1.0, 0.0))


def test_a_barrier_begins_where_the_slack_does():
    """A link that is one ball, so that the distance at which it is left out is exact."""
    arm, capsule = Arm(), np.zeros((1, own_body.CAPSULE_SIZE))
    capsule[0, 0], capsule[0, 7] = 7, 0.03
    link = arm.shape._replace(capsules=capsule)
    center = own_body.placed(arm.chain, link, arm.home)[0, :3]
    for deep in (0.05, 0.5, 1.0):
        away = 0.03 + BALL + MARGIN + (1.0 - deep) * surroundings.SLACK
        torque = np.zeros(7)
        surroundings.push_away(*arm.chain, arm.home, np.zeros(7), link.capsules,
                               ball(center + [away, 0.0, 0.0])[None], 1e-3, np.zeros((1, 1)),
                               torque)
        slope = approx_fprime(arm.home, lambda q: float(own_body.placed(
            arm.chain, link, q)[0, 0]), 1e-7)
        force = surroundings.BARRIER * deep * surroundings.SLACK
        np.testing.assert_allclose(torque, -force * slope, atol=1e-4 * force)


def test_a_wall_and_a_joint_range_have_the_row_that_is_named_so(loop):
    settings, n = LimitSettings(), 7
    arm = memory.parts(loop.controller.numbers)
    rows, bounds, ids = empty_rows(40)
    jacobian, pose = np.empty((6, n)), np.empty(7)
    position = loop.arm.home
    chain_state(*loop.arm.chain, arm.end, position, pose, jacobian)
    for axis in range(3):
        for side, wall in ((0, settings.workspace_min), (1, settings.workspace_max)):
            near = pose.copy()
            near[axis] = wall[axis] + (0.003 if side == 0 else -0.003)
            count, _ = limit_rows.limit_rows(position, near, jacobian, arm.joint_limits,
                                             numbers_of(settings), rows, bounds, ids)
            at = list(ids[:count]).index(2 * n + 2 * axis + side)
            sign = 1.0 if side else -1.0
            np.testing.assert_allclose(rows[at], sign * jacobian[axis])
            assert bounds[at] == pytest.approx(
                limit_rows.approach(0.003, 0.5 * settings.acceleration))


def test_a_stiffness_must_be_symmetric_and_positive_definite(rng):
    for _ in range(DRAWS):
        stiffness = coupled(rng)
        assert reference_check._is_positive_definite(stiffness.reshape(-1))
        values, vectors = np.linalg.eigh(stiffness)
        values[rng.integers(6)] *= -0.5
        wrong = (vectors * values) @ vectors.T
        assert not reference_check._is_positive_definite(wrong.reshape(-1))
        i, j = rng.choice(6, 2, replace=False)
        stiffness[i, j] += 0.01 * np.abs(stiffness).max()
        assert not reference_check._is_positive_definite(stiffness.reshape(-1))


def test_every_pair_that_binds_has_a_row_that_is_the_slope_of_its_distance(loop):
    arm, body = loop.arm, loop.arm.shape
    count = len(body.pairs)
    for posture in (too_near(arm), arm.home, too_near(arm) + [0.4, 0, 0, 0, 0.1, 0, 0]):
        rows, bounds, ids = empty_rows(count + 3)
        found = own_body.body_rows(*arm.chain, posture, body.capsules, body.pairs, 6.5, 0.5, 100,
                                   rows, bounds, ids, 3)
        clear = own_body.clearances(arm.chain, body, posture)
        allowed = np.array([limit_rows.approach(c - own_body.KEEP, 6.5) for c in clear])
        assert set(ids[3:found]) == set(100 + np.flatnonzero(allowed < 0.5))
        for at in range(3, found):
            pair = int(ids[at]) - 100
            assert bounds[at] == pytest.approx(allowed[pair])
            one = body._replace(pairs=body.pairs[pair:pair + 1])
            slope = approx_fprime(posture, lambda q, one=one: own_body.clearances(
                arm.chain, one, q)[0], 1e-7)
            np.testing.assert_allclose(rows[at], -slope, atol=1e-5)
    assert own_body.body_rows(*arm.chain, posture, body.capsules, np.zeros((0, 2)), 6.5, 0.5, 100,
                              rows, bounds, ids, 3) == 3


@pytest.mark.parametrize('order', [1, -1])
def test_every_volume_near_a_link_has_a_row_that_is_the_slope_of_its_distance(loop, order):
    arm = loop.arm
    posture = arm.home + [0.5, 0.2, -0.3, 0.1, 0.4, -0.2, 0.3]
    capsules = np.zeros((2, own_body.CAPSULE_SIZE))  # two links that are balls
    capsules[:, 0], capsules[:, 7], capsules[1, 1:7] = (6, 7), 0.03, [0.0, 0.0, 0.2] * 2
    links = arm.shape._replace(capsules=capsules)
    centers = own_body.placed(arm.chain, links, posture)[:, :3]
    volumes = np.array([ball(centers[0] + [0.12, 0.02, -0.03]),
                        ball(centers[1] + [-0.05, 0.15, -0.04], [0.01, -0.03, 0.0])][::order])
    rows, bounds, ids = empty_rows(surroundings.MOST_ROWS)
    count, _, clearance, nearest = surroundings.surroundings_rows(
        *arm.chain, posture, capsules, volumes, 0.01, 6.5, 5.0, 0.0, 100, rows, bounds, ids, 0)

    def distance(v, c, q):
        center = own_body.placed(arm.chain, links, q)[c, :3]
        return float(np.linalg.norm(center - volumes[v, POSE:POSE + 3]) - 0.08)
    away = np.array([[distance(v, c, posture) for c in range(2)] for v in range(2)])
    assert clearance == pytest.approx(away.min()) and nearest == away.argmin()
    assert set(ids[:count]) == {100, 101, 102, 103}
    for at in range(count):
        v, c = divmod(int(ids[at]) - 100, 2)
        slope = approx_fprime(posture, lambda q, v=v, c=c: distance(v, c, q), 1e-7)
        np.testing.assert_allclose(rows[at], -slope, atol=1e-5)
        way = centers[c] - volumes[v, POSE:POSE + 3]
        coming = max(volumes[v, TWIST:TWIST + 3] @ way / np.linalg.norm(way), 0.0)
        assert bounds[at] == pytest.approx(max(
            limit_rows.approach(away[v, c] - 0.03, 6.5) - coming, 0.0))
    # Without one near, there is no nearest one.
    volumes[:, POSE] += 10.0
    assert surroundings.surroundings_rows(
        *arm.chain, posture, capsules, volumes, 0.01, 6.5, 5.0, 0.0, 100, rows, bounds, ids,
        0)[2:] == (surroundings.SEEN_FROM, -1)


def limited(loop, posture, twist):
    """Which limit a twist meets in a posture, what is left of the twist, and the violations."""
    arm, numbers = memory.parts(loop.controller.numbers), loop.controller.numbers
    jacobian, violation = np.empty((6, 7)), np.zeros(len(LIMITS))
    arm.governed[:], arm.posture[:], arm.governed_rate[:] = posture, posture, 0.0
    chain_state(*loop.arm.chain, arm.end, arm.governed, arm.reference[:7], jacobian)
    made = np.array(twist, dtype=float)
    blocking, _ = governor._move_joints(numbers, jacobian, made, violation)
    return int(blocking), made, violation


def test_a_singular_direction_is_named_with_how_near_it_is(loop):
    settings, direction = LimitSettings(), np.empty(6)
    for bend in (-0.9, -0.7, -0.4):
        posture = np.array([0.0, 0.5, 0.0, bend, 0.0, 1.5, 0.785])
        jacobian = np.empty((6, 7))
        chain_state(*loop.arm.chain, loop.arm.end_pose, posture, np.empty(7), jacobian)
        value = singular_value(jacobian, direction)
        assert value < settings.singularity_start
        # The direction in which the arm cannot move, towards the singularity.
        blocking, _, violation = next(
            found for found in (limited(loop, posture, 0.3 * sign * direction)
                                for sign in (1.0, -1.0)) if found[2][SINGULARITY] > 0.0)
        assert blocking == 2 * 7 + 6
        assert violation[SINGULARITY] == pytest.approx(min(
            (settings.singularity_start - value)
            / (settings.singularity_start - settings.singularity_stop), 1.0))


def pair_of(loop, blocking):
    """The volume and link that a limit is, or is not (negative)."""
    return blocking - 2 * 7 - limit_rows.OTHER_ROWS - len(loop.arm.shape.pairs)


def test_a_volume_that_holds_the_tool_is_named(loop):
    arm = memory.parts(loop.controller.numbers)
    arm.volumes[:] = 0.0
    arm.volumes[2] = ball_below(loop.arm, loop.arm.home, MARGIN + surroundings.SLACK)
    blocking, made, _ = limited(loop, loop.arm.home, [0.0, 0.0, -0.2, 0.0, 0.0, 0.0])
    at = pair_of(loop, blocking)
    assert at == arm.scalars.nearest and at // len(arm.capsules) == 2 and made[2] > -0.1


def test_a_free_reference_has_the_velocity_that_is_asked(loop):
    settings, twist = LimitSettings(), [0.0, 0.4, 0.0, 0.0, 0.0, 0.0]
    assert settings.catch_up_speed < 0.4 < settings.speed
    blocking, made, _ = limited(loop, loop.arm.home, twist)
    assert blocking == -1
    np.testing.assert_allclose(made, twist, atol=1e-3)


@pytest.mark.parametrize('retreat', [0.0, 0.2])
def test_what_comes_nearer_is_named_by_its_volume_and_link(retreat):
    loop = ClosedLoop(Arm(), ControllerSettings(limits=LimitSettings(retreat_speed=retreat)))
    loop.tick()
    arm = memory.parts(loop.controller.numbers)
    hand = own_body.placed(loop.arm.chain, loop.arm.shape, loop.arm.home)[-1]
    arm.volumes[:], arm.scalars.left = 0.0, 0.0
    arm.volumes[:2] = [ball(hand[:3] + [away, 0.0, 0.0]) for away in (3.0, 0.2)]
    blocking, made, _ = limited(loop, loop.arm.home, [0.0, 0.2, 0.0, 0.0, 0.0, 0.0])
    if retreat:
        assert arm.scalars.slowed == 1.0
        return
    assert arm.scalars.slowed == 0.0 and not made.any()
    at = pair_of(loop, blocking)
    assert at == arm.scalars.nearest and at // len(arm.capsules) == 1


def test_a_pair_of_parts_that_holds_the_joints_is_named(loop):
    numbers, n = loop.controller.numbers, 7
    arm, shape = memory.parts(numbers), loop.arm.shape
    folded = too_near(loop.arm)
    clear = own_body.clearances(loop.arm.chain, shape, folded)
    pair = int(clear.argmin())
    one = shape._replace(pairs=shape.pairs[pair:pair + 1])
    nearer = -approx_fprime(folded, lambda q: own_body.clearances(loop.arm.chain, one, q)[0], 1e-7)
    nearer /= np.linalg.norm(nearer)
    arm.joint_reference[:n], arm.joint_target[:n] = folded, folded + 0.3 * nearer
    for _ in range(300):
        asked = 0.2 * nearer
        governor.keep_joints_inside(numbers, asked, asked.copy())
    named = int(arm.scalars.blocking) - 2 * n - limit_rows.OTHER_ROWS
    assert 0 <= named < len(shape.pairs) and clear[named] < own_body.KEEP


def test_a_motion_of_the_joints_may_come_a_millimetre_nearer(loop):
    numbers = loop.controller.numbers
    arm, jacobian = memory.parts(numbers), np.empty((6, 7))
    chain_state(*loop.arm.chain, arm.end, arm.position, np.empty(7), jacobian)
    down = np.linalg.lstsq(jacobian, np.array([0.0, 0.0, -0.05, 0.0, 0.0, 0.0]))[0]
    arm.volumes[:] = 0.0
    for inside, free in ((0.0005, True), (0.0015, False)):
        arm.volumes[0] = ball_below(loop.arm, arm.position, MARGIN - inside)
        assert (governor.share_of_way(numbers, down) > 0.0) == free
