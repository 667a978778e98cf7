"""What is around the arm: rows as derivatives of distances, the barrier, and what they do."""
import numpy as np
import pytest

from experiments.control_limits import ANYWHERE
from experiments.obstacles import arm_trial, at_rest, follow, stream
from gdmp_ros import DataError
from gdmp_ros.control.arm_states import Request
from gdmp_ros.control.joint_motion import PostureMotion
from gdmp_ros.control.limit_rows import approach
from gdmp_ros.control.settings import ControllerSettings, LimitSettings
from gdmp_ros.control.surroundings import (
    depths,
    LAST_SEEN_S,
    MOST_ROWS,
    push_away,
    SLACK,
    surroundings_rows,
)
from gdmp_ros.errors import ParameterError
from gdmp_ros.manifolds.poses import compose
from gdmp_ros.manifolds.quaternion import rotate_by_vector
from gdmp_ros.scene import Scene, Volume
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.closed_loop import ClosedLoop
from gdmp_ros.util.profiles import minimum_jerk

MARGIN = 0.02


def volume(place, kind='box', size=(0.1, 0.2, 0.15), **others):
    return Volume('thing', kind, size, np.array([*place, 0.8, 0.3, -0.4, 0.332]) / np.array(
        [1, 1, 1, *[np.linalg.norm([0.8, 0.3, -0.4, 0.332])] * 4]), **others)


def found_rows(arm, posture, rows_of, retreat=0.0):
    n = len(posture)
    rows, bounds, ids = np.zeros((MOST_ROWS, n)), np.zeros(MOST_ROWS), np.zeros(MOST_ROWS)
    count, share, clearance, nearest = surroundings_rows(
        *arm.chain, posture, arm.shape.capsules, rows_of, SLACK, 5.0, 100.0, retreat, 0, rows,
        bounds, ids, 0)
    return rows[:count], bounds[:count], ids[:count].astype(int), share, clearance, nearest


@pytest.mark.parametrize(('kind', 'size'), [('sphere', (0.1,)), ('capsule', (0.05, 0.3)),
                                            ('box', (0.1, 0.2, 0.3))])
def test_a_row_is_the_derivative_of_the_distance(kind, size, rng):
    arm, h, checked = Arm(), 1e-6, 0
    for _ in range(20):
        posture = rng.uniform(arm.limits.lower, arm.limits.upper)
        packed = Scene([volume(rng.uniform(-0.6, 0.6, 3), kind, size)], MARGIN).packed()
        before = depths(arm.chain, arm.shape, posture, packed)[0]
        rows, bounds, ids, *_ = found_rows(arm, posture, packed)
        for link in set(ids.tolist()):
            own = rows[ids == link]
            bound = approach(-before[link] - SLACK, 5.0)
            k = int(np.argmin(np.abs(bounds[ids == link] - bound)))
            if before[link] > MARGIN:  # it runs through the volume
                continue
            assert bounds[ids == link].min() == pytest.approx(bound, abs=1e-9)
            for j in range(len(posture)):
                moved = posture.copy()
                moved[j] += h
                rate = (depths(arm.chain, arm.shape, moved, packed)[0, link] - before[link]) / h
                moved[j] -= 2.0 * h
                back = (before[link] - depths(arm.chain, arm.shape, moved, packed)[0, link]) / h
                assert min(rate, back) - 1e-4 <= own[k, j] <= max(rate, back) + 1e-4
                checked += 1
    assert checked > 100


def test_what_may_touch_and_what_comes(rng):
    arm = Arm()
    place = arm.pose_at(arm.home)[:3] + [0.0, 0.2, 0.0]
    thing = volume(place, 'sphere', (0.03,))
    still = found_rows(arm, arm.home, Scene([thing], MARGIN).packed(arm.shape.bits))
    assert still[3] == 1.0 and 0.0 < still[4] < 0.2
    links = [arm.shape.links[k] for k in still[2]]
    assert 'hand' in links
    may = volume(place, 'sphere', (0.03,), allowed=tuple(dict.fromkeys(links)))
    assert len(found_rows(arm, arm.home, Scene([may], MARGIN).packed(arm.shape.bits))[0]) == 0
    with pytest.raises(DataError, match="no link 'wheel'"):
        Scene([volume(place, allowed=('wheel',))]).packed(arm.shape.bits)
    comes = thing.at(thing.pose, np.array([0.0, -0.3, 0.0, 0.0, 0.0, 0.0]))
    packed = Scene([comes], MARGIN).packed(arm.shape.bits)
    rows, bounds, ids, share, *_ = found_rows(arm, arm.home, packed)
    # The arm is slowed down; it may stand, but need not go away.
    assert share < 0.7 and bounds.min() >= 0.0
    near = comes.at(comes.pose - [0.0, 0.12, 0.0, 0.0, 0.0, 0.0, 0.0], comes.twist)
    packed = Scene([near], MARGIN).packed(arm.shape.bits)
    assert found_rows(arm, arm.home, packed)[3] == 0.0
    assert found_rows(arm, arm.home, packed, 0.2)[1].min() < -0.1


