"""Task frames: a motion that was shown once is done where the objects are, moving or not."""
import json
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gdmp_ros import (
    Batch,
    DataError,
    Demonstration,
    Euclidean,
    ParameterError,
    Product,
    Rollout,
    Skill,
    SpecialOrthogonal,
    Sphere,
    SymmetricPositiveDefinite,
    UnitQuaternion,
)
from gdmp_ros.dmp.frames import placed, seen_from
from gdmp_ros.manifolds.poses import compose, tool_manifold
from gdmp_ros.util.profiles import minimum_jerk

DURATION = 5.0
POSE = tool_manifold(None)
#: Tool in the frames of start and goal, at the start and the goal.
LEAVES = np.array([0.0, 0.0, 0.1, 0.0, 1.0, 0.0, 0.0])
ENTERS = np.concatenate([[0.0, 0.0, 0.02],
                         Rotation.from_euler('xyz', [np.pi, 0.0, 0.3]).as_quat(scalar_first=True)])


def pose(position, rotation=(0.0, 0.0, 0.0)):
    """Pose of a position and a rotation vector."""
    return np.concatenate([position, Rotation.from_rotvec(rotation).as_quat(scalar_first=True)])


def random_pose(rng, reach=0.3, angle=1.0):
    return pose(rng.uniform(-reach, reach, 3), rng.uniform(-angle, angle, 3))


SHOWN = {'start': pose([0.3, 0.0, 0.2], [0.0, 0.0, 0.2]),
         'goal': pose([0.6, 0.3, 0.1], [0.1, 0.0, 1.0])}
ELSEWHERE = {'start': pose([0.3, -0.1, 0.2], [0.0, 0.0, -0.5]),
             'goal': pose([0.5, 0.4, 0.1], [0.3, 0.0, 2.0])}


def shown(frames=SHOWN, manifold=POSE, count=300):
    """A way with an arc from the start frame to the goal frame."""
    times = np.linspace(0.0, DURATION, count)
    begins, ends = compose(frames['start'], LEAVES), compose(frames['goal'], ENTERS)
    points = np.array([manifold.geodesic(begins, ends, float(w))
                       for w in minimum_jerk(times / DURATION)])
    points[:, 2] += 0.1 * np.sin(np.pi * times / DURATION) ** 2
    return Demonstration(times, points, manifold, frames=frames)


@pytest.fixture(scope='module')
def skill():
    return Skill.learn(shown())


def numbers(rollout, until, dt=2e-3, before=None):
    """States of a roll-out, one row each."""
    rows = [rollout.state.numbers.copy()]
    while rows[-1][0] < until - 1e-9:
        if before is not None:
            before(rollout)
        rows.append(rollout.advance(dt).numbers.copy())
    return np.array(rows)


def goal_in(frame):
    return compose(frame, ENTERS)


def apart(point, other):
    """Distance [m] and angle [rad]."""
    return (float(np.linalg.norm(point[:3] - other[:3])),
            2.0 * float(np.arccos(min(1.0, abs(point[3:7] @ other[3:7])))))


@pytest.mark.parametrize('manifold', [
    tool_manifold(3, True), tool_manifold(6), SpecialOrthogonal(3), Sphere(2),
    SymmetricPositiveDefinite(3), Product(Euclidean(3), SpecialOrthogonal(3)), UnitQuaternion()])
def test_a_point_seen_from_a_frame_and_placed_again_is_the_same(manifold, rng):
    points = np.array([manifold.random_point(rng) for _ in range(5)])
    frame = random_pose(rng)
    assert np.abs(placed(manifold, frame, seen_from(manifold, frame, points))
                  - points).max() < 1e-14
    manifold.check_points(placed(manifold, frame, points))


def test_a_frame_turns_stiffness_and_wrench_as_rotations_do(rng):
    manifold, frame = tool_manifold(6, True), random_pose(rng)
    point = manifold.random_point(rng)
    position, q, stiffness, wrench = manifold.split(point)
    new = manifold.split(placed(manifold, frame, point[None])[0])
    turn = Rotation.from_quat(frame[3:], scalar_first=True)
    both = np.kron(np.eye(2), turn.as_matrix())
    assert np.allclose(new[0], turn.apply(position) + frame[:3])
    assert np.allclose(new[1], (turn * Rotation.from_quat(q, scalar_first=True)).as_quat(
        scalar_first=True) * np.sign(new[1] @ (turn * Rotation.from_quat(
            q, scalar_first=True)).as_quat(scalar_first=True)))
    assert np.allclose(new[2], both @ stiffness @ both.T)
    assert np.allclose(new[3], both @ wrench)


