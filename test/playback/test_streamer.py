"""Streaming without ROS: which measured pose is used, and when; what a tick must not do."""
import subprocess
import sys

import numpy as np
import pytest

from gdmp_ros import ParameterError
from gdmp_ros.playback.measured_input import MeasuredInput, MeasuredInputs
from gdmp_ros.playback.player_settings import PlayerSettings
from gdmp_ros.playback.stream_settings import StreamSettings
from gdmp_ros.playback.streamer import READ_EVERY, Streamer
from test.lockstep.clock import SteppedClock

PERIOD_NS = 1_000_000


class Source:
    """A source of measured poses: gives what was set, once."""

    def __init__(self):
        self.pose, self.age, self.readings = None, 0.0, 0

    def __call__(self):
        self.readings += 1
        pose, self.pose = self.pose, None
        return None if pose is None else (pose, self.age)


@pytest.fixture
def skill(letter):
    return letter


@pytest.fixture
def source():
    return Source()


def streamer_of(skill, source, **player_settings):
    measured = MeasuredInputs(MeasuredInput(SteppedClock(), source, '/measured_pose'))
    made = Streamer(PERIOD_NS, measured, StreamSettings(), PlayerSettings(**player_settings))
    made.use(skill, 'skill')
    made.activate(PERIOD_NS)
    return made


def run(streamer, count):
    for tick in range(1, count + 1):
        target = streamer.tick(tick * PERIOD_NS, 0.05)
    return target


def test_a_motion_starts_at_the_newest_measured_pose(skill, source):
    streamer = streamer_of(skill, source)
    source.pose = skill.start[:7].copy()
    run(streamer, READ_EVERY)
    # The robot is moved by hand, and the motion is started before the next regular reading.
    moved = skill.start[:7] + [0.0, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0]
    source.pose = moved
    streamer.begin()
    np.testing.assert_allclose(run(streamer, 530)[:3], moved[:3], atol=5e-4)


def test_the_age_of_a_measured_pose_counts_from_its_arrival(skill, source):
    streamer = streamer_of(skill, source)
    source.pose, source.age = skill.start[:7].copy(), 0.7
    with pytest.raises(ParameterError, match=r'is 0\.70 s old, expected at most 0\.5 s'):
        streamer.begin()
    assert not streamer.robot_is_known()
    source.pose, source.age = skill.start[:7].copy(), 0.1
    streamer.begin()
    assert streamer.robot_is_known()


def test_without_a_measured_pose_nothing_is_streamed(skill, source):
    streamer = streamer_of(skill, source)
    assert run(streamer, READ_EVERY) is None
    source.pose = skill.start[:7].copy()
    np.testing.assert_array_equal(run(streamer, READ_EVERY + 1)[:7], skill.start[:7])


def test_ticks_read_the_measured_pose_at_a_low_rate(skill, source):
    for kappa in (0.0, 50.0):
        streamer = streamer_of(skill, source, phase_stopping=kappa)
        source.pose = skill.start[:7].copy()
        streamer.begin()
        run(streamer, 1)
        before = source.readings
        run(streamer, 5 * READ_EVERY)
        assert source.readings - before == 5


def test_the_phase_stops_while_the_robot_is_held(skill, source):
    streamer = streamer_of(skill, source, phase_stopping=50.0)
    source.pose = skill.start[:7].copy()
    streamer.begin()
    for tick in range(1, 1001):
        if tick % READ_EVERY == 0:
            source.pose = skill.start[:7] - [0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
        streamer.tick(tick * PERIOD_NS, 0.05)
    assert streamer.player.rollout.speed < 0.5


LOADING = """
from gdmp_ros import Skill
from gdmp_ros.kernels.cache import KernelCache
from gdmp_ros.playback.stream_settings import StreamSettings
from gdmp_ros.playback.streamer import Streamer
from gdmp_ros.playback.measured_input import MeasuredInput, MeasuredInputs
from gdmp_ros.playback.player_settings import PlayerSettings
from gdmp_ros.realtime.loop import SystemClock

loaded, load = [], KernelCache.load_overload
def watched(self, *arguments):
    loaded.append(self.cache_path)
    return load(self, *arguments)
KernelCache.load_overload = watched

skill = Skill.load({path!r})
robot = skill.start[:7].copy()
measured = MeasuredInput(SystemClock(), lambda: (robot.copy(), 0.0), '')
streamer = Streamer(1_000_000, MeasuredInputs(measured), StreamSettings(),
                    PlayerSettings(phase_stopping=1.0))
streamer.use(skill, '')
streamer.activate(1_000_000)
before = len(loaded)
assert before > 0
for tick in range(1, 300):
    if tick in (30, 120):
        streamer.begin()
    if tick == 60:
        streamer.commands.goal_pose(skill.goal[:7] + [0.0, 0.02, 0.0, 0.0, 0.0, 0.0, 0.0],
                                    streamer.now)
        streamer.player.request_copy()
    if tick == 200:
        streamer.player.stop()
    if tick == 250:
        streamer.player.hold(skill.start[:7])
    if tick == 260:
        robot[:3] += 0.1
        streamer.begin()
    streamer.tick(tick * 1_000_000, 0.05)
print(len(loaded) - before)
"""


def test_no_tick_loads_a_kernel(skill, tmp_path):
    # A new process: loading takes 25 ms at the first start of a motion.
    skill.save(tmp_path / 'skill.json')
    code = LOADING.format(path=str(tmp_path / 'skill.json'))
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True,
                          check=False)
    assert done.stdout == '0\n', done.stdout + done.stderr