def test_a_volume_that_turns_comes_as_fast_as_the_distance_shrinks(rng):
    arm, step, checked = Arm(), 1e-5, 0
    bar = volume(arm.pose_at(arm.home)[:3] + [0.0, 0.15, 0.05], 'box', (0.5, 0.04, 0.06))

    def packed(twist, seconds=0.0):
        pose = bar.pose.copy()
        pose[:3] += seconds * twist[:3]
        rotate_by_vector(pose[3:], seconds * twist[3:], pose[3:])
        return Scene([bar.at(pose, twist)], 0.5).packed(arm.shape.bits)
    still, bounds, links, *_ = found_rows(arm, arm.home, packed(np.zeros(6)), 10.0)
    for twist in rng.uniform(-0.3, 0.3, (30, 6)):
        before, after = (depths(arm.chain, arm.shape, arm.home, packed(twist, seconds))[0]
                         for seconds in (-step, step))
        rows, moving, *_ = found_rows(arm, arm.home, packed(twist), 10.0)
        for link in set(links):
            # Of the places of a link, the nearest one.
            nearest = min(np.flatnonzero(links == link), key=lambda k: bounds[k])
            same = np.flatnonzero((rows == still[nearest]).all(axis=1))
            if len(same):
                shrinks = (after[link] - before[link]) / (2.0 * step)
                assert bounds[nearest] - moving[same[0]] == pytest.approx(max(shrinks, 0.0),
                                                                          abs=1e-3)
                checked += shrinks > 0.0
    assert checked > 50


def test_only_what_the_arm_does_pushes_it_back():
    """A volume that comes nearer, or was put there, does not."""
    arm, n = Arm(), 7
    place = arm.pose_at(arm.home)[:3] + [0.0, 0.15, 0.0]
    packed = Scene([volume(place, 'sphere', (0.02,))], 0.06).packed(arm.shape.bits)
    deep = np.maximum(depths(arm.chain, arm.shape, arm.home, packed) + SLACK, 0.0)
    assert deep.max() > 0.005

    def push(posture, relief):
        torque = np.zeros(n)
        push_away(*arm.chain, posture, np.zeros(n), arm.shape.capsules, packed, 1e-3, relief,
                  torque)
        return torque
    assert not push(arm.home, deep.copy()).any()
    torque = push(arm.home, np.zeros_like(deep))
    assert np.abs(torque).max() > 1.0
    away = arm.home + 1e-3 * torque / np.linalg.norm(torque)
    assert depths(arm.chain, arm.shape, away, packed).max() < deep.max() - SLACK
    packed[0, 12] = -0.2  # it comes
    assert not push(arm.home, deep - 2e-5).any()


@pytest.mark.parametrize('speed', [0.0, 0.25], ids=['standing', 'coming'])
def test_nothing_near_elbow_or_wrist_is_touched_by_the_arm(speed):
    """More of them: `python -m experiments obstacles standing coming`."""
    rng = np.random.default_rng(5)
    trials = [arm_trial(rng, speed) for _ in range(4)]
    for trial in trials:
        assert max(trial.contacts, default=0.0) <= 0.02
        assert speed or (trial.contacts == () and trial.least > 0.03)
    # Links slide along what is there; in a trap they stand.
    assert speed or sum(trial.off < 0.01 for trial in trials) >= 3


def test_a_soft_arm_stands_before_what_comes_touches_it():
    """Its reference stands in time; without a brake the links go on, with 0.05 m/s."""
    rng = np.random.default_rng(list(b'coming'))
    trial = arm_trial(rng, float(rng.uniform(0.05, 0.3)))
    assert trial.contacts and max(trial.contacts) < 0.02


def test_an_arm_at_rest_stays_as_it_is_beside_something(rng):
    assert all(one.holds for one in at_rest(rng, 2))


def blocked_loop(retreat=0.0):
    """An arm whose tool is led against a wall."""
    loop = ClosedLoop(Arm(), ControllerSettings(
        guard=ANYWHERE, limits=LimitSettings(retreat_speed=retreat)))
    loop.controller.guard.arm()
    return loop