def test_where_it_was_shown_it_does_what_was_shown(skill):
    demo = shown()
    path = Rollout(skill).sample(demo.times).points
    distances = POSE.factor_distances(path, demo.flat_points)
    assert distances.max() < 1e-4
    assert skill.views[0].name == 'start' and skill.views[-1].name == 'goal'


def test_it_leaves_the_start_frame_and_enters_the_goal_frame_rigidly(skill):
    rollout = Rollout(skill, frames=ELSEWHERE)
    rows = numbers(rollout, 7.0)
    demo = shown()
    begins = compose(ELSEWHERE['start'], seen_from(POSE, SHOWN['start'], demo.points[10:11])[0])
    at = np.argmin(abs(rows[:, 0] - demo.times[10]))
    assert apart(rows[at, 2:9], begins)[0] < 1e-3
    late = compose(ELSEWHERE['goal'], seen_from(POSE, SHOWN['goal'], demo.points[-15:-14])[0])
    at = np.argmin(abs(rows[:, 0] - demo.times[-15]))
    assert apart(rows[at, 2:9], late)[0] < 1e-3
    assert rollout.finished and not rollout.flags
    assert max(apart(rows[-1, 2:9], goal_in(ELSEWHERE['goal']))) < 1e-6
    assert max(apart(rollout.goal, goal_in(ELSEWHERE['goal']))) < 1e-6


def test_velocity_and_acceleration_are_derivatives_of_the_path(skill):
    rollout = Rollout(skill, frames=ELSEWHERE, speed=1.3)
    rollout.move_frame('goal', ELSEWHERE['goal'], [0.1, 0.0, 0.0, 0.0, 0.0, 0.3])
    rollout.set_speed(0.7)
    rows = numbers(rollout, 4.0, 1e-3)
    velocity = (rows[2:, 2:5] - rows[:-2, 2:5]) / 2e-3
    assert np.abs(velocity - rows[1:-1, 9:12]).max() < 1e-4
    acceleration = (rows[2:, 9:12] - rows[:-2, 9:12]) / 2e-3
    assert np.abs(acceleration - rows[1:-1, 15:18]).max() < 0.02
    ways = np.array([POSE.log(a, b)[3:] for a, b in zip(rows[:-2, 2:9], rows[2:, 2:9])]) / 2e-3
    assert np.abs(ways - rows[1:-1, 12:15]).max() < 1e-3


def test_the_path_does_not_depend_on_how_time_is_cut(skill):
    few = Rollout(skill, frames=ELSEWHERE).sample(np.array([1.0, 2.5, 2.9, 8.0])).points
    many = Rollout(skill, frames=ELSEWHERE).sample(np.linspace(0.0, 8.0, 8001)).points
    assert np.abs(few - many[[1000, 2500, 2900, 8000]]).max() < 1e-12


def test_a_start_elsewhere_in_motion_is_met_and_fades(skill, rng):
    start = compose(ELSEWHERE['start'], LEAVES)
    start[:3] += [0.05, 0.08, -0.02]
    velocity, acceleration = rng.normal(0.0, 0.1, 6), rng.normal(0.0, 0.3, 6)
    rollout = Rollout(skill, start, frames=ELSEWHERE, velocity=velocity,
                      acceleration=acceleration)
    state = rollout.state
    assert np.abs(state.point - start).max() < 1e-12
    assert np.abs(state.velocity - velocity).max() < 1e-9
    assert np.abs(state.acceleration - acceleration).max() < 1e-6
    rows = numbers(rollout, 7.0)
    assert rollout.finished and max(apart(rows[-1, 2:9], goal_in(ELSEWHERE['goal']))) < 1e-6
    rest = numbers(Rollout(skill, frames=ELSEWHERE), 7.0)
    assert np.abs(rows[2000:, 2:9] - rest[2000:, 2:9]).max() < 1e-12


