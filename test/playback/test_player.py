"""Playing a skill as a reference: continuous through everything a user can ask."""
import threading
import time

import numpy as np
import pytest

from gdmp_ros import (
    DataError,
    Demonstration,
    Euclidean,
    ManifoldError,
    ParameterError,
    Product,
    Skill,
    UnitQuaternion,
)
from gdmp_ros.control.modes import StreamMode
from gdmp_ros.playback.channels import APPROACH_ACCELERATION
from gdmp_ros.playback.player import MAX_WAITING, Player
from gdmp_ros.playback.prediction import prediction
from gdmp_ros.playback.settings import PlayerSettings
from gdmp_ros.playback.states import Request
from gdmp_ros.playback.streamed_skill import StreamedSkill

SETTINGS = PlayerSettings()
DT = 1e-3


@pytest.fixture
def skill(letter):
    return letter


@pytest.fixture
def player(skill):
    return Player(skill, SETTINGS)


def pose_of(skill):
    return skill.start[:7].copy()


def run(player, ticks):
    return np.array([player.tick(DT).copy() for _ in range(ticks)])


def largest_step(rows):
    return np.linalg.norm(np.diff(rows[:, :3], axis=0), axis=1).max()


def test_it_is_idle_until_there_is_something_to_hold(player, skill):
    assert player.status == 'idle' and player.tick(DT) is None
    player.hold(pose_of(skill))
    row = player.tick(DT)
    assert player.status == 'holding'
    np.testing.assert_array_equal(row[:7], pose_of(skill))
    np.testing.assert_allclose(row[19:55].reshape(6, 6)[3:, 3:], 30.0 * np.eye(3))


def test_a_motion_starts_at_the_measured_pose_without_a_step(player, skill):
    elsewhere = pose_of(skill)
    elsewhere[:3] += [0.1, -0.1, 0.05]
    player.hold(elsewhere)
    held = run(player, 5)
    player.start(elsewhere)
    rows = np.vstack([held, run(player, 3000)])
    assert largest_step(rows) < 1e-3
    assert np.abs(np.diff(rows[:, 7:10], axis=0)).max() < 0.02
    assert player.status == 'moving'
    stiffness = rows[:, 19:55].reshape(-1, 6, 6)
    assert (np.linalg.eigvalsh(stiffness)[:, 0] > 0).all()


def begin_far_away(player, skill):
    """Start at a robot 0.2 m from the held reference; poses until the motion begins."""
    player.hold(pose_of(skill))
    rows = [run(player, 3)]
    robot = pose_of(skill)
    robot[0] += 0.2
    player.start(robot)
    while player.mode is StreamMode.HOLDING or player.status == 'holding':
        rows.append(run(player, 1))
        assert len(rows) < 2000
    return robot, np.vstack(rows)


def test_a_reference_that_is_held_far_from_the_robot_goes_there_before_a_motion(player, skill):
    robot, rows = begin_far_away(player, skill)
    np.testing.assert_allclose(rows[-1, :7], robot, atol=1e-9)
    rows = np.vstack([rows, run(player, 500)])
    assert largest_step(rows) < 0.5e-3
    np.testing.assert_allclose(np.diff(rows[:, :3], axis=0)[:700] / DT,
                               0.5 * (rows[1:701, 7:10] + rows[:700, 7:10]), atol=5e-3)