def test_what_blocks_is_named_and_it_goes_on_when_that_is_gone():
    loop = blocked_loop()
    arm, home = Arm(), loop.arm.measure().pose
    wall = Volume('wall', 'box', (0.6, 0.04, 1.4), np.array(
        [home[0], 0.25, 0.7, 1.0, 0.0, 0.0, 0.0]))
    loop.controller.surround(Scene([wall], MARGIN))
    shares = minimum_jerk(np.linspace(0.0, 1.0, 2000))
    there = arm.home.copy()
    there[0] += 1.0
    references = stream(arm, arm.home + shares[:, None] * (there - arm.home), 800.0)
    for reference in [*references, *references[-1:].repeat(1200, axis=0)]:
        loop.must_follow(reference)
        loop.tick()
    packed = Scene([wall], MARGIN).packed()
    assert depths(arm.chain, arm.shape, loop.arm.data.qpos.copy(), packed).max() < 0.0
    assert 'wall (' in loop.controller.blocked and 'is near it' in loop.controller.blocked
    distance, names = loop.controller.clearance
    assert distance == pytest.approx(MARGIN + SLACK, abs=0.002) and names.endswith('and wall')
    loop.controller.surround(Scene())
    for _ in range(3000):
        loop.must_follow(references[-1])
        loop.tick()
    assert np.linalg.norm(loop.arm.measure().pose[:3] - references[-1, :3]) < 0.005
    assert loop.controller.blocked == '' and loop.controller.clearance == (np.inf, '')


def test_it_goes_away_from_what_comes_if_it_may():
    arm = Arm()
    references = stream(arm, np.tile(arm.home, (3500, 1)), 800.0)
    start = arm.pose_at(arm.home)
    ball = Volume('ball', 'sphere', (0.05,), np.concatenate(
        [start[:3] + [0.0, 0.4, 0.0], [1.0, 0.0, 0.0, 0.0]]), np.array([0.0, -0.1, 0.0, 0, 0, 0]))
    assert follow(references, ball, 0.0).contacts
    assert follow(references, ball, 0.3).contacts == ()


def test_what_is_not_seen_again_stands_where_it_was():
    loop = blocked_loop()
    start = loop.arm.measure().pose
    far = start[:3] + [0.0, 0.8, 0.0]
    ball = Volume('ball', 'sphere', (0.05,), np.concatenate([far, [1.0, 0.0, 0.0, 0.0]]),
                  np.array([0.1, -0.4, 0.05, 0.3, -0.2, 0.5]))
    loop.controller.surround(Scene([ball], MARGIN))
    for _ in range(1000):
        loop.tick()
    row = loop.controller.memory.volumes[0]
    turned = ball.pose[3:].copy()
    rotate_by_vector(turned, LAST_SEEN_S * ball.twist[3:], turned)
    assert row[4:7] == pytest.approx(far + LAST_SEEN_S * ball.twist[:3], abs=2e-3)
    assert row[7:11] == pytest.approx(turned, abs=2e-3)
    assert not row[11:17].any() and loop.controller.scale == 1.0


def led_down(loop, distance, seconds=2.0):
    """Lead the tool of a loop down; how far it came [m]."""
    start = loop.arm.measure().pose
    arm, shares = Arm(), minimum_jerk(np.linspace(0.0, 1.0, round(1000 * seconds)))
    low = np.concatenate([start[:3] - [0.0, 0.0, distance], start[3:]])
    there = arm.chain.near(low, arm.home, arm.end_pose)
    references = stream(arm, arm.home + shares[:, None] * (there - arm.home), 800.0)
    for reference in [*references, *references[-1:].repeat(600, axis=0)]:
        loop.must_follow(reference)
        loop.tick()
    return start[2] - loop.arm.measure().pose[2]


@pytest.mark.parametrize('allowed', [(), ('carried',)], ids=['kept away', 'allowed'])
def test_what_the_arm_carries_keeps_its_distance_too(allowed):
    loop = blocked_loop()
    start = loop.arm.measure().pose
    # A stick hangs 0.15 m below the tool point: its axis is the tool's, which points down.
    stick = Volume('stick', 'capsule', (0.01, 0.28), np.array(
        [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]), carried=True)
    floor = Volume('floor', 'plane', (), np.array([0, 0, start[2] - 0.25, 1.0, 0.0, 0.0, 0.0]),
                   allowed=allowed)
    loop.controller.surround(Scene([stick, floor], MARGIN))
    came = led_down(loop, 0.15)
    # 0.25 m of room, less half of the stick, its radius, and margin and slack.
    assert came == pytest.approx(0.15 if allowed else 0.25 - 0.14 - 0.01 - MARGIN - SLACK,
                                 abs=0.004)
    assert allowed or loop.controller.blocked == 'floor (carried is near it)'


