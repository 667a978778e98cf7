"""Task frames of a motion: looked up when it begins, followed while it goes on; in lockstep."""
import numpy as np
import pytest

from gdmp_ros import Demonstration, ParameterError, Skill
from gdmp_ros.dmp.sequence import MotionStep, SkillSequence
from gdmp_ros.errors import GdmpError
from gdmp_ros.manifolds.poses import compose, tool_manifold
from gdmp_ros.playback.measured_input import MeasuredInput, MeasuredInputs
from gdmp_ros.playback.objects import Located, ObjectSettings
from gdmp_ros.playback.player import Player
from gdmp_ros.playback.settings import PlayerSettings, StreamSettings
from gdmp_ros.playback.states import State
from gdmp_ros.playback.streamer import Streamer
from gdmp_ros.util.profiles import minimum_jerk
from test.lockstep.clock import SteppedClock

PERIOD_NS = 1_000_000
#: The objects are looked at once in this many ticks.
LOOK = 20
POSE = tool_manifold(None)
DURATION = 2.0


def pose(x, y, z, yaw=0.0):
    return np.array([x, y, z, np.cos(yaw / 2.0), 0.0, 0.0, np.sin(yaw / 2.0)])


BOX, HOLE = pose(0.3, -0.2, 0.3), pose(0.5, 0.1, 0.2, 0.5)
#: The tool in the frame of the hole, at the end.
INSIDE = pose(0.0, 0.0, 0.05, 0.2)


def shown(goal='hole'):
    times = np.linspace(0.0, DURATION, 200)
    ends = compose(HOLE, INSIDE)
    points = np.array([POSE.geodesic(BOX, ends, float(s))
                       for s in minimum_jerk(times / DURATION)])
    points[:, 2] += 0.1 * np.sin(np.pi * times / DURATION) ** 2
    return Demonstration(times, points, POSE, frames={'box': BOX, goal: HOLE})


@pytest.fixture(scope='module')
def skill():
    return Skill.learn(shown(), start_frame='box', goal_frame='hole')


class Camera:
    """
    Sees objects at 30 Hz, each a time ago; lockstep: it is asked by the tick.

    :ivar where: gives the pose of an object at a time [s]; None while it is hidden
    """

    def __init__(self, where, latency=0.08):
        self.where, self.latency = where, latency
        self.now, self.offset = 0.0, 0.0
        self._newest = {}

    def catch_up(self):
        pass

    def locate(self, name):
        stamp = np.floor((self.now - self.latency) * 30.0) / 30.0
        seen = self.where(name, stamp)
        if seen is not None:
            self._newest[name] = seen, stamp
        if name not in self._newest:
            raise ParameterError(f'frame {name!r} is not connected')
        seen, stamp = self._newest[name]
        return Located(seen, round((100.0 + stamp) * 1e9), self.now - stamp + self.offset)


class Run:
    """A streamer of a skill, in lockstep with a camera."""

    def __init__(self, skill, camera, settings=None, stream=None):
        measured = MeasuredInputs(MeasuredInput(
            SteppedClock(), lambda: (self.robot().copy(), 0.0), '/pose'))
        self.camera, self.ticks, self.rows = camera, 0, []
        self.robot = lambda: self.rows[-1][:7] if self.rows else BOX
        self.streamer = Streamer(
            PERIOD_NS, measured, StreamSettings(**(stream or {})), PlayerSettings(),
            objects=camera, object_settings=settings or ObjectSettings(
                objects=('box',), moving_objects=('hole',)))
        self.streamer.use(skill, 'insert')
        self.streamer.activate(PERIOD_NS)

    def go(self, seconds, look=True):
        for _ in range(round(seconds * 1e3)):
            self.ticks += 1
            self.camera.now = self.ticks * 1e-3
            target = self.streamer.tick(self.ticks * PERIOD_NS, 0.05)
            if target is not None:
                self.rows.append(target.copy())
            if look and self.ticks % LOOK == 0:
                self.streamer.follow_objects()
        return self

    def begin(self, **options):
        self.go(0.1)
        self.streamer.begin(**options)
        return self

    @property
    def error(self):
        """Distance of the reference from where the hole wants the tool now [m]."""
        wanted = compose(self.camera.where('hole', self.camera.now), INSIDE)
        return float(np.linalg.norm(self.rows[-1][:3] - wanted[:3]))

    @property
    def refused(self):
        return self.streamer.refusals.last


