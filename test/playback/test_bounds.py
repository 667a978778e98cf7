"""The stream stays inside its bounds, and is what the player says where it is inside them."""
import numpy as np
import pytest

from gdmp_ros.control.target import resting_target
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.manifolds.poses import compose, inverse, tool_manifold
from gdmp_ros.manifolds.product import Product
from gdmp_ros.manifolds.quaternion import rotation_angles
from gdmp_ros.playback.bounds import StreamBounds
from gdmp_ros.playback.player import Player
from gdmp_ros.playback.settings import PlayerSettings, StreamSettings
from gdmp_ros.playback.streamed_skill import StreamedSkill
from gdmp_ros.util.profiles import minimum_jerk

DT = 1e-3
SKILL = StreamedSkill(Skill.learn(Demonstration(
    np.linspace(0.0, 1.0, 50), np.tile([0.4, 0.0, 0.4, 1.0, 0.0, 0.0, 0.0], (50, 1)),
    tool_manifold(None)), 10), PlayerSettings())
START = np.array([0.4, 0.0, 0.4, 1.0, 0.0, 0.0, 0.0])


def stream(speed, angular, seconds=1.0, after=2.0, **settings):
    """A motion from rest to rest along y and about z; what was asked and what is streamed."""
    bounds, asked, shown = StreamBounds(StreamSettings(**settings)), [], []
    for k in range(round((seconds + after) / DT)):
        u = min(k * DT / seconds, 1.0)
        # Minimum jerk: the largest speed is 15/8 of the mean.
        way = u ** 3 * (10 - 15 * u + 6 * u * u)
        rate = 30 * u * u * (1 - u) ** 2 / seconds
        length, angle = 8 / 15 * speed * seconds, 8 / 15 * angular * seconds
        target = resting_target(START)
        target[1] = length * way
        target[3:7] = [np.cos(0.5 * angle * way), 0, 0, np.sin(0.5 * angle * way)]
        target[8], target[12] = length * rate, angle * rate
        target[14] = length * 60 * u * (1 - u) * (1 - 2 * u) / seconds ** 2
        asked.append(target.copy())
        shown.append(bounds.apply(SKILL, target, DT).copy())
    return np.array(asked), np.array(shown), bounds


def test_a_motion_inside_the_bounds_is_streamed_as_it_is():
    asked, shown, bounds = stream(1.2, 1.5)
    np.testing.assert_array_equal(asked, shown)
    assert bounds.bounded == 0


@pytest.mark.parametrize('speed, angular', [(4.0, 0.0), (0.0, 6.0), (4.0, 6.0)])
def test_a_faster_motion_is_bounded_and_arrives(speed, angular):
    asked, shown, bounds = stream(speed, angular, after=4.0)
    assert bounds.bounded > 100
    steps = np.diff(shown[:, :3], axis=0) / DT
    turns = rotation_angles(shown[1:, 3:7], shown[:-1, 3:7]) / DT
    assert np.linalg.norm(steps, axis=1).max() <= 1.5 * 1.001
    assert turns.max() <= 2.0 * 1.001
    accelerations = np.linalg.norm(np.diff(shown[:, 7:10], axis=0), axis=1) / DT
    assert accelerations.max() <= 10.0 * 1.001
    np.testing.assert_allclose(shown[-1], asked[-1], atol=1e-9)
    # The streamed velocity is that of the streamed position.
    np.testing.assert_allclose(steps, 0.5 * (shown[1:, 7:10] + shown[:-1, 7:10]), atol=0.02)


def test_a_jump_becomes_a_motion():
    bounds = StreamBounds(StreamSettings())
    bounds.apply(SKILL, resting_target(START), DT)
    target, shown = resting_target(START), []
    target[1] += 0.3
    for _ in range(3000):
        shown.append(bounds.apply(SKILL, target, DT).copy())
    shown = np.array(shown)
    assert np.linalg.norm(np.diff(shown[:, :3], axis=0), axis=1).max() <= 1.5e-3
    np.testing.assert_allclose(shown[-1], target, atol=1e-9)


def test_without_bounds_everything_passes():
    asked, shown, _ = stream(9.0, 9.0, stream_speed=0.0, stream_acceleration=0.0,
                             stream_angular_speed=0.0, stream_angular_acceleration=0.0)
    np.testing.assert_array_equal(asked, shown)


