"""Rows of the limits: where they are, and that they keep the joints while the arm slides."""
import numpy as np
import pytest

from gdmp_ros.control.limit_rows import approach, limit_rows, OTHER_ROWS, row_name
from gdmp_ros.control.settings import GuardSettings, LimitSettings
from gdmp_ros.control.singularity import ROTATION_LENGTH
from gdmp_ros.control.target import resting_target
from gdmp_ros.manifolds.quaternion import pose_distance
from gdmp_ros.sim.arm import Arm
from gdmp_ros.util.settings import numbers
from test.control.plants import CLEAN, on_plants

ANYWHERE = GuardSettings(jump_position=10.0, jump_rotation=10.0, arming_position=10.0,
                         arming_rotation=10.0, arming_speed=100.0, arming_angular_speed=100.0)
SETTINGS = LimitSettings()


def rows_at(arm, position, settings=SETTINGS):
    """Rows, bounds and names at a posture, for every limit that may bind."""
    n = len(position)
    arm.reset(position)
    measured = arm.measure()
    rows, bounds = np.zeros((2 * n + OTHER_ROWS, n)), np.zeros(2 * n + OTHER_ROWS)
    ids = np.zeros(2 * n + OTHER_ROWS)
    joints = np.array([arm.limits.lower, arm.limits.upper, arm.limits.speed])
    count, _ = limit_rows(position, measured.pose[:3], measured.jacobian, joints,
                          numbers(settings), rows, bounds, ids)
    return rows[:count], bounds[:count], [row_name(int(each), n) for each in ids[:count]]


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


def quintic(s):
    """Part of a way, and its rate."""
    return (s ** 3 * (10.0 - s * (15.0 - 6.0 * s)), 30.0 * s ** 2 * (1.0 - s) ** 2)


def towards(loop, goal, seconds, stiffness, after):
    """Follow a straight way to a goal without the stops of the joints, and stay there."""
    loop.arm.model.jnt_limited[:] = 0
    pose = loop.arm.measure().pose
    start, way = pose[:3].copy(), goal - pose[:3]
    target = resting_target(pose, np.diag([stiffness] * 3 + [stiffness / 20.0] * 3))
    ticks, followed = [], []
    for k in range(round(1000 * (seconds + after))):
        part, rate = quintic(min(k / (1000.0 * seconds), 1.0))
        given = target.copy()
        given[:3], given[7:10] = start + part * way, rate / seconds * way
        assert loop.follow(given), loop.controller.guard.last_refusal
        ticks.append(loop.tick())
        followed.append(loop.controller.reference[:3])
    return ticks, np.array(followed)


#: Height of the lowest wall, above the floor: the controller has to keep it alone [m].
WALL = 0.05
#: References that a wall pushes into the limit of joint 4, and that are too close for it.
WAYS = [((-0.2, 0.0, -0.5), 6.0), ((-0.25, 0.0, -0.45), 3.0), ((0.15, 0.0, 0.05), 2.2),
        ((0.15, 0.0, 0.05), 0.6)]


@on_plants('clean', 'real')
@pytest.mark.parametrize('stiffness', [
    400.0, pytest.param(2000.0, marks=pytest.mark.long)])
@pytest.mark.parametrize('goal, seconds', WAYS)
def test_joints_stay_in_their_range_and_the_tool_above_the_wall(goal, seconds, stiffness, plant):
    loop = plant.loop(guard=ANYWHERE, limits=LimitSettings(workspace_min=(-1.0, -1.0, WALL)))
    loop.controller.guard.arm()
    ticks, followed = towards(loop, np.array(goal), seconds, stiffness, 2.0)
    q = np.array([tick.measurement.position for tick in ticks])
    beyond = np.maximum(loop.joints.lower - q, q - loop.joints.upper)
    assert beyond.max() <= 0.01
    assert followed[:, 2].min() >= WALL - 0.001
    tool = np.array([tick.measurement.pose[2] for tick in ticks])
    assert tool.min() >= WALL - (0.003 + (5.0 + plant.weight) / stiffness)


def go(loop, pose, seconds):
    """Ask for a pose, and wait; whether it was reached, and what kept the reference from it."""
    target, blocked = resting_target(pose, np.diag([800.0] * 3 + [40.0] * 3)), []
    for _ in range(round(2 * seconds)):
        loop.follow_all(np.tile(target, (500, 1)))
        blocked.append(loop.controller.blocked)
        away = pose_distance(loop.controller.reference[:7], pose)
        if away[0] < 0.002 and away[1] < 0.01:
            return True, blocked
    return False, blocked


def postures(arm, rng, count, spread):
    """Postures with the tool in the workspace."""
    found = []
    while len(found) < count:
        low, high = arm.limits.lower + 0.06, arm.limits.upper - 0.06
        posture = (np.clip(arm.home + rng.uniform(-spread, spread, len(low)), low, high)
                   if spread else rng.uniform(low, high))
        place = arm.chain.pose_at(posture, arm.end_pose)[:3]
        if place[2] > 0.02 and np.abs(place).max() < 0.99:
            found.append(posture)
    return found


@pytest.mark.parametrize('spread, count', [
    (0.8, 10), pytest.param(0.0, 40, marks=pytest.mark.long)])
def test_targets_are_reached_or_the_limit_is_named_and_the_way_home_is_open(spread, count, rng):
    loop = CLEAN.loop(guard=ANYWHERE)
    home = loop.arm.measure().pose.copy()
    reached = 0
    for posture in postures(loop.arm, rng, count, spread):
        loop.reset()
        loop.controller.guard.arm()
        pose = loop.arm.chain.pose_at(posture, loop.arm.end_pose)
        there, blocked = go(loop, pose, 10.0)
        reached += there
        assert there or any(blocked), 'off its target, and nothing is named'
        assert go(loop, home, 20.0)[0]
    assert reached == count if spread else reached >= 0.8 * count


def test_what_blocks_is_named_within_a_second_and_not_on_the_way_back():
    loop = CLEAN.loop(guard=ANYWHERE)
    home = loop.arm.measure().pose.copy()
    loop.controller.guard.arm()
    near, far = home.copy(), home.copy()
    near[[0, 2]] -= 0.3  # too close for joint 4
    far[:2] += 0.5
    for pose, seconds, row in ((near, 3.0, 'joint 4 at its lower limit'),
                               (far, 4.0, 'a singularity')):
        there, blocked = go(loop, pose, seconds)
        assert not there and row in blocked
        back, blocked = go(loop, home, 8.0)
        assert back and not any(blocked[1:])