@pytest.mark.parametrize('seed', range(4))
def test_it_converges_wherever_frames_and_start_are(skill, seed):
    rng = np.random.default_rng(seed)
    for _ in range(50):
        frames = {name: random_pose(rng, 0.5, 2.0) for name in ('start', 'goal')}
        rollout = Rollout(skill, POSE.random_point(rng), frames=frames)
        path = rollout.sample(np.linspace(0.0, 4.0 * DURATION, 30))
        assert np.isfinite(path.points).all() and rollout.finished
        assert max(apart(path.points[-1], goal_in(frames['goal']))) < 1e-6


def jump(frame):
    """A frame moved by 0.2 m and 1 rad."""
    moved = np.array(frame)
    moved[:3] += [0.1, 0.1, np.sqrt(0.02)]
    moved[3:] = (Rotation.from_rotvec([0.0, 0.0, 1.0]) * Rotation.from_quat(
        frame[3:], scalar_first=True)).as_quat(scalar_first=True)
    return moved


def test_a_frame_that_jumps_costs_no_step_and_little_acceleration(skill):
    new = jump(ELSEWHERE['goal'])
    rollout, plain = Rollout(skill, frames=ELSEWHERE), Rollout(skill, frames=ELSEWHERE)
    numbers(rollout, 2.5)
    before = rollout.state.numbers.copy()
    rollout.move_frame('goal', new)
    after = rollout.state.numbers.copy()
    assert np.abs(after[:15] - before[:15]).max() < 1e-7
    assert np.abs(after[15:] - before[15:]).max() < 1e-5
    rows = numbers(rollout, 9.0)
    assert rollout.finished and max(apart(rows[-1, 2:9], goal_in(new))) < 1e-6
    rest = numbers(plain, 9.0)
    caused = np.linalg.norm(rows[:, 15:18] - rest[len(rest) - len(rows):, 15:18], axis=1).max()
    # A goal switch by as much, of a skill without frames.
    usual = Skill.learn(Demonstration(shown().times, shown().points, POSE))
    switched, quiet = Rollout(usual), Rollout(usual)
    for one in (switched, quiet):
        numbers(one, 2.5)
    switched.retarget(compose(jump(SHOWN['goal']), ENTERS))
    of_switch = numbers(switched, 9.0)[:, 15:18] - numbers(quiet, 9.0)[:, 15:18]
    assert caused < 2.0 * np.linalg.norm(of_switch, axis=1).max()


VELOCITY, TURN = np.array([0.1, 0.0, 0.0]), np.array([0.0, 0.0, 0.3])


def moving(time):
    """The goal frame at 0.1 m/s and 0.3 rad/s."""
    frame = np.array(ELSEWHERE['goal'])
    frame[:3] += time * VELOCITY
    frame[3:] = (Rotation.from_rotvec(time * TURN) * Rotation.from_quat(
        frame[3:], scalar_first=True)).as_quat(scalar_first=True)
    return frame


def test_a_moving_frame_is_followed_without_lag(skill):
    rollout = Rollout(skill, frames=ELSEWHERE)
    rollout.move_frame('goal', moving(0.0), np.concatenate([VELOCITY, TURN]))
    end = numbers(rollout, DURATION)[-1]
    distance, angle = apart(end[2:9], goal_in(moving(end[0])))
    assert distance < 2e-4 and angle < 1e-3
    end = numbers(rollout, 7.0)[-1]
    assert rollout.finished and max(apart(end[2:9], goal_in(moving(end[0])))) < 1e-6