def standing(name, time):
    return {'box': BOX, 'hole': HOLE}[name]


def belt(speed, begins=0.0, ends=1e9):
    """A hole that moves along y."""
    def where(name, time):
        moved = speed * (np.clip(time, begins, ends) - begins)
        return BOX if name == 'box' else HOLE + [0.0, moved, 0.0, 0.0, 0.0, 0.0, 0.0]
    return where


def test_a_hole_that_moves_is_met_and_followed_by_the_stamps_of_the_camera(skill):
    run = Run(skill, Camera(belt(0.05))).begin().go(4.0)
    player = run.streamer.player
    assert player.rollout.finished and player.state is State.MOVING  # the goal moves on
    # Without the stamps it would be behind by 0.05 m/s * 0.08 s = 4 mm.
    assert run.error < 3e-4
    assert np.linalg.norm(player.goal[:3] - run.rows[-1][:3]) < 3e-4
    acceleration = np.diff(np.array(run.rows)[200:, :3], 2, axis=0) * 1e6
    assert np.abs(acceleration).max() < 2.0
    assert run.streamer.refusals.count == 0


def test_a_look_while_a_motion_is_being_prepared_does_not_end_its_following(skill, monkeypatch):
    """Another thread looks: after the end of a motion, whose goal was switched."""
    run = Run(skill, Camera(belt(0.05))).begin().go(1.0)
    run.streamer.commands.goal_pose(compose(HOLE, INSIDE), run.streamer.now)
    run.go(4.0)
    assert run.streamer.player.state is State.FINISHED
    start = Player.start

    def looked_at(player, *rest):
        run.streamer.follow_objects()
        result = start(player, *rest)
        run.streamer.follow_objects()
        return result
    monkeypatch.setattr(Player, 'start', looked_at)
    run.streamer.begin()
    run.streamer.follow_objects()
    run.go(4.0)
    assert run.streamer.player.rollout.finished and run.error < 1e-3


def test_a_hole_that_comes_to_rest_ends_the_motion(skill):
    run = Run(skill, Camera(belt(0.05, ends=1.5))).begin().go(6.0)
    assert run.streamer.player.state is State.FINISHED
    assert run.error < 5e-4
    # The motion has ended: what moves then is not followed.
    run.camera.where = belt(0.1, begins=run.camera.now)
    before = run.rows[-1][:3].copy()
    run.go(2.0)
    assert np.linalg.norm(run.rows[-1][:3] - before) < 1e-3


def test_with_follow_goal_after_end_it_is_followed_then_too(skill):
    run = Run(skill, Camera(standing), stream={'follow_goal_after_end': True}).begin().go(4.0)
    assert run.streamer.player.state is State.FINISHED
    run.camera.where = belt(0.1, begins=run.camera.now)
    run.go(4.0)
    assert run.streamer.player.state is State.MOVING and run.error < 1e-3


def test_an_object_that_was_not_declared_moving_is_looked_up_once(skill):
    settings = ObjectSettings(objects=('hole',))
    run = Run(skill, Camera(belt(0.05)), settings).begin()
    seen = run.camera.locate('hole').pose
    run.go(4.0)
    assert run.streamer.player.state is State.FINISHED
    assert np.linalg.norm(run.rows[-1][:3] - compose(seen, INSIDE)[:3]) < 5e-4


def test_a_hole_that_is_hidden_rests_and_is_followed_again(skill):
    def hidden(name, time):
        return None if 1.0 < time < 2.5 else belt(0.05)(name, time)
    run = Run(skill, Camera(hidden)).begin().go(1.8)
    assert run.streamer.objects.lost
    assert 'object hole: no pose that can be used for 0.5' in run.refused
    rests = run.streamer.player.rollout.frames['hole'].copy()
    run.go(0.5)
    assert np.linalg.norm(run.streamer.player.rollout.frames['hole'] - rests) < 0.02
    run.go(3.5)
    assert not run.streamer.objects.lost and run.error < 1e-3
    assert run.streamer.refusals.count == 1
    acceleration = np.diff(np.array(run.rows)[200:, :3], 2, axis=0) * 1e6
    assert np.abs(acceleration).max() < 3.0


