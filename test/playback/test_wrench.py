"""A wrench that a demonstration recorded is exerted by the robot that repeats it."""
import numpy as np
import pytest

from gdmp_ros.control.target import resting_target, STIFFNESS, WRENCH, WRENCH_GAIN
from gdmp_ros.data import bags, recordings
from gdmp_ros.data.skills import LearningSettings, skill_from_bags
from gdmp_ros.errors import DataError
from gdmp_ros.playback.player import Player
from gdmp_ros.playback.settings import PlayerSettings
from gdmp_ros.playback.states import Status
from gdmp_ros.sim import Arm, ClosedLoop
from gdmp_ros.sim.scenes import cloth_table
from gdmp_ros.util.profiles import smoothstep

FRAME, WIPING, FORCE = 'panda_link0', 3.0, 8.0
ONLY_WRENCH = {'pose_topic': recordings.POSE_TOPIC, 'wrench_topic': '/ft/wrench'}


def loop_over(height):
    """An arm over a table with a cloth, ``height`` higher than the one of the demonstration."""
    return ClosedLoop(Arm(cloth_table(0.03 - height)))


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    """Somebody wipes a table with 8 N: down, 0.1 m along it with the force, and up."""
    loop, path = loop_over(0.0), tmp_path_factory.mktemp('wiping') / 'take'
    start = loop.arm.measure().pose.copy()
    rng = np.random.default_rng(1)
    with bags.BagWriter(path) as writer:
        for k in range(round(1000 * WIPING)):
            s = k / (1000 * WIPING)
            down, along = smoothstep(min(s / 0.3, 1.0)), smoothstep(np.clip(s / 0.8 - 0.1, 0, 1))
            up = smoothstep(np.clip((s - 0.8) / 0.2, 0.0, 1.0))
            target = resting_target(start)
            target[:3] += [0.0, 0.1 * along, -0.03 * down + 0.03 * up]
            target[WRENCH + 2] = -FORCE * smoothstep(np.clip((s - 0.3) / 0.1, 0, 1)) * (1 - up)
            target[WRENCH_GAIN + 2] = 5.0
            loop.follow(target)
            tick = loop.tick()
            stamp = recordings.EPOCH_NS + k * 1_000_000
            noise = 0.3 * rng.standard_normal(6) * [1, 1, 1, 0.03, 0.03, 0.03]
            writer.pose(recordings.POSE_TOPIC, stamp, tick.measurement.pose, FRAME)
            writer.wrench('/ft/wrench', stamp + 300_000, tick.wrench + noise, FRAME)
            writer.wrench('/ft/in_sensor_frame', stamp, tick.wrench, 'ft_sensor')
    return path


@pytest.fixture(scope='module')
def learned(bag):
    return skill_from_bags([bag], LearningSettings(wrench_topic='/ft/wrench'))


def wipe(skill, height, gain=5.0):
    """Forces on the tool while it wipes, and the player."""
    loop, player = loop_over(height), Player(skill, PlayerSettings(wrench_gain=gain))
    player.start(loop.arm.measure().pose.copy())
    forces = []
    for _ in range(round(1000 * skill.duration)):
        loop.follow(player.tick(1e-3))
        forces.append(loop.tick().wrench[2])
    return np.array(forces), player, loop