@pytest.mark.parametrize('seed', range(5))
def test_a_frame_seen_by_a_slow_noisy_late_camera_is_followed(skill, seed):
    """30 Hz, 0.5 mm, 3 mrad, 80 ms late with a jitter of 10 ms, 5 % lost, ±q at random."""
    rng, seen = np.random.default_rng(seed), []
    for stamp in np.arange(0.0, DURATION, 1.0 / 30.0):
        if rng.random() > 0.05:
            frame = moving(stamp)
            frame[:3] += rng.normal(0.0, 5e-4, 3)
            frame[3:] = (Rotation.from_rotvec(rng.normal(0.0, 3e-3, 3)) * Rotation.from_quat(
                frame[3:], scalar_first=True)).as_quat(scalar_first=True)
            frame[3:] *= rng.choice([-1.0, 1.0])
            seen.append((stamp + 0.08 + abs(rng.normal(0.0, 0.01)), stamp, frame))

    def camera(rollout):
        while seen and seen[0][0] <= rollout.state.time:
            _, stamp, frame = seen.pop(0)
            rollout.move_frame('goal', frame, stamp=stamp)
    rows = numbers(Rollout(skill, frames=ELSEWHERE), DURATION, before=camera)
    distance, angle = apart(rows[-1, 2:9], goal_in(moving(rows[-1, 0])))
    assert distance < 1.5e-3 and angle < 6e-3
    exact = Rollout(skill, frames=ELSEWHERE)
    exact.move_frame('goal', moving(0.0), np.concatenate([VELOCITY, TURN]))
    peaks = [np.linalg.norm(one[:, 15:18], axis=1).max()
             for one in (rows, numbers(exact, DURATION))]
    assert peaks[0] < 2.0 * peaks[1]


def test_a_measurement_older_than_the_last_one_is_not_used(skill):
    rollout = Rollout(skill, frames=ELSEWHERE)
    rollout.advance(1.0)
    rollout.move_frame('goal', moving(1.0), stamp=0.9)
    known = rollout.goal
    rollout.move_frame('goal', moving(0.2), stamp=0.2)
    assert np.array_equal(rollout.goal, known)


def test_a_new_goal_moves_the_goal_frame(skill, rng):
    goal = compose(random_pose(rng), LEAVES)
    later, first = Rollout(skill, frames=ELSEWHERE), Rollout(skill, goal=goal, frames=ELSEWHERE)
    later.advance(2.0)
    later.retarget(goal)
    for rollout in (later, first):
        end = numbers(rollout, 9.0)[-1]
        assert rollout.finished and max(apart(end[2:9], goal)) < 1e-6
    later.retarget(goal, np.array([0.1, 0.0, 0.0, 0.0, 0.0, 0.0]))
    end = numbers(later, later.state.time + 3.0)[-1]
    moved = goal[:3] + [0.3, 0.0, 0.0]
    assert np.linalg.norm(end[2:5] - moved) < 1e-4


def test_a_frame_that_turns_once_around_comes_back_the_same_way(skill):
    """±q are chosen once: a full turn leads to -q, and no tick takes another way."""
    rollout = Rollout(skill, frames=ELSEWHERE)

    def turning(rollout):
        time = rollout.state.time
        angle = 2.0 * np.pi * min(max(time - 3.6, 0.0) / 4.0, 1.0)
        frame = np.array(ELSEWHERE['goal'])
        frame[3:] = (Rotation.from_rotvec([0.0, 0.0, angle]) * Rotation.from_quat(
            frame[3:], scalar_first=True)).as_quat(scalar_first=True)
        if rollout.state.time % 0.05 < 2e-3:
            rollout.move_frame('goal', frame)
    rows = numbers(rollout, 11.0, before=turning)
    assert np.linalg.norm(np.diff(rows[:, 5:9], axis=0), axis=1).max() < 0.01
    assert rows[-1, 5:9] @ goal_in(ELSEWHERE['goal'])[3:] * (
        numbers(Rollout(skill, frames=ELSEWHERE), 7.0)[-1, 5:9]
        @ goal_in(ELSEWHERE['goal'])[3:]) < 0.0


def test_a_pose_and_the_same_with_the_other_quaternion_are_one_frame(skill):
    times = np.linspace(0.0, DURATION, 100)
    paths = [Rollout(skill, frames={**ELSEWHERE, 'goal': ELSEWHERE['goal'] * np.repeat(
        [1.0, sign], [3, 4])}).sample(times).points for sign in (1.0, -1.0)]
    assert np.abs(paths[0] - paths[1]).max() < 1e-12


