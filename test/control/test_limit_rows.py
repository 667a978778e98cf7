"""Rows of the limits: where they are, and that what blocks is named."""
import math

import numpy as np
import pytest

from experiments.control_limits import diagonal, go, make
from gdmp_ros.control.limit_rows import approach, limit_rows, OTHER_ROWS, row_name
from gdmp_ros.control.settings import LimitSettings
from gdmp_ros.control.singularity import ROTATION_LENGTH
from gdmp_ros.control.target import resting_target
from gdmp_ros.manifolds.quaternion import rotate_by_vector
from gdmp_ros.sim.arm import Arm
from gdmp_ros.util.settings import numbers

SETTINGS = LimitSettings()


def rows_at(arm, position, settings=SETTINGS):
    """Rows, bounds and names at a posture, for every limit that may bind."""
    n = len(position)
    arm.reset(position)
    measured = arm.measure()
    rows, bounds = np.zeros((2 * n + OTHER_ROWS, n)), np.zeros(2 * n + OTHER_ROWS)
    ids = np.zeros(2 * n + OTHER_ROWS)
    joints = np.array([arm.limits.lower, arm.limits.upper, arm.limits.speed, *np.zeros((2, 7))])
    count, _ = limit_rows(position, measured.pose[:3], measured.jacobian, joints,
                          numbers(settings), rows, bounds, ids)
    return rows[:count], bounds[:count], [row_name(int(each), n, ()) for each in ids[:count]]


def test_far_from_all_limits_there_are_no_rows():
    arm = Arm()
    position = arm.home.copy()
    position[3] = -1.7
    assert rows_at(arm, position)[2] == []


def test_a_joint_near_its_limit_and_a_wall_have_rows():
    arm = Arm()
    position, settings = arm.home.copy(), SETTINGS
    position[3] = arm.limits.lower[3] + settings.joint_margin + 0.01
    settings = LimitSettings(workspace_min=(-1.0, -1.0, arm.pose_at(position)[2] - 0.01))
    rows, bounds, names = rows_at(arm, position, settings)
    assert names == ['joint 4 at its lower limit', 'the lower wall of the workspace in z']
    np.testing.assert_array_equal(rows[0], -np.eye(7)[3])
    np.testing.assert_allclose(rows[1], -arm.measure().jacobian[2])
    assert bounds[0] == pytest.approx(np.sqrt(settings.joint_acceleration * 0.01))
    assert bounds[1] == pytest.approx(np.sqrt(settings.acceleration * 0.01))


def test_the_singular_direction_has_a_row(rng):
    arm = Arm()
    position = arm.home.copy()
    position[3] = arm.limits.upper[3] - 0.05  # nearly stretched

    def value(q):
        arm.reset(q)
        jacobian = arm.measure().jacobian.copy()
        jacobian[3:] *= ROTATION_LENGTH
        return np.linalg.svd(jacobian, compute_uv=False)[-1]

    rows, bounds, names = rows_at(arm, position)
    row = rows[names.index('a singularity')]
    slope = [(value(position + step) - value(position - step)) / 2e-6
             for step in 1e-6 * np.eye(7)]
    np.testing.assert_allclose(row, -np.array(slope), atol=1e-6)


def test_a_bound_allows_to_stop_and_is_never_negative():
    assert approach(-0.1, 5.0) == approach(0.0, 5.0) == 0.0
    for dt in (0.001, 0.005):
        distance = 0.3
        for _ in range(round(3.0 / dt)):
            distance -= dt * approach(distance, 5.0)
            assert distance >= -1e-12
        assert distance < 1e-3


def test_what_blocks_is_named_within_a_second_and_not_on_the_way_back():
    loop = make('clean')
    home = loop.arm.measure().pose.copy()
    near, far = home.copy(), home.copy()
    rotate_by_vector(home[3:].copy(), np.array([0.0, -1.6, 0.0]), near[3:])  # by joint 4
    far[:2] += 0.5
    for pose, row in ((near, 'joint 4 at its lower limit'), (far, 'a singularity')):
        target, seen, blocked_from = resting_target(pose), set(), None
        for k in range(5000):
            loop.must_follow(target)
            loop.tick()
            away = np.linalg.norm(loop.controller.reference[7:13])
            if k < 500 or away >= 0.01:
                blocked_from = None  # a reference may rest for a moment, and slide on
            elif blocked_from is None:
                blocked_from = k
            if loop.controller.blocked:
                seen.add(loop.controller.blocked)
                break
        assert seen == {row} and (blocked_from is None or k - blocked_from < 1000)
        time, named = go(loop, home, 8.0)
        assert math.isfinite(time) and named > 0.25


def test_what_holds_the_tool_is_named_and_the_reference_waits_for_it():
    loop = make('clean')
    home, furthest = loop.arm.measure().pose.copy(), 0.0
    far = home.copy()
    far[1] += 0.4
    for _ in range(4000):
        loop.must_follow(resting_target(far, diagonal(400.0)))
        tick = loop.tick()
        stuck = 5000.0 * (home[:3] - tick.measurement.pose[:3]) - 100.0 * tick.twist[:3]
        loop.arm.push(np.concatenate([stuck, np.zeros(3)]))
        furthest = max(furthest, float(np.linalg.norm(loop.controller.reference[:3] - home[:3])))
        if loop.controller.blocked:
            break
    assert loop.controller.blocked == 'what holds the tool'
    assert furthest < 0.2


def test_an_arm_that_leans_on_itself_goes_home():
    """Its tool moves away from the reference at first."""
    loop = make('clean')
    home = loop.arm.measure().pose.copy()
    posture = np.array([0.317, 1.447, -0.318, -2.354, -1.062, 0.62, -0.854])
    leaning = loop.arm.chain.pose_at(posture, loop.arm.end_pose)
    assert not math.isfinite(go(loop, leaning, 10.0)[0])
    assert math.isfinite(go(loop, home, 15.0)[0])