def test_a_pose_that_jumps_is_not_used_and_the_next_good_one_is(skill):
    def jumps(name, time):
        away = 0.4 if 1.0 < time < 1.05 else 0.0
        return standing(name, time) + [0.0, away, 0.0, 0.0, 0.0, 0.0, 0.0]
    run = Run(skill, Camera(jumps)).begin().go(4.0)
    assert 'object hole: it jumps by 0.4 m, expected at most 0.3 m (object_jump)' in run.refused
    assert run.streamer.refusals.count == 1 and run.error < 5e-4
    plain = Run(skill, Camera(standing)).begin().go(4.0)
    assert np.abs(np.array(run.rows)[:, :7] - np.array(plain.rows)[:, :7]).max() < 1e-6


def test_a_hole_that_goes_out_of_the_workspace_is_left_at_its_border(skill):
    run = Run(skill, Camera(belt(0.2))).begin().go(5.0)
    assert 'object hole: goal y is 0.8' in run.streamer.refusals.take_new()[0]
    assert 0.75 < run.rows[-1][1] < 0.95
    assert run.streamer.player.state is State.FINISHED


@pytest.mark.parametrize(('offset', 'reason'), [
    (2.0, r'its newest pose is 2\.\d+ s old, expected at most 0\.5 s \(object_age\)'),
    (-3.0, r'its stamp lies 2\.\d+ s in the future: the clocks')])
def test_a_motion_does_not_begin_with_a_pose_of_another_time(skill, offset, reason):
    run = Run(skill, Camera(standing)).go(0.1)
    run.camera.offset = offset
    with pytest.raises(GdmpError, match=f'object (box|hole): {reason}'):
        run.streamer.begin()
    assert run.streamer.player.motion == 0


def test_a_motion_does_not_begin_if_it_is_not_known_where_an_object_is(skill):
    run = Run(skill, Camera(lambda name, time: None)).go(0.1)
    with pytest.raises(GdmpError, match='is not connected'):
        run.streamer.begin()


def test_objects_that_are_given_with_the_start_are_not_looked_up(skill):
    run = Run(skill, Camera(belt(0.03))).begin(objects={'hole': HOLE}).go(4.0)
    assert np.linalg.norm(run.rows[-1][:3] - compose(HOLE, INSIDE)[:3]) < 5e-4
    # The next motion looks them up again.
    run.streamer.begin()
    run.go(4.0)
    assert run.error < 1e-3
    with pytest.raises(ParameterError, match="frame 'cup': the skill has no such frame"):
        run.streamer.begin(objects={'cup': HOLE})


def test_a_goal_switch_counts_for_more_than_what_is_seen_of_the_goal(skill):
    run = Run(skill, Camera(belt(0.05))).begin().go(1.0)
    goal = compose(HOLE, INSIDE) + [0.0, -0.1, 0.1, 0.0, 0.0, 0.0, 0.0]
    run.streamer.commands.goal_pose(goal, run.streamer.now)
    run.go(5.0)
    assert run.streamer.player.state is State.FINISHED
    assert np.linalg.norm(run.rows[-1][:3] - goal[:3]) < 1e-3


def test_a_hole_that_moves_while_the_reference_goes_to_the_robot_is_where_it_is_then(skill):
    run = Run(skill, Camera(standing)).begin().go(4.0)
    run.camera.where = belt(0.05, begins=run.camera.now)
    run.robot = lambda: BOX
    run.streamer.begin()  # the reference goes to the robot first
    run.robot = lambda: run.rows[-1][:7]
    assert run.go(0.1).streamer.player.state is State.APPROACHING
    run.go(8.0)
    assert run.streamer.player.rollout.finished and run.error < 1e-3