def test_a_copy_and_a_batch_go_on_alike(skill):
    first = Rollout(skill, frames=ELSEWHERE)
    first.advance(1.0)
    copy, plain = first.copy(), Rollout(Skill.learn(Demonstration(
        shown().times, shown().points, POSE)))
    copy.move_frame('goal', SHOWN['goal'])
    batch = Batch([first, plain])
    for _ in range(10):
        state = batch.advance(0.1)[0]
        copy.advance(0.1)
    again = Rollout(skill, frames=ELSEWHERE)
    again.advance(1.0)
    for _ in range(10):
        expected = again.advance(0.1)
    assert np.abs(state.point - expected.point).max() < 1e-12
    assert np.abs(state.point - copy.state.point).max() > 1e-3
    assert set(first.frames) == {'start', 'goal'}


def test_a_skill_with_its_frames_elsewhere_is_the_one_shown_there(skill):
    here = skill.with_frames(ELSEWHERE)
    times = np.linspace(0.0, DURATION, 100)
    assert np.abs(Rollout(here).sample(times).points - Rollout(
        skill, frames=ELSEWHERE).sample(times).points).max() < 1e-12
    assert max(apart(here.goal, goal_in(ELSEWHERE['goal']))) < 1e-6
    path = Rollout(here).sample(times).points
    assert np.abs(path[0] - here.start).max() < 1e-12
    with pytest.raises(ParameterError, match="'hole'.*start, goal"):
        skill.with_frames({'hole': LEAVES})


def test_the_change_from_frame_to_frame_costs_little_acceleration(skill):
    """Shares that ended abruptly would cost seven times the acceleration of the motion."""
    shown_peak, moved_peak = (np.linalg.norm(numbers(
        Rollout(skill, frames=frames), DURATION)[:, 15:18], axis=1).max()
                              for frames in (SHOWN, ELSEWHERE))
    assert moved_peak < 4.0 * shown_peak


def test_a_skill_file_keeps_the_frames(skill, tmp_path):
    skill.save(tmp_path / 'skill.json')
    loaded = Skill.load(tmp_path / 'skill.json')
    jsonschema.validate(json.loads((tmp_path / 'skill.json').read_text()), json.loads(
        (Path(__file__).parents[2] / 'docs' / 'skill.schema.json').read_text()))
    times = np.linspace(0.0, DURATION, 50)
    assert np.array_equal(*(Rollout(one, frames=ELSEWHERE).sample(times).points
                            for one in (skill, loaded)))
    text = (tmp_path / 'skill.json').read_text().replace('"version": 9', '"version": 8', 1)
    (tmp_path / 'old.json').write_text(text)
    with pytest.raises(DataError, match='version'):
        Skill.load(tmp_path / 'old.json')


@pytest.mark.parametrize('frames, reason', [
    ({'goal': np.zeros(7)}, 'norm 1'), ({'goal': np.full(7, np.nan)}, 'finite'),
    ({'goal': np.zeros(6)}, r'shape is \(6,\)'), ({'box': LEAVES}, 'start, goal'),
    ({'goal': (2.0 * np.eye(3), np.zeros(3))}, 'no rotation'),
    ({'goal': (np.eye(3), np.zeros(2))}, 'expected')])
def test_frames_that_are_none_are_refused(skill, frames, reason):
    with pytest.raises(ParameterError, match=reason):
        Rollout(skill, frames=frames)
    rollout = Rollout(skill)
    known = rollout.state.numbers.copy()
    for name, frame in frames.items():
        with pytest.raises(ParameterError, match=reason):
            rollout.move_frame(name, frame)
    assert np.array_equal(rollout.state.numbers, known)


def test_what_frames_are_not_combined_with_is_refused_with_the_reason(skill):
    times, plain = np.linspace(0.0, 1.0, 50), Skill.learn(Demonstration(
        shown().times, shown().points, POSE))
    for wrong in (lambda: skill.through([(0.5, skill.start)]), lambda: skill.between(skill.start),
                  lambda: Rollout(skill, final_velocity=np.zeros(6)),
                  lambda: Rollout(skill).set_obstacles(np.zeros((1, 3))),
                  lambda: Rollout(skill, frame=np.eye(6)),
                  lambda: Skill.learn(shown(), end='moving'),
                  lambda: Skill.learn_rhythmic(shown()),
                  lambda: Rollout(plain, frames=SHOWN),
                  lambda: Rollout(plain).move_frame('goal', LEAVES),
                  lambda: Rollout(skill).move_frame('goal', LEAVES, np.zeros(5)),
                  lambda: Rollout(skill).move_frame('goal', LEAVES, stamp=9.0)):
        with pytest.raises(ParameterError, match='frame'):
            wrong()
    with pytest.raises(DataError, match='no rigid motion moves'):
        Demonstration(times, np.zeros((50, 7)), Euclidean(7), frames=SHOWN)