def test_what_is_let_go_acts_no_more_and_too_much_is_refused():
    loop = blocked_loop()
    start = loop.arm.measure().pose
    still = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    floor = Volume('floor', 'plane', (), np.array([0, 0, start[2] - 0.25, 1.0, 0.0, 0.0, 0.0]))
    loop.controller.surround(Scene([floor, Volume('stick', 'capsule', (0.01, 0.28), still,
                                                  carried=True)], MARGIN))
    loop.tick()
    loop.controller.surround(Scene([floor], MARGIN))
    assert led_down(loop, 0.15) == pytest.approx(0.15, abs=0.002)
    plates = [Volume(f'plate{k}', 'box', (0.3, 0.2, 0.01), still, carried=True) for k in range(3)]
    with pytest.raises(DataError, match='takes 12 capsules, expected at most 8'):
        loop.controller.surround(Scene(plates, MARGIN))


def test_capsules_hold_what_is_carried(rng):
    for kind, size in (('sphere', (0.05,)), ('capsule', (0.02, 0.2)), ('box', (0.05, 0.05, 0.05)),
                       ('box', (0.3, 0.2, 0.01)), ('box', (0.02, 0.3, 0.04))):
        made = volume(rng.uniform(-0.2, 0.2, 3), kind, size)
        ends = np.array([-1.0, 1.0])
        grid = np.stack(np.meshgrid(*(half * ends for half in made.half)), axis=-1).reshape(-1, 3)
        corners = np.array([compose(made.pose, np.array([*corner, 1.0, 0.0, 0.0, 0.0]))[:3]
                            for corner in grid])
        left = np.full(len(corners), np.inf)
        for row in made.capsules:
            along = row[3:6] - row[:3]
            share = np.clip((corners - row[:3]) @ along / max(along @ along, 1e-12), 0.0, 1.0)
            left = np.minimum(left, np.linalg.norm(
                corners - row[:3] - share[:, None] * along, axis=1) - row[6])
        assert left.max() <= 1e-9 - made.radius
    # A plate is held by flat strips, not by a thick ball.
    assert volume([0, 0, 0], 'box', (0.3, 0.2, 0.01)).capsules[:, 6].max() < 0.03


def test_an_arm_that_is_held_back_stands_says_why_and_goes_on():
    loop = blocked_loop()
    start = loop.arm.measure().pose
    path = []
    shares = minimum_jerk(np.linspace(0.0, 1.0, 2000))
    references = stream(Arm(), np.tile(Arm().home, (2000, 1)), 800.0)
    references[:, 1] += 0.3 * shares
    for k, reference in enumerate([*references, *references[-1:].repeat(4000, axis=0)]):
        if k == 1000:
            loop.controller.hold_back('the cloud is old')
        if k == 3500:
            held = loop.arm.measure().pose[1] - start[1]
            assert loop.controller.blocked == 'the cloud is old' and loop.controller.scale == 0.0
            loop.controller.hold_back('')
        if k == 2000:
            stands = loop.arm.measure().pose[1] - start[1]
        loop.must_follow(reference)
        loop.tick()
        path.append(loop.controller.reference[:3].copy())
    accelerations = np.diff(path, 2, axis=0) / 1e-6
    assert held == pytest.approx(stands, abs=1e-3) and 0.1 < held < 0.25
    assert loop.arm.measure().pose[1] - start[1] == pytest.approx(0.3, abs=0.005)
    assert np.linalg.norm(accelerations, axis=1).max() < 15.0 and loop.controller.scale == 1.0


def test_joints_do_not_begin_to_move_while_the_arm_is_held_back():
    loop = blocked_loop()
    loop.controller.check_way(Arm().home[None])
    loop.controller.hold_back('the last cloud of points is 2.0 s old')
    with pytest.raises(ParameterError, match='2.0 s old'):
        loop.controller.check_way(Arm().home[None])


