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
from gdmp_ros.playback.player_settings import PlayerSettings
from gdmp_ros.playback.stream_settings import StreamSettings
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
