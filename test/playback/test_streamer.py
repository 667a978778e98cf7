"""Streaming without ROS: which measured pose is used, and when; what a tick must not do."""
import subprocess
import sys

import numpy as np
import pytest

from gdmp_ros import ParameterError
from gdmp_ros.errors import GdmpError
from gdmp_ros.playback.measured_input import MeasuredInput, MeasuredInputs
from gdmp_ros.playback.objects import ObjectSettings
from gdmp_ros.playback.robot_watch import RobotSettings
from gdmp_ros.playback.settings import PlayerSettings, StreamSettings
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
from gdmp_ros.playback.objects import ObjectSettings
from gdmp_ros.playback.robot_watch import RobotSettings
from gdmp_ros.playback.settings import PlayerSettings, StreamSettings
from gdmp_ros.playback.streamer import Streamer
from gdmp_ros.playback.measured_input import MeasuredInput, MeasuredInputs
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


def advance(streamer, count):
    """Let time go on from the last tick."""
    for tick in range(streamer.ticks + 1, streamer.ticks + 1 + count):
        target = streamer.tick(tick * PERIOD_NS, 0.05)
    return target


def test_a_goal_after_the_end_is_refused_unless_it_is_to_be_followed(skill, source):
    for follow in (False, True):
        source.pose = skill.start[:7].copy()
        streamer = streamer_of(skill, source)
        streamer.configure(StreamSettings(follow_goal_after_end=follow),
                           PlayerSettings(phase_stopping=0.0), RobotSettings(),
                           ObjectSettings())
        advance(streamer, READ_EVERY)
        streamer.begin()
        advance(streamer, round(2000 * skill.duration))
        assert streamer.player.status == 'holding' and streamer.player.rollout.finished
        goal = skill.goal[:7] + [0.0, 0.05, 0.0, 0.0, 0.0, 0.0, 0.0]
        if not follow:
            with pytest.raises(ParameterError, match='ended; start a motion, or set follow_goal'):
                streamer.commands.goal_pose(goal, streamer.now)
            continue
        streamer.commands.goal_pose(goal, streamer.now)
        np.testing.assert_allclose(advance(streamer, 6000)[:3], goal[:3], atol=1e-3)


@pytest.mark.parametrize('speed', [0.15, 0.6])
def test_a_goal_that_moves_on_rests_in_time_and_in_the_workspace(skill, source, speed):
    source.pose = skill.start[:7].copy()
    streamer = streamer_of(skill, source)
    streamer.configure(StreamSettings(), PlayerSettings(phase_stopping=0.0), RobotSettings(),
                       ObjectSettings())
    advance(streamer, READ_EVERY)
    streamer.begin()
    advance(streamer, 200)
    goal, twist = skill.goal[:7].copy(), np.array([0.0, speed, 0.0, 0.0, 0.0, 0.0])
    goal[1] = 0.4
    streamer.commands.moving_goal(goal, twist, streamer.now)
    advance(streamer, 500)
    assert streamer.player.status == 'moving'
    reference = advance(streamer, round(3000 * skill.duration))
    assert streamer.player.status == 'holding'
    expected = min(0.4 + speed, StreamSettings().workspace_max[1])
    assert reference[1] == pytest.approx(expected, abs=0.5 * READ_EVERY * 1e-3 * speed + 0.03)
    assert reference[1] <= StreamSettings().workspace_max[1] + 1e-3
    assert (streamer.refusals.count > 0) == (speed == 0.6)
    with pytest.raises(GdmpError, match='speed of the goal is 50 m/s, expected at most stream_sp'):
        streamer.begin()
        advance(streamer, 50)
        streamer.commands.moving_goal(skill.goal[:7], np.array([50.0, 0, 0, 0, 0, 0]),
                                      streamer.now)


def test_a_loop_that_looks_around_and_fails_is_told(skill, source):
    streamer, clock = streamer_of(skill, source), SteppedClock()

    def looking():
        yield clock.now() + PERIOD_NS
        raise ValueError('broken')
    assert streamer.failure is None
    streamer.looking = clock.start(looking())
    clock.run_until(clock.now() + 3 * PERIOD_NS)
    assert str(streamer.failure) == 'broken'