def test_a_motion_of_the_joints_waits_while_the_arm_is_held_back():
    loop = blocked_loop()
    away = Arm().home + [0.4, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    loop.move(PostureMotion(loop.joints, away[None], 0.5))
    for _ in range(500):
        loop.tick()
    loop.controller.hold_back('the cloud is old')
    for _ in range(600):
        loop.tick()
    stands = loop.arm.data.qpos.copy()
    for _ in range(1000):
        loop.tick()
    assert np.abs(loop.arm.data.qpos - stands).max() < 1e-3 and loop.moves_joints
    assert 0.05 < stands[0] - Arm().home[0] < 0.35
    loop.controller.hold_back('')
    for _ in range(2000):
        loop.tick()
    assert not loop.moves_joints and not loop.joint_motion_problem
    np.testing.assert_allclose(loop.arm.data.qpos, away, atol=5e-3)


def held_in_motion():
    """An arm that waits on its way."""
    loop = blocked_loop()
    loop.move(PostureMotion(loop.joints, (Arm().home + 0.6 * np.eye(7)[0])[None], 0.5))
    for k in range(1500):
        if k == 700:
            loop.controller.hold_back('the cloud is old')
        loop.tick()
    assert np.abs(loop.arm.data.qvel).max() < 1e-2
    assert loop.controller.scale == 0.0 and loop.controller.blocked == 'the cloud is old'
    return loop


def test_a_motion_of_the_joints_that_waits_is_stopped_where_it_is():
    loop = held_in_motion()
    stands = loop.arm.data.qpos.copy()
    loop.do(Request.STOP)
    for _ in range(1000):
        loop.tick()
    assert not loop.moves_joints and np.abs(loop.arm.data.qpos - stands).max() < 2e-3


def test_a_motion_of_the_joints_that_waits_for_too_long_is_ended_with_the_reason():
    loop = held_in_motion()
    for _ in range(11_000):
        loop.tick()
    assert not loop.moves_joints
    assert loop.joint_motion_problem == 'it waited 10 s for the cloud is old'


def test_a_way_that_is_accepted_is_gone():
    loop = blocked_loop()
    away = Arm().home + 0.5 * np.eye(7)[0]
    # Beside the way: nearer than the reference of a stream would come, not nearer than the margin.
    ends = np.array([Arm().pose_at(Arm().home + share * (away - Arm().home))[:3]
                     for share in np.linspace(0.0, 1.0, 20)])
    for gap in np.linspace(0.02, 0.3, 57):
        ball = Volume('ball', 'sphere', (0.03,), np.array([
            *ends[-1] + [0.0, 0.05 + gap, 0.0], 1.0, 0.0, 0.0, 0.0]))
        loop.controller.surround(Scene([ball], MARGIN))
        try:
            loop.controller.check_way(away[None])
        except ParameterError:
            continue
        break
    loop.move(PostureMotion(loop.joints, away[None], 0.5))
    for _ in range(8000):
        loop.tick()
    assert not loop.moves_joints and not loop.joint_motion_problem
    assert np.abs(loop.arm.data.qpos - away).max() < 0.03


def test_a_motion_of_the_joints_waits_for_what_comes_near_and_goes_on():
    loop = blocked_loop()
    home, away = Arm().home, Arm().home + [0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    # Something comes to the hand from the side to which it goes.
    place = np.array([*Arm().pose_at(home)[:3] + [0.0, 0.42, 0.0], 1.0, 0.0, 0.0, 0.0])
    loop.move(PostureMotion(loop.joints, away[None], 0.5))
    most = 0.0
    for k in range(6000):
        if k % 50 == 0:
            comes = k < 1000
            gone = k >= 3000
            ball = Volume('ball', 'sphere', (0.1,), place + (5.0 * gone) * np.eye(7)[2], np.array(
                [0.0, -0.15 * comes, 0.0, 0.0, 0.0, 0.0]))
            loop.controller.surround(Scene([ball], MARGIN))
        place[1] -= 1e-3 * 0.15 * (k < 1000)
        loop.tick()
        if 2000 < k < 3000:
            most = max(most, float(np.abs(loop.arm.data.qvel).max()))
            assert loop.controller.clearance[0] > 0.5 * MARGIN
    assert most < 0.03 and not loop.joint_motion_problem
    np.testing.assert_allclose(loop.arm.data.qpos, away, atol=5e-3)


def test_a_scene_that_becomes_smaller_leaves_no_wrong_name():
    loop = blocked_loop()
    start = loop.arm.measure().pose[:3]
    things = [Volume(f'{k}', 'sphere', (0.03,), np.array([*start + [0, 0.2 + 0.1 * (5 - k), 0],
                                                          1.0, 0, 0, 0])) for k in range(5)]
    loop.controller.surround(Scene(things, MARGIN))
    loop.tick()
    assert loop.controller.clearance[1].endswith('and 4')
    loop.controller.memory.scalars.blocking = 1e6
    loop.controller.memory.scalars.blocked = 1.0
    loop.controller.scene = Scene(things[:1], MARGIN)
    assert loop.controller.clearance == (np.inf, '') and loop.controller.blocked == ''