@pytest.mark.parametrize('after', [1, 200])
def test_what_is_asked_on_the_way_to_the_robot_is_done(player, skill, after):
    goal = skill.goal[:7] + [0.0, 0.05, 0.0, 0.0, 0.0, 0.0, 0.0]
    robot = pose_of(skill) + [0.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    player.hold(pose_of(skill))
    run(player, 3)
    player.start(robot)
    run(player, after)
    player.go_to(goal)
    run(player, 1500)
    np.testing.assert_allclose(player.goal, goal)
    player.hold(pose_of(skill))
    player.start(robot)
    run(player, after)
    player.stop()
    stopped = run(player, 600)
    assert player.status == 'holding' and not stopped[-1, 7:19].any()


def largest_acceleration(rows):
    return np.linalg.norm(np.diff(rows[:, 7:10], axis=0), axis=1).max() / DT


def test_the_way_to_the_robot_is_left_smoothly(player, skill):
    """By a stop, and by another start of which the robot is elsewhere."""
    robots = [pose_of(skill) + [x, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0] for x in (0.2, -0.2)]
    player.hold(pose_of(skill))
    rows = [run(player, 3)]
    player.start(robots[0])
    rows.append(run(player, 250))
    assert np.linalg.norm(rows[-1][-1, 7:10]) > 0.3
    player.start(robots[1])
    rows.append(run(player, 400))
    player.stop()
    assert player.status == 'stopping'
    rows.append(run(player, 600))
    assert player.status == 'holding' and player.motion == 2
    assert largest_acceleration(np.vstack(rows)) < 1.01 * APPROACH_ACCELERATION['position']


def test_a_pause_on_the_way_to_the_robot_pauses_there(player, skill):
    player.hold(pose_of(skill))
    run(player, 3)
    robot = pose_of(skill) + [0.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    player.start(robot)
    rows = [run(player, 200)]
    player.pause(True)
    rows.append(run(player, 1000))
    assert player.status == 'paused' and player.mode is StreamMode.HOLDING
    assert not rows[-1][500:, 7:19].any() and rows[-1][-1, 0] < robot[0] - 0.05
    player.go_to(skill.goal[:7] + [0.0, 0.05, 0.0, 0.0, 0.0, 0.0, 0.0])
    run(player, 1)
    np.testing.assert_allclose(player.goal[1], skill.goal[1] + 0.05)
    player.pause(False)
    assert player.status == 'moving'
    while player.mode is StreamMode.HOLDING:
        rows.append(run(player, 1))
    np.testing.assert_allclose(rows[-1][-1, :7], robot, atol=1e-6)
    assert largest_acceleration(np.vstack(rows)) < 1.01 * APPROACH_ACCELERATION['position']
    np.testing.assert_allclose(player.goal[1], skill.goal[1] + 0.05)


def test_a_goal_after_a_stop_and_a_start_is_that_of_the_new_motion(player, skill):
    player.start(pose_of(skill))
    run(player, 1500)
    player.stop()
    run(player, 20)
    player.start(pose_of(skill))
    run(player, 5)
    goal = skill.goal[:7] + [0.0, 0.07, 0.0, 0.0, 0.0, 0.0, 0.0]
    player.go_to(goal)
    run(player, 3000)
    assert player.motion == 2
    np.testing.assert_allclose(player.goal, goal)


def test_a_motion_that_is_stopped_before_it_begins_has_ended(player, skill):
    player.start(pose_of(skill))
    run(player, 1500)
    player.stop()
    player.start(pose_of(skill))
    run(player, 20)
    assert player.motion == 1
    player.stop()
    run(player, 1000)
    assert player.motion == 2 and player.status == 'holding' and player.rollout is None


def test_requests_that_a_state_does_not_allow_are_refused_with_the_reason(player, skill):
    player.hold(pose_of(skill))
    for ask in (lambda: player.pause(True), lambda: player.go_to(skill.goal[:7])):
        before = player.refusals.count
        ask()
        run(player, 1)
        assert player.refusals.count == before + 1
        assert player.refusals.last == 'no skill is being executed; start one first'
    with pytest.raises(ParameterError, match='no skill is being executed'):
        player.check(Request.STOP)
    player.end()
    run(player, 1)
    assert player.refusals.count == 2


def test_a_motion_that_follows_a_stop_begins_at_a_robot_that_did_not_follow(player, skill):
    player.start(pose_of(skill))
    rows = [run(player, 1500)]
    player.stop()
    player.start(pose_of(skill))
    rows.append(run(player, 3000))
    near = np.linalg.norm(np.vstack(rows)[1500:, :3] - skill.start[:3], axis=1).min()
    assert near < 1e-3 and player.status == 'moving' and player.motion == 2
    assert largest_step(np.vstack(rows)) < 1e-3


def test_only_motions_are_streamed_as_motions(player, skill):
    player.hold(pose_of(skill))
    run(player, 1)
    assert player.mode is StreamMode.HOLDING
    player.start(pose_of(skill))
    run(player, 100)
    assert player.mode is StreamMode.STREAMING
    player.stop()
    run(player, 1000)
    assert player.mode is StreamMode.HOLDING


def test_in_motion_the_next_motion_goes_on_from_the_reference(player, skill):
    """A robot that is 25 mm behind does not pull the reference back."""
    player.start(pose_of(skill))
    rows = [run(player, 1500)]
    behind = rows[0][-1, :7] + [0.025, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    player.start(behind)
    rows.append(run(player, 1500))
    assert largest_step(np.vstack(rows)) < 0.5e-3


def test_goals_switch_pose_and_stiffness_each_on_its_own(player, skill):
    player.start(None)
    run(player, 1000)
    goal = skill.goal[:7].copy()
    goal[:3] += [0.0, -0.1, 0.05]
    player.go_to(goal)
    run(player, 500)
    player.goal_stiffness(player.tool.stiffness_factor(np.diag([300.0, 500, 350]).reshape(-1)))
    rows = run(player, 9000)
    assert player.status == 'holding' and player.rollout.finished
    np.testing.assert_allclose(rows[-1, :3], goal[:3], atol=1e-4)
    np.testing.assert_allclose(rows[-1, 19:55].reshape(6, 6)[:3, :3], np.diag([300.0, 500, 350]),
                               atol=0.5)
    # Past the end it goes on following.
    goal[2] += 0.1
    player.go_to(goal)
    after = run(player, 6000)
    np.testing.assert_allclose(after[-1, :3], goal[:3], atol=1e-4)


def test_pause_resume_and_stop_are_smooth_and_stay_on_the_path(player, skill):
    player.start(None)
    rows = [run(player, 1200)]
    player.pause(True)
    rows.append(run(player, 500))
    assert player.status == 'paused' and np.abs(rows[-1][-1, 7:13]).max() == 0.0
    np.testing.assert_array_equal(rows[-1][-1, :7], rows[-1][-50, :7])
    player.pause(False)
    rows.append(run(player, 800))
    assert player.status == 'moving'
    player.stop()
    rows.append(run(player, 500))
    assert player.status == 'holding' and player.rollout is None
    assert np.abs(rows[-1][-1, 7:13]).max() == 0.0
    everything = np.vstack(rows)
    assert largest_step(everything) < 1e-3
    speeds = np.linalg.norm(everything[:, 7:10], axis=1)
    assert np.abs(np.diff(speeds)).max() < 0.01


def test_a_newer_start_takes_over_with_the_same_velocity(player, skill):
    player.start(None)
    before = run(player, 1500)
    player.start(before[-1, :7].copy())
    rows = np.vstack([before, run(player, 500)])
    assert largest_step(rows) < 1e-3
    assert np.abs(np.diff(rows[:, 7:10], axis=0)).max() < 0.02


def test_speed_applies_to_this_motion_and_the_next(player, skill):
    player.start(None)
    run(player, 500)
    player.set_speed(0.5)
    run(player, 500)
    assert player.rollout.speed == 0.5
    player.stop()
    run(player, 300)
    player.start(None)
    run(player, 500)
    assert player.rollout.speed == 0.5
    with pytest.raises(ParameterError):
        player.set_speed(9.0)


def test_stiffness_goals_that_do_not_fit_are_refused(player):
    full = SETTINGS.stiffness_matrix
    full[:3, :3] = np.diag([300.0, 500, 350])
    np.testing.assert_allclose(player.tool.stiffness_factor(full.reshape(-1)), full[:3, :3])
    coupled = full.copy()
    coupled[0, 4] = coupled[4, 0] = 5.0
    with pytest.raises(ManifoldError, match='couples'):
        player.tool.stiffness_factor(coupled)
    other = full.copy()
    other[5, 5] = 90.0
    with pytest.raises(ManifoldError, match='rotational block'):
        player.tool.stiffness_factor(other)
    with pytest.raises(ManifoldError, match='smallest eigenvalue'):
        player.tool.stiffness_factor(np.diag([1.0, -1.0, 1.0]))
    with pytest.raises(ManifoldError, match='5 numbers, expected 9 or 36'):
        player.tool.stiffness_factor(np.ones(5))


def test_a_refused_goal_is_counted_and_the_motion_continues(player, skill):
    undisturbed = Player(skill, SETTINGS)
    for one in (player, undisturbed):
        one.start(None)
        run(one, 100)
    goal = skill.goal[:7].copy()
    goal[3:] *= 2.0
    player.go_to(goal)
    np.testing.assert_array_equal(run(player, 50), run(undisturbed, 50))
    assert player.refusals.count == 1 and 'norm is 2' in player.refusals.last
    # A quarter of S³ away from the old one is possible.
    goal[3:] = 0.5 * np.roll(goal[3:], 1) * [1, -1, 1, -1]
    player.go_to(goal)
    run(player, 10)
    assert player.refusals.count == 1
    np.testing.assert_allclose(player.goal, goal)


def test_pose_only_skills_stream_the_configured_stiffness(rng):
    manifold = Product(Euclidean(3), UnitQuaternion())
    t = np.linspace(0.0, 1.0, 100)
    points = np.array([manifold.join(np.array([0.3 + 0.1 * x * x, 0.0, 0.4]),
                                     np.array([1.0, 0, 0, 0])) for x in t])
    player = Player(Skill.learn(Demonstration(t, points, manifold)), SETTINGS)
    player.start(None)
    rows = run(player, 1500)
    np.testing.assert_array_equal(rows[-1, 19:55].reshape(6, 6), SETTINGS.stiffness_matrix)
    with pytest.raises(ManifoldError, match='no stiffness'):
        player.tool.stiffness_factor(np.eye(3))


def test_other_manifolds_are_refused(rng):
    t = np.linspace(0.0, 1.0, 50)
    skill = Skill.learn(Demonstration(t, np.column_stack([t, t]), Euclidean(2)))
    with pytest.raises(DataError, match='a pose reference needs'):
        Player(skill, SETTINGS)


def test_a_robot_that_is_behind_slows_the_reference_with_and_without_stiffness(skill, rng):
    settings = PlayerSettings(phase_stopping=5.0)
    for learned in (skill, pose_only(skill)):
        player = Player(learned, settings)
        player.start(None)
        start = player.tick(1e-3)[:7].copy()
        for _ in range(3000):
            player.observe(start)
            player.tick(1e-3)
        assert player.rollout.speed < 0.3
        for _ in range(2000):
            player.observe(player.target[:7].copy())
            player.tick(1e-3)
        assert player.rollout.speed == pytest.approx(1.0, abs=1e-3)


def pose_only(skill):
    """The same motion without its stiffness."""
    path = skill.reproduce(0.005)
    manifold = Product(*skill.manifold.factors[:2])
    return Skill.learn(Demonstration(path.times, path.points[:, :7], manifold))


def test_a_prediction_gives_the_path_to_the_goal_and_changes_nothing(skill):
    watched, alone = Player(skill, SETTINGS), Player(skill, SETTINGS)
    for player in (watched, alone):
        player.start(None)
    assert watched.taken_copy() is None
    run(watched, 500)
    run(alone, 500)
    watched.request_copy()
    assert watched.taken_copy() is None  # a copy is made in the tick
    row, same = run(watched, 1)[0], run(alone, 1)[0]
    path = prediction(watched.taken_copy(), 40)[0][:, :7]
    np.testing.assert_allclose(path[0], row[:7], atol=1e-3)
    assert 20 < len(path) < 100
    assert np.linalg.norm(path[-1, :3] - skill.goal[:3]) < 1e-3
    np.testing.assert_array_equal(row, same)
    np.testing.assert_array_equal(run(watched, 300), run(alone, 300))
    np.testing.assert_array_equal(watched.goal, skill.goal[:7])
    # After a switch the path leads to the new goal, which comes slowly.
    goal = skill.goal[:7].copy()
    goal[:3] += [0.05, -0.05, 0.02]
    watched.go_to(goal)
    watched.request_copy()
    run(watched, 1)
    np.testing.assert_allclose(watched.goal, goal)
    path = prediction(watched.taken_copy(), 40)[0][:, :7]
    np.testing.assert_allclose(path[-1, :3], goal[:3], atol=1e-3)


def test_a_paused_motion_can_be_predicted(skill):
    player = Player(skill, SETTINGS)
    player.start(None)
    run(player, 500)
    player.pause(True)
    run(player, 1000)
    player.request_copy()
    run(player, 1)
    assert np.linalg.norm(prediction(player.taken_copy(), 40)[0][-1, :3] - skill.goal[:3]) < 1e-3
    assert player.status == 'paused'


def test_a_prediction_with_phase_stopping_reaches_the_goal(skill):
    player = Player(skill, PlayerSettings(phase_stopping=50.0))
    player.start(None)
    behind = pose_of(skill)
    behind[0] -= 0.3
    for _ in range(500):
        player.observe(behind)
        player.tick(DT)
    assert player.rollout.speed < 0.5
    player.request_copy()
    player.tick(DT)
    assert np.linalg.norm(prediction(player.taken_copy(), 40)[0][-1, :3] - skill.goal[:3]) < 1e-3


# Requests that come between two ticks are carried out in order by the next one.

def test_a_stop_before_the_next_tick_stops_the_new_motion(player, skill):
    player.start(None)
    run(player, 1000)
    player.start(None)
    player.stop()
    assert player.status == 'stopping'
    before = player.target[:3].copy()
    rows = run(player, 1500)
    assert player.status == 'holding' and player.rollout is None
    assert np.linalg.norm(rows[-1, :3] - before) < 0.05
    assert np.abs(rows[-1, 7:13]).max() == 0.0


def test_a_pause_before_the_next_tick_pauses_the_new_motion(player, skill):
    player.start(None)
    player.pause(True)
    assert player.status == 'paused'
    rows = run(player, 1000)
    assert player.status == 'paused'
    np.testing.assert_allclose(rows[-1, :3], skill.start[:3], atol=1e-6)
    player.pause(False)
    assert player.status == 'moving'
    run(player, 8000)
    assert player.status == 'holding'


def test_a_motion_starts_at_the_newest_reference(player, skill, monkeypatch):
    player.start(None)
    rows = [run(player, 1500)]
    made = StreamedSkill.options

    def slow(*arguments):
        """While the new motion is prepared the old one goes on, as under load."""
        rows.append(run(player, 20))
        return made(*arguments)
    monkeypatch.setattr(StreamedSkill, 'options', slow)
    player.start(rows[0][-1, :7].copy())
    rows.append(run(player, 500))
    path = np.vstack(rows)
    fastest = np.linalg.norm(path[:, 7:10], axis=1).max()
    assert len(rows) == 3 and largest_step(path) < 1.01 * fastest * DT
    assert np.abs(np.diff(path[:, 7:10], axis=0)).max() < 0.02


def test_requests_do_not_touch_the_motion_before_the_next_tick(player, skill):
    player.start(None)
    run(player, 500)
    before = player.rollout.memory.copy()
    player.set_speed(0.5)
    player.pause(True)
    player.go_to(skill.start[:7].copy())
    player.stop()
    np.testing.assert_array_equal(player.rollout.memory, before)
    run(player, 1)
    assert not np.array_equal(player.rollout.memory, before)


def test_the_newest_of_several_goals_is_followed(player, skill):
    player.start(None)
    run(player, 500)
    for offset in (0.3, -0.2, 0.05):
        goal = skill.goal[:7].copy()
        goal[1] += offset
        player.go_to(goal)
    run(player, 1)
    np.testing.assert_allclose(player.goal, goal)


def test_the_number_of_a_motion_appears_when_it_has_begun(player):
    first = player.start(None)
    assert player.motion != first
    run(player, 1)
    assert player.motion == first
    second = player.start(None)
    assert player.motion == first and second == first + 1


def test_requests_that_nobody_carries_out_end_with_an_error(player):
    with pytest.raises(ParameterError, match='no tick carries them out'):
        for _ in range(MAX_WAITING + 1):
            player.set_speed(0.5)


def test_requests_from_another_thread_keep_the_reference_continuous(player, skill):
    player.start(None)
    path, stop = [], threading.Event()

    def tick():
        while not stop.is_set():
            path.append(player.tick(DT).copy())
    thread = threading.Thread(target=tick)
    thread.start()
    goal = skill.goal[:7].copy()
    for k in range(40):
        player.start(player.target[:7].copy() if player.target is not None else None)
        goal[0] += 0.01 * (-1.0) ** k
        player.go_to(goal)
        player.pause(k % 2 == 0)
        player.set_speed(0.5 + 0.01 * k)
        if k % 5 == 0:
            player.stop()
        before = len(path)
        while len(path) < before + 20:
            assert thread.is_alive()
            time.sleep(1e-4)
    stop.set()
    thread.join()
    rows = np.array(path)
    assert len(rows) >= 800
    fastest = np.linalg.norm(rows[:, 7:10], axis=1).max()
    assert largest_step(rows) < 1.05 * fastest * DT + 1e-6
    assert player.refusals.count == 0


def test_a_stop_while_holding_ends_the_motion(skill):
    player = Player(skill, SETTINGS)
    player.start(None)
    run(player, round(2.0 * skill.duration / DT))
    assert player.status == 'holding' and player.rollout is not None
    held = player.target.copy()
    player.stop()
    assert player.status == 'stopping'
    run(player, 1000)
    assert player.status == 'holding' and player.rollout is None
    np.testing.assert_allclose(player.target[:7], held[:7], atol=1e-5)