def test_the_demonstrated_wrench_is_part_of_the_skill(learned, tmp_path):
    skill, (shown,) = learned.skill, learned.demonstrations
    assert skill.manifold.names == ('position', 'orientation', 'wrench')
    # Exerted by the tool: downwards, although the table pushes upwards.
    assert shown.points[len(shown.points) // 2, 9] == pytest.approx(-FORCE, abs=1.5)
    skill.save(tmp_path / 'skill.json')
    again = type(skill).load(tmp_path / 'skill.json')
    np.testing.assert_array_equal(again.reproduce(0.01).points, skill.reproduce(0.01).points)


@pytest.mark.parametrize('height', [
    -0.01, *(pytest.param(one, marks=pytest.mark.long) for one in (0.0, 0.01))])
def test_a_table_that_is_elsewhere_is_wiped_with_the_demonstrated_force(bag, learned, height):
    forces, _, loop = wipe(learned.skill, height)
    middle = slice(round(0.5 * len(forces)), round(0.75 * len(forces)))
    assert np.sqrt(np.mean((forces[middle] - FORCE) ** 2)) < 1.0
    assert loop.controller.tank.energy > 0.0
    plain, _, _ = wipe(skill_from_bags([bag], LearningSettings(
        pose_topic=recordings.POSE_TOPIC)).skill, height)
    assert np.sqrt(np.mean((plain[middle] - FORCE) ** 2)) > 3.0


def test_a_motion_that_is_stopped_lets_the_wrench_go(learned):
    _, player, _ = wipe(learned.skill, 0.0)
    player.start(None)
    for _ in range(1500):
        target = player.tick(1e-3)
    assert target[WRENCH + 2] < -0.7 * FORCE and target[WRENCH_GAIN] == 5.0
    player.stop()
    last, steps = target.copy(), []
    for _ in range(1500):
        target = player.tick(1e-3)
        steps.append(abs(target[WRENCH + 2] - last[WRENCH + 2]))
        last = target.copy()
    assert player.status is Status.HOLDING and (target[WRENCH:] == 0.0).all()
    assert max(steps) < 0.01 * FORCE + 1e-9


def test_a_skill_without_a_wrench_takes_over_without_a_step(bag, learned):
    player = Player(learned.skill, PlayerSettings())
    player.start(None)
    for _ in range(1500):
        target = player.tick(1e-3)
    before = target.copy()
    player.load(skill_from_bags([bag], LearningSettings(pose_topic=recordings.POSE_TOPIC)).skill)
    player.start(None)
    target = player.tick(1e-3)
    assert abs(target[WRENCH + 2] - before[WRENCH + 2]) < 0.02 * FORCE
    for _ in range(1000):
        target = player.tick(1e-3)
    assert (target[WRENCH:] == 0.0).all()


def test_stiffness_and_wrench_go_together(learned):
    """Stiffness from the variance of takes, and the wrench of each."""
    shown = [recordings.Recording(one, '', FRAME, None, np.tile(one.points[:, 9:10], 6))
             for one in (learned.demonstrations[0],) for _ in range(1)]
    pose_only = [recordings.Recording(type(one.demonstration)(
        one.demonstration.times, one.demonstration.points[:, :7],
        recordings.tool_manifold(None)), '', FRAME, None, one.wrench) for one in shown]
    demonstrations, _ = recordings.with_stiffness(pose_only * 2, 'variance')
    both = recordings.with_wrench(pose_only * 2, demonstrations)
    assert both[0].manifold.names == ('position', 'orientation', 'stiffness', 'wrench')
    skill = type(learned.skill).learn(both)
    player = Player(skill, PlayerSettings())
    player.start(None)
    target = player.tick(1e-3)
    for _ in range(1500):
        target = player.tick(1e-3)
    matrix = target[STIFFNESS:STIFFNESS + 36].reshape(6, 6)
    assert np.linalg.eigvalsh(matrix)[0] > 1.0 and target[WRENCH + 2] < -0.5 * FORCE
    assert len(player.distances()) == 4


@pytest.mark.parametrize('topic, reason', [
    ('/ft/in_sensor_frame', "is in frame 'ft_sensor', expected 'panda_link0'"),
    ('/ft/none', 'no topic /ft/none'), (recordings.POSE_TOPIC, 'expected geometry_msgs/msg/Wr')])
def test_a_wrench_that_cannot_be_used_is_refused(bag, topic, reason):
    with pytest.raises(DataError, match=reason):
        skill_from_bags([bag], LearningSettings(wrench_topic=topic))