def test_two_tools_that_belong_together_stay_together():
    """Both turn about an axis near the first one, faster than allowed."""
    s = np.linspace(0.0, 1.0, 200)
    angle = 1.2 * minimum_jerk(s)
    points = []
    for arm in (-0.1, 0.5):
        points.append(np.column_stack([
            0.4 - arm * np.sin(angle), arm * np.cos(angle), np.full(200, 0.4),
            np.cos(0.5 * angle), 0.0 * s, 0.0 * s, np.sin(0.5 * angle)]))
    manifold = Product(*(2 * tool_manifold(None).factors), names=('a', 'b', 'c', 'd'))
    skill = Skill.learn(Demonstration(0.5 * s, np.hstack(points), manifold), 40)
    player, bounds = Player(skill, PlayerSettings()), StreamBounds(StreamSettings())
    player.start(None)
    first = np.concatenate([points[0][0], points[1][0]])
    assert np.allclose(first[7:10] - first[:3], [0.0, 0.6, 0.0])
    shown = []
    for _ in range(4000):
        target = player.tick(DT, bounds.tempo)
        shown.append(bounds.apply(player.playing, target, DT).copy())
    shown = np.array(shown)
    assert bounds.bounded > 100
    for row in shown[::10]:
        relative = compose(inverse(row[:7]), row[68:75])
        assert np.linalg.norm(relative[:3] - [0.0, 0.6, 0.0]) < 1e-3
    for at in (0, 68):
        twists = shown[:, at + 7:at + 13]
        assert np.linalg.norm(twists[:, :3], axis=1).max() <= 1.5 * 1.001
        assert np.linalg.norm(twists[:, 3:], axis=1).max() <= 2.0 * 1.001
        changes = np.diff(twists, axis=0) / DT
        assert np.linalg.norm(changes[:, :3], axis=1).max() <= 10.0 * 1.001
        assert np.linalg.norm(changes[:, 3:], axis=1).max() <= 20.0 * 1.001
    np.testing.assert_allclose(shown[-1], target, atol=1e-9)


@pytest.fixture(scope='module')
def corner():
    """A skill that turns back within 40 ms, at 0.6 m/s: 30 m/s^2, where 10 are allowed."""
    times = np.linspace(0.0, 1.2, 600)
    speed = 0.6 * np.clip((0.6 - times) / 0.02, -1.0, 1.0) * minimum_jerk(
        np.minimum(np.minimum(times, 1.2 - times) / 0.3, 1.0))
    points = np.tile(START, (600, 1))
    points[:, 1] += np.cumsum(speed) * times[1]
    return Skill.learn(Demonstration(times, points, tool_manifold(None)), 200)


def played(skill, known, seconds=4.0, request=None):
    """Target of the player, bounded reference, player and bounds, at every tick of a motion."""
    player, bounds = Player(skill, PlayerSettings()), StreamBounds(StreamSettings())
    player.start(None)
    for k in range(round(seconds / DT)):
        if request is not None and k == 300:
            request(player)
        target = player.tick(DT, bounds.tempo)
        rollout = player.rollout if known else None
        yield target, bounds.apply(player.playing, target, DT, rollout), player, bounds


@pytest.mark.parametrize('known', [True, False])
def test_a_corner_is_slowed_down_for_before_it_comes(corner, known):
    pairs = np.array([(target.copy(), shown.copy()) for target, shown, *_ in
                      played(corner, known)])
    away = np.linalg.norm(pairs[:, 0, :3] - pairs[:, 1, :3], axis=1).max()
    changes = np.diff(pairs[:, 1, 7:10], axis=0) / DT
    assert np.linalg.norm(changes, axis=1).max() <= 10.0 * 1.001
    # Without looking ahead the reference leaves the path.
    assert away < 1e-9 if known else away > 2e-3
    np.testing.assert_allclose(pairs[-1, 1], pairs[-1, 0], atol=1e-9)


@pytest.mark.parametrize('request_', [
    None, lambda player: player.go_to(START + [0.1, 0.2, 0.0, 0.0, 0.0, 0.0, 0.0]),
    lambda player: player.set_speed(0.5)], ids=['none', 'goal', 'tempo'])
def test_what_follows_is_what_comes(corner, request_):
    """Soon after a request too."""
    expected, met = {}, 0
    for k, (_, _, player, bounds) in enumerate(played(corner, True, request=request_)):
        if k == 300:
            expected.clear()
        state = player.rollout.state
        for time in [one for one in expected if one <= state.time]:
            before = state.point[:3] - (state.time - time) * state.velocity[:3]
            np.testing.assert_allclose(before, expected.pop(time), atol=1e-4)
            met += 1
        if k % 100 == 50:
            numbers = bounds.ahead.state
            assert 0.0 < numbers[0] - state.time < 0.25
            expected[numbers[0]] = numbers[2:5].copy()
    assert met >= 10


def test_a_motion_that_is_allowed_less_time_is_slower_on_the_same_path(stream_of_letter):
    plain, slow = stream_of_letter(1.0), stream_of_letter(0.3)
    assert len(slow) > 2 * len(plain)
    # Each place of the slow one is on the path of the plain one.
    way = np.linalg.norm(slow[::50, None, :3] - plain[None, :, :3], axis=2).min(axis=1)
    assert way.max() < 1e-3
    speeds = np.linalg.norm(np.diff(slow[:, :3], axis=0), axis=1) / DT
    accelerations = np.abs(np.diff(speeds)) / DT
    fastest = np.linalg.norm(np.diff(plain[:, :3], axis=0), axis=1).max() / DT
    # The tempo falls with a time constant of 0.2 s.
    assert accelerations.max() < 5.0 * fastest + 2.0


@pytest.fixture
def stream_of_letter(letter):
    def references(allowed):
        player = Player(letter, PlayerSettings(phase_stopping=0.0))
        bounds, made = StreamBounds(StreamSettings()), []
        player.start(None)
        while not (player.rollout is not None and player.rollout.finished):
            if len(made) == 300:
                bounds.allow(allowed)
            target = player.tick(DT, bounds.tempo)
            made.append(bounds.apply(player.playing, target, DT, player.rollout).copy())
        return np.array(made)
    return references