def round_skill():
    """The goal's object is symmetric about its z axis."""
    return Skill.learn(shown(), free_yaw=['goal'])


def about_z(frame, angle):
    return compose(frame, pose([0.0, 0.0, 0.0], [0.0, 0.0, angle]))


def test_of_a_symmetric_object_the_nearest_turn_is_taken(skill):
    free = round_skill()
    for angle in (-3.0, -1.0, 0.5, 2.0):
        elsewhere = about_z(pose([0.5, 0.4, 0.1], [0.2, 0.0, 0.9]), angle)
        ends = [Rollout(one, frames={'goal': elsewhere}).goal for one in (free, skill)]
        place, turn = apart(ends[0], ends[1])
        assert place < 1e-5  # on the axis of the object; only the turn differs
        assert apart(ends[0], free.goal)[1] <= apart(ends[1], free.goal)[1] + 1e-9
    turned = [Rollout(free, frames={'goal': about_z(SHOWN['goal'], angle)}).goal
              for angle in (0.0, 1.0, 3.0, -2.0)]
    assert all(apart(goal, turned[0])[1] < 1e-7 for goal in turned)


def test_a_symmetric_object_that_spins_does_not_turn_the_tool():
    rollout = Rollout(round_skill())

    def spin(rollout):
        now = rollout.state.time
        frame, twist = about_z(SHOWN['goal'], 2.0 * now), np.zeros(6)
        twist[3:] = 2.0 * Rotation.from_quat(frame[3:], scalar_first=True).apply([0, 0, 1])
        rollout.move_frame('goal', frame, twist if now < 2.0 else None)
    rows = numbers(rollout, 6.0, 5e-3, spin)
    still = numbers(Rollout(round_skill()), 6.0, 5e-3)
    assert np.abs(rows[:, 2:9] - still[:, 2:9]).max() < 1e-7
    assert rollout.finished and not rollout.frames_move


def test_takes_of_a_symmetric_object_are_learned_whatever_its_turn(rng):
    takes = []
    for _ in range(3):
        frames = {'start': random_pose(rng, 0.1, 0.3), 'goal': random_pose(rng, 0.3, 0.3)}
        takes.append(shown(frames))
    spun = [Demonstration(take.times, take.points, POSE, frames={
        **take.frames, 'goal': about_z(take.frames['goal'], angle)})
        for take, angle in zip(takes, (0.0, 2.0, -2.5))]
    upright = Skill.learn(spun, free_yaw=['goal'])
    other = {'start': pose([0.1, 0.0, 0.0]), 'goal': pose([0.3, 0.2, 0.1], [0.1, 0.1, 0.0])}
    # What the takes show of the place of the goal agrees; its turn cannot.
    place, _ = apart(Rollout(upright, frames=other).goal, goal_in(other['goal']))
    assert place < 1e-3
    with pytest.raises(ParameterError, match="free_yaw: frame 'cup', expected one of"):
        Skill.learn(spun, free_yaw=['cup'])
    with pytest.raises(ParameterError, match='the demonstrations have no frames'):
        Skill.learn(Demonstration(takes[0].times, takes[0].points, POSE), free_yaw=['cup'])


def test_with_the_distance_the_shape_shrinks_and_grows():
    line = np.array([1.0, 0.0, 0.0])
    frames = {'start': pose([0, 0, 0]), 'goal': pose(0.4 * line)}
    times = np.linspace(0.0, DURATION, 300)
    points = np.outer(minimum_jerk(times / DURATION), 0.4 * line)
    points[:, 2] += 0.1 * np.sin(np.pi * times / DURATION) ** 2
    skill = Skill.learn(Demonstration(times, points, Euclidean(3), frames=frames))
    for part in (0.05, 1.0, 1.5):
        near = {'goal': pose(part * 0.4 * line)}
        scaled, plain = (Rollout(skill, frames=near, scale=scale).sample(times).points
                         for scale in ('distance', 'none'))
        assert np.abs(scaled - part * points).max() < 1e-3 * part
        assert plain[:, 2].max() == pytest.approx(0.1, abs=2e-3)
        assert np.abs(plain[-1] - part * 0.4 * line).max() < 1e-3
    with pytest.raises(ParameterError, match='expected one of none, distance'):
        Rollout(skill, scale='size')
    closed = skill.with_frames({'goal': frames['start']})
    with pytest.raises(ParameterError, match='the shape cannot be scaled'):
        Rollout(closed, frames={'goal': frames['goal']}, scale='distance')