def test_a_slow_stream_meets_the_hole_when_it_has_time(skill):
    stream = {'stream_speed': 0.15}
    run = Run(skill, Camera(belt(0.05)), stream=stream).begin().go(8.0)
    speed = np.linalg.norm(np.diff(np.array(run.rows)[:, :3], axis=0), axis=1) * 1e3
    assert np.quantile(speed, 0.999) < 0.151 and speed.max() < 0.165  # of the last bounded tick
    assert run.error < 1e-3


def test_a_motion_that_the_stream_has_slowed_down_is_called_finished_beside_the_hole(skill):
    run = Run(skill, Camera(belt(0.05)), stream={'stream_speed': 0.12}).begin().go(1.0)
    rollout, behind = run.streamer.player.rollout, []
    assert run.streamer.bounds.tempo < 0.5
    while not rollout.finished:
        run.go(0.02)
        behind.append(np.linalg.norm((rollout.frames['hole'] - belt(0.05)(
            'hole', run.camera.now))[:3]))
    # A frame that waited with the motion would be behind by twice as much.
    assert max(behind) < 0.06
    for _ in range(50):
        assert run.error < 6e-4
        run.go(0.02)


def test_how_an_object_moves_is_known_when_a_motion_begins(skill):
    run = Run(skill, Camera(belt(0.05))).go(0.5).begin().go(0.06)
    assert run.streamer.player.rollout.frames_move
    frame = run.streamer.player.rollout.frames['hole']
    run.camera.where = lambda name, time: None  # its next pose does not come
    moved = run.go(0.4).streamer.player.rollout.frames['hole'] - frame
    assert moved[1] > 0.008


@pytest.mark.parametrize('hidden', [False, True], ids=['seen', 'hidden by the gripper'])
def test_what_the_tool_has_grasped_is_not_followed(skill, hidden):
    from dataclasses import replace
    views = [replace(skill.views[0], grasped=0.3), skill.views[1]]
    grasping = replace(skill, views=tuple(views))
    settings = ObjectSettings(moving_objects=('box', 'hole'))

    def carried(name, time):
        if name == 'hole' or not run.rows:
            return standing(name, time)
        player = run.streamer.player
        held = player.rollout is not None and player.rollout.progress > 0.3
        return (None if hidden else run.rows[-1][:7].copy()) if held else BOX
    run = Run(grasping, Camera(carried), settings)
    run.begin().go(4.0)
    plain = Run(skill, Camera(standing)).begin().go(4.0)
    assert np.abs(np.array(run.rows)[:, :7] - np.array(plain.rows)[:, :7]).max() < 1e-6
    assert run.streamer.player.state is State.FINISHED and run.streamer.refusals.count == 0


def test_the_steps_of_a_sequence_are_done_where_the_objects_are_when_it_begins(skill):
    run = Run(skill, Camera(standing)).go(0.1)
    moved = HOLE + [0.0, 0.1, 0.05, 0.0, 0.0, 0.0, 0.0]
    run.camera.where = lambda name, time: BOX if name == 'box' else moved
    run.go(0.2)
    run.streamer.begin_sequence(SkillSequence([MotionStep('insert', skill)]))
    run.go(4.0)
    assert np.linalg.norm(run.rows[-1][:3] - compose(moved, INSIDE)[:3]) < 5e-4


def test_a_motion_scaled_by_the_distance_does_not_swing_far_near_the_box(skill):
    near = pose(0.3, -0.18, 0.28, 0.0)
    heights = {}
    for scale in ('none', 'distance'):
        settings = ObjectSettings(moving_objects=('hole',), object_scale=scale)
        run = Run(skill, Camera(lambda name, time: near), settings).begin().go(4.0)
        heights[scale] = float(np.array(run.rows)[:, 2].max()) - BOX[2]
        assert run.error < 1e-3
    # The end is 0.03 m above the box, a tenth of the distance that was shown.
    assert heights['none'] > 0.1 and heights['distance'] < 0.03 + 0.2 * 0.1


def test_a_player_without_frames_refuses_one(letter):
    player = Player(letter, PlayerSettings())
    player.start(letter.start[:7])
    player.tick(1e-3)
    player.move_frame('hole', HOLE, 0.0)
    player.tick(1e-3)
    assert 'without task frames' in player.refusals.last
