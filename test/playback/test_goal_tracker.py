"""A goal that keeps moving: its velocity from poses with jitter and drop-outs; its end."""
import numpy as np
import pytest

from experiments.timing import demonstration
from gdmp_ros import Skill
from gdmp_ros.data.recordings import tool_manifold
from gdmp_ros.manifolds.poses import moved_on
from gdmp_ros.playback.goal_tracker import GoalTracker, TIME_OUT
from gdmp_ros.playback.player import Player
from gdmp_ros.playback.refusals import Refusals
from gdmp_ros.playback.settings import PlayerSettings

POSE = np.array([0.4, -0.3, 0.3, 0.0, 1.0, 0.0, 0.0])
BELT = np.array([0.0, 0.1, 0.0, 0.0, 0.0, 0.2])


def messages(rng, seconds, rate=30.0, jitter=0.005, lost=0.2, twist=BELT):
    """(arrival, pose) of a goal on a belt: late by some milliseconds, some never come."""
    for stamp in np.arange(0.0, seconds, 1.0 / rate):
        late = jitter * rng.random()
        if rng.random() >= lost:
            yield stamp + late, moved_on(POSE, twist, stamp)


def test_position_and_velocity_are_estimated_with_jitter_and_drop_outs(rng):
    tracker = GoalTracker()
    for arrival, pose in messages(rng, 4.0):
        goal = tracker.update(pose, arrival, arrival + 0.01)
        if arrival > 0.5:
            expected = moved_on(POSE, BELT, arrival + 0.01)
            assert np.linalg.norm(goal.pose[:3] - expected[:3]) < 1e-3
            assert np.abs(goal.twist - BELT).max() < 0.02


def test_a_pose_that_comes_late_does_not_stop_the_goal(rng):
    tracker = GoalTracker()
    for arrival, pose in messages(rng, 2.0, lost=0.0):
        goal = tracker.update(pose, arrival, arrival)
    late = tracker.update(moved_on(POSE, BELT, arrival - 0.02), arrival - 0.01, arrival + 0.005)
    assert np.abs(late.twist - goal.twist).max() < 1e-9
    np.testing.assert_allclose(late.pose, moved_on(goal.pose, goal.twist, 0.005), atol=1e-9)


def test_a_given_twist_ends_after_its_time():
    tracker = GoalTracker()
    tracker.follow(POSE, BELT, 5.0, 1.0)
    assert tracker.expired(5.9) is None
    np.testing.assert_allclose(tracker.present(5.9).pose, moved_on(POSE, BELT, 0.9))
    ended = tracker.expired(6.5)
    np.testing.assert_allclose(ended.pose, moved_on(POSE, BELT, 1.0))
    assert ended.twist is None and tracker.present(6.6) is None
    # Poses after it are another goal.
    tracker.follow(POSE, BELT, 7.0, 1.0)
    assert tracker.update(POSE, 7.1, 7.1).twist is None


def test_the_first_poses_count_alike(rng):
    """The estimate is the line of least squares through them."""
    times, tracker = 0.005 * np.arange(8), GoalTracker()
    places = 0.2 * times + 1e-3 * rng.standard_normal(8)
    for time, place in zip(times, places):
        goal = tracker.update(POSE + [place, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], time, time)
    slope, at = np.polyfit(times - times[-1], places, 1)
    assert goal.twist[0] == pytest.approx(slope)
    assert goal.pose[0] - POSE[0] == pytest.approx(at)


def test_a_goal_at_rest_has_no_velocity_and_is_where_it_was_seen(rng):
    tracker = GoalTracker()
    for time in np.arange(0.0, 2.0, 0.033):
        seen = POSE + np.concatenate([1e-4 * rng.standard_normal(3), np.zeros(4)])
        goal = tracker.update(seen, time, time)
        assert goal.twist is None
        np.testing.assert_array_equal(goal.pose, seen)
    assert tracker.expired(100.0) is None


def test_another_goal_far_away_does_not_move(rng):
    tracker = GoalTracker()
    for time in np.arange(0.0, 1.0, 0.033):
        tracker.update(moved_on(POSE, BELT, time), time, time)
    other = POSE + [0.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    goal = tracker.update(other, 1.0, 1.0)
    assert goal.twist is None
    np.testing.assert_array_equal(goal.pose, other)


def test_when_the_poses_end_the_goal_rests_where_it_was_seen(rng):
    tracker = GoalTracker()
    for time in np.arange(0.0, 1.0, 0.033):
        last = moved_on(POSE, BELT, time)
        tracker.update(last, time, time)
    assert tracker.expired(time + 0.9 * TIME_OUT) is None
    stopped = tracker.expired(time + 1.1 * TIME_OUT)
    assert stopped.twist is None
    np.testing.assert_array_equal(stopped.pose, last)


@pytest.mark.parametrize('given', [False, True])
def test_the_reference_follows_a_goal_on_a_belt(given, rng):
    """Within 1 mm at 0.1 m/s, calmly; the motion finishes while it follows."""
    player = Player(Skill.learn(demonstration(tool_manifold(3), 4.0)), PlayerSettings(),
                    Refusals())
    player.start(None)
    player.tick(0.0)
    start = player.goal
    tracker, due = GoalTracker(), list(messages(rng, 8.0))
    accelerations, lags, now = [], [], 0.0
    for tick in range(9000):
        now = 1e-3 * tick
        while due and due[0][0] <= now and now < 8.0:
            arrival, pose = due.pop(0)
            moved = np.concatenate([start[:3] + pose[:3] - POSE[:3], start[3:]])
            twist = np.concatenate([BELT[:3], np.zeros(3)])
            goal = tracker.update(moved, arrival, now)
            if not given:
                player.go_to(goal.pose, goal.twist)
            elif tick < 100:
                player.go_to(moved_on(moved, twist, now - arrival), twist)
        target = player.tick(1e-3)
        accelerations.append(target[13:16].copy())
        if 5.5 < now < 8.0:
            expected = start[:3] + now * BELT[:3]
            lags.append(np.linalg.norm(target[:3] - expected))
    assert max(lags) <= 1e-3
    assert np.abs(np.diff(accelerations[10:8000], axis=0)).max() <= 0.02
    assert player.status == 'moving' and player.rollout.finished and player.rollout.flags == set()
    if not given:
        assert player.distances()[0] < 0.001