def test_a_scaled_motion_turns_stays_in_its_frames_and_keeps_its_ends(skill):
    rollout = Rollout(skill, frames=ELSEWHERE, scale='distance')
    path = rollout.sample(np.linspace(0.0, 7.0, 500)).points
    assert apart(path[0], compose(ELSEWHERE['start'], LEAVES))[0] < 1e-4
    assert apart(path[-1], goal_in(ELSEWHERE['goal'])) < (1e-4, 1e-3)
    turned = Rollout(skill, frames=ELSEWHERE).sample(np.linspace(0.0, 7.0, 500)).points
    likeness = np.abs(np.sum(path[:, 3:] * turned[:, 3:], axis=1))
    assert likeness.min() > 1.0 - 1e-9  # orientations are not scaled


def test_a_frame_that_is_not_seen_any_more_comes_to_rest(skill):
    rollout = Rollout(skill)
    goal = SHOWN['goal']
    twist = np.array([0.1, 0.0, 0.0, 0.0, 0.0, 0.3])
    numbers(rollout, 1.0, before=None)
    rollout.move_frame('goal', goal, twist)
    assert rollout.frames_move
    numbers(rollout, 2.0)
    rollout.rest_frame('goal')
    assert not rollout.frames_move
    where = rollout.frames['goal']
    rows = numbers(rollout, 8.0)
    assert rollout.finished
    assert np.linalg.norm(rollout.frames['goal'][:3] - where[:3]) < 0.04  # what fades of 0.1 m/s
    assert np.abs(rows[-1, 9:12]).max() < 1e-3
    with pytest.raises(ParameterError, match='no such frame'):
        rollout.rest_frame('box')


def test_until_its_object_is_grasped_the_frame_of_the_start_alone_counts(rng):
    skill = Skill.learn(shown(), grasp_at=0.4)
    assert skill.views[0].grasped == 0.4
    frames = {'start': ELSEWHERE['start'], 'goal': random_pose(rng)}
    start = compose(ELSEWHERE['start'], pose([0.05, 0.1, 0.3], [0.3, 0.2, 0.1]))
    held = Rollout(skill.views[0].skill).sample(np.array([0.4 * DURATION])).points[0]
    for begins in (None, start):  # also from elsewhere: the offset of the start has faded
        point = Rollout(skill, begins, frames=frames).sample(np.array([0.4 * DURATION])).points[0]
        assert np.less(apart(point, compose(frames['start'], held)), (1e-6, 1e-5)).all()
    ends = Rollout(skill, start, frames=frames).sample(np.array([DURATION, 8.0])).points[-1]
    assert max(apart(ends, goal_in(frames['goal']))) < 1e-3
    for wrong in (0.95, -0.1, np.nan):
        with pytest.raises(ParameterError, match='grasp_at is'):
            Skill.learn(shown(), grasp_at=wrong)


def test_the_skill_file_keeps_what_is_said_of_objects(tmp_path):
    skill = Skill.learn(shown(), free_yaw=['goal'], grasp_at=0.4)
    skill.save(tmp_path / 'skill.json')
    loaded = Skill.load(tmp_path / 'skill.json')
    assert [(view.free_yaw, view.grasped) for view in loaded.views] == [(False, 0.4), (True, None)]
    document = json.loads((tmp_path / 'skill.json').read_text())
    jsonschema.validate(document, json.loads(
        (Path(__file__).parents[2] / 'docs' / 'skill.schema.json').read_text()))
    document['frames'][0]['grasped'] = 2.0
    (tmp_path / 'wrong.json').write_text(json.dumps(document))
    with pytest.raises(DataError, match='it is grasped at s = 2.0'):
        Skill.load(tmp_path / 'wrong.json')
