"""Sequences as streams of references, with pauses, stops and a gripper, without ROS."""
import numpy as np
import pytest

from gdmp_ros.control.target import ACCELERATION, POSE
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.primitive import GripperEvent
from gdmp_ros.dmp.sequence import GripperStep, HoldStep, MotionStep, SkillSequence
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import ParameterError
from gdmp_ros.manifolds.euclidean import Euclidean
from gdmp_ros.manifolds.poses import tool_manifold
from gdmp_ros.manifolds.product import Product
from gdmp_ros.playback.measured_input import MeasuredInput, MeasuredInputs
from gdmp_ros.playback.settings import PlayerSettings, StreamSettings
from gdmp_ros.playback.states import Status
from gdmp_ros.playback.streamer import Streamer
from gdmp_ros.scene.route import Tool
from gdmp_ros.scene.scene import Scene
from gdmp_ros.scene.volume import Volume
from gdmp_ros.util.profiles import minimum_jerk
from test.lockstep.clock import SteppedClock
from test.motions import circles
from test.playback.hand import Hand

MS = 1_000_000
HOME = np.array([0.4, 0.0, 0.5, 0.0, 1.0, 0.0, 0.0])


@pytest.fixture(scope='module')
def skills():
    manifold, s = tool_manifold(None), np.linspace(0.0, 1.0, 200)
    blend = minimum_jerk(s)[:, None]
    made = []
    for way in ([0.0, 0.1, -0.05], [0.05, -0.1, 0.0]):
        points = np.tile(HOME, (len(s), 1))
        points[:, :3] += blend * way
        made.append(Skill.learn(Demonstration(s, points, manifold), 30))
    return [*made, Skill.learn_rhythmic(circles(HOME, 0.03, 3.3))]


@pytest.fixture
def stream():
    hand = Hand()
    pose = MeasuredInput(SteppedClock(), lambda: (HOME, 0.0), '/pose', 'pose')
    streamer = Streamer(MS, MeasuredInputs(pose), StreamSettings(),
                        PlayerSettings(phase_stopping=0.0), gripper=hand)
    streamer.activate(MS)
    streamer.hand, streamer.clock = hand, MS
    return streamer


def run(stream, ticks, act=lambda tick: None):
    targets = []
    for tick in range(ticks):
        act(tick)
        stream.clock += MS
        target = stream.tick(stream.clock, 1.0)
        if target is not None:
            targets.append(target.copy())
    return np.array(targets)


def test_all_kinds_of_steps_are_executed_without_a_step(stream, skills):
    first, second, wipe = skills
    sequence = SkillSequence([MotionStep('there', first, blend=0.3), MotionStep('back', second),
                         GripperStep('close', GripperEvent(0.0, 0.02, 0.0, 0.1)),
                         MotionStep('wipe', wipe, cycles=2.0, blend=0.1),
                         MotionStep('away', first), HoldStep('wait', 0.2)])
    stream.begin_sequence(sequence)
    seen, times = [], []

    def act(tick):
        status = stream.sequence.status
        if status.running and (not seen or seen[-1] != status.step_name):
            seen.append(status.step_name)
            times.append(tick)
    targets = run(stream, 7000, act)
    assert seen == ['there', 'back', 'close', 'wipe', 'away', 'wait']
    assert [command.width for command in stream.hand.sent] == [0.02]
    # 'there' is left 0.3 s before its end of 1 s (and 0.2 s of growing tempo).
    assert 650 < times[1] < 1000
    status = stream.sequence.status
    assert not status.running and not status.problem and status.step == 6
    changes = np.abs(np.diff(targets[:, ACCELERATION:ACCELERATION + 6], axis=0)).max(axis=1)
    # The filter of a motion of 1 s has a time constant of 33 ticks. A step in one tick would be
    # many times larger than the changes in the ticks after it.
    for tick in np.flatnonzero(changes > 0.05):
        assert changes[tick] < 2.0 * changes[tick + 1:tick + 6].max()
    np.testing.assert_allclose(targets[-1, POSE:POSE + 3], first.goal[:3], atol=1e-3)


def test_pause_stop_and_another_motion(stream, skills):
    first, _, wipe = skills
    sequence = SkillSequence([MotionStep('there', first), HoldStep('wait', 0.5),
                         MotionStep('wipe', wipe, until='enough')])
    stream.begin_sequence(sequence)
    run(stream, 300)
    stream.pause(True)
    run(stream, 3000)
    assert stream.sequence.status.step_name == 'there'
    stream.pause(False)
    run(stream, 2500)
    assert stream.sequence.status.step_name == 'wipe'
    stream.stop_motion()
    run(stream, 1000)
    assert stream.sequence.status.problem == 'stopped'
    assert stream.player.status is Status.HOLDING
    # Restart at a step, and let another motion take over.
    stream.begin_sequence(sequence, 2)
    run(stream, 500)
    assert stream.sequence.status.running and stream.player.rollout.skill.rhythmic
    stream.use(first, 'first')
    stream.begin()
    run(stream, 2000)
    assert stream.sequence.status.problem == 'another motion was started'
    assert stream.player.rollout.finished


def test_a_gripper_that_fails_ends_the_sequence_with_the_reason(stream, skills):
    first, second, _ = skills
    close = GripperStep('close', GripperEvent(0.0, 0.02, 0.0, 0.1))
    stream.hand.fails = 'it is jammed'
    stream.begin_sequence(SkillSequence([MotionStep('there', first), close,
                                    MotionStep('back', second)]))
    run(stream, 3000)
    status = stream.sequence.status
    assert status.gripper_failed and status.problem == 'gripper: it is jammed'
    assert status.step == 2 and stream.player.status is Status.HOLDING
    stream.hand.known = False
    with pytest.raises(ParameterError, match='no state of one is known'):
        stream.begin_sequence(SkillSequence([MotionStep('there', first), close]))


def test_frequency_and_amplitude_belong_to_a_rhythmic_motion(stream, skills):
    first, _, wipe = skills
    stream.use(first, 'first')
    stream.begin()
    run(stream, 100)
    for command in (stream.commands.amplitude, stream.commands.frequency):
        with pytest.raises(ParameterError, match='is not rhythmic'):
            command(0.5)
    stream.use(wipe, 'wipe')
    stream.begin()
    run(stream, 3000)
    stream.commands.frequency(1.5)
    run(stream, 1000)
    assert stream.player.rollout.frequency == pytest.approx(1.5)
    stream.player.pause(True)
    run(stream, 500)
    assert stream.player.rollout.frequency == 0.0
    stream.player.pause(False)
    run(stream, 500)
    assert stream.player.rollout.frequency == pytest.approx(1.5)
    # The next motion has its own tempo again.
    stream.use(first, 'first')
    stream.begin()
    run(stream, 1000)
    assert stream.player.rollout.speed == pytest.approx(1.0)
    with pytest.raises(ParameterError, match='cycles: the skill is not rhythmic'):
        stream.begin(cycles=2.0)


def test_no_step_begins_while_it_is_paused(stream, skills):
    first, second, wipe = skills
    sequence = SkillSequence([MotionStep('there', first, blend=0.3), HoldStep('wait', 0.5),
                         MotionStep('wipe', wipe, until='enough', blend=0.1),
                         MotionStep('back', second)])
    stream.begin_sequence(sequence)
    run(stream, 880)  # just before its end
    stream.pause(True)
    run(stream, 2000)
    assert stream.sequence.status.step_name == 'there'
    stream.pause(False)
    for _ in range(300):
        run(stream, 10)
        if stream.sequence.status.step_name == 'wait':
            break
    stream.pause(True)
    run(stream, 2000)
    assert stream.sequence.status.step_name == 'wait'
    stream.pause(False)
    run(stream, 1500)
    stream.pause(True)
    stream.sequence.signal('enough')
    run(stream, 1000)
    assert stream.sequence.status.step_name == 'wipe' and stream.player.rollout.speed == 0.0
    stream.pause(False)
    run(stream, 3000)
    assert not stream.sequence.status.running and not stream.sequence.status.problem


def test_a_sequence_that_does_not_begin_with_a_motion_stops_the_present_one(stream, skills):
    first, _, wipe = skills
    stream.use(wipe, 'wipe')
    stream.begin()
    run(stream, 1500)
    stream.begin_sequence(SkillSequence([GripperStep('close', GripperEvent(0.0, 0.02, 0.0, 0.1)),
                                    MotionStep('there', first)]))
    speeds = []
    run(stream, 3000, lambda tick: speeds.append(
        (len(stream.hand.sent), stream.player.rollout is not None
         and stream.player.rollout.speed > 0.0)))
    assert not any(moves for sent, moves in speeds[:400] if sent)
    assert stream.sequence.status.problem == '' and not stream.sequence.status.running


def test_the_gripper_commands_of_skills_are_carried_out_before_the_next_step(stream, skills):
    first, second, _ = skills
    grasp = first.with_events([GripperEvent(0.95, 0.01, 0.0, 0.1)])
    sequence = SkillSequence([MotionStep('grasp', grasp, blend=0.3), MotionStep('back', second)])
    stream.begin_sequence(sequence)
    run(stream, 4000)
    assert [command.width for command in stream.hand.sent] == [0.01]
    assert not stream.sequence.status.running and not stream.sequence.status.problem
    stream.hand.fails = 'it is jammed'
    stream.begin_sequence(sequence)
    run(stream, 4000)
    status = stream.sequence.status
    assert status.step == 1 and status.problem == 'gripper: it is jammed'
    stream.hand.known = False
    with pytest.raises(ParameterError, match='no state of one is known'):
        stream.begin_sequence(sequence)


@pytest.mark.parametrize('progress', [0.95, 1.0])
def test_a_gripper_command_near_the_end_is_awaited(stream, skills, progress):
    first, second, _ = skills
    stream.hand.needs, stream.hand.fails = 1000, 'it is jammed'
    grasp = first.with_events([GripperEvent(progress, 0.01, 0.0, 0.1)])
    stream.begin_sequence(SkillSequence([MotionStep('grasp', grasp), MotionStep('back', second)]))
    run(stream, 2000)
    status = stream.sequence.status
    assert status.running and status.step == 1 and len(stream.hand.sent) == 1
    run(stream, 1000)
    assert stream.sequence.status.problem == 'gripper: it is jammed'
    # Executed alone.
    stream.use(grasp, 'grasp')
    stream.begin()
    run(stream, 2000)
    assert stream.player.rollout.finished and stream.gripper.waits_for_more(stream.player)
    run(stream, 1000)
    motion = stream.player.motion
    assert stream.gripper.problem(motion) == 'gripper: it is jammed'
    # The next motion has none.
    stream.use(first, 'first')
    stream.begin()
    run(stream, 10)
    assert stream.player.motion == motion + 1 and not stream.gripper.problem(motion + 1)


def test_a_gripper_that_was_restarted_has_not_carried_out_a_command(stream, skills):
    first, second, _ = skills
    stream.hand.before = 7
    stream.begin_sequence(SkillSequence([
        MotionStep('there', first), GripperStep('close', GripperEvent(0.0, 0.02, 0.0, 0.1)),
        MotionStep('back', second)]))
    while not stream.hand.sent:
        run(stream, 10)
    stream.hand.before = -1
    run(stream, 200)
    status = stream.sequence.status
    assert status.gripper_failed and 'restarted' in status.problem and status.step == 2


def test_what_is_asked_before_a_motion_begins_belongs_to_it(stream, skills):
    """A start far from the reference, and one near it on the way: nothing stays in a queue."""
    first, _, wipe = skills
    stream.use(first, 'first')
    stream.begin()
    run(stream, 1500)
    player = stream.player
    player.stop()
    run(stream, 500)
    stream.use(wipe, 'wipe')
    player.start(HOME)
    run(stream, 100)
    assert player.rollout is None
    player.start(np.array(player.place))
    run(stream, 1)
    player.set_amplitude(0.5)
    player.set_frequency(1.5)
    run(stream, 3000)
    assert player.rollout.amplitude == pytest.approx(0.5, abs=1e-3)
    assert player.rollout.frequency == pytest.approx(1.5, rel=1e-3)


def test_a_rhythmic_motion_that_has_ended_goes_on_with_another_amplitude(stream, skills):
    stream.use(skills[2], 'wipe')
    stream.begin(cycles=1.0)
    run(stream, 6000)
    assert stream.player.status is Status.HOLDING and stream.player.rollout.finished
    stream.commands.amplitude(0.5)
    run(stream, 3000)
    assert stream.player.status is Status.MOVING
    assert stream.player.rollout.amplitude == pytest.approx(0.5, abs=1e-2)


def test_an_amplitude_of_zero_ends_a_step_too(stream, skills):
    first, _, wipe = skills
    stream.begin_sequence(SkillSequence([MotionStep('wipe', wipe, until='never', amplitude=0.5),
                                    MotionStep('there', first)]))
    run(stream, 2000)
    assert stream.player.rollout.amplitude == pytest.approx(0.5, abs=1e-3)
    stream.commands.amplitude(0.0)
    run(stream, 4500)
    assert stream.sequence.status.step == 2


def test_tool_and_joints_in_one_sequence_are_refused(stream, skills):
    s, manifold = np.linspace(0.0, 1.0, 50), Product(Euclidean(7), names=['joints'])
    joints = Skill.learn(Demonstration(s, np.outer(minimum_jerk(s), np.ones(7)), manifold), 10)
    with pytest.raises(ParameterError, match='cannot be in one sequence'):
        stream.begin_sequence(SkillSequence([MotionStep('tool', skills[0]),
                                        MotionStep('joints', joints)]))


def ball(place):
    return Volume('ball', 'sphere', (0.02,), np.array([*place, 1.0, 0.0, 0.0, 0.0]), margin=0.0)


def nearest(targets, place):
    """Least distance of the references from a place [m]."""
    return float(np.linalg.norm(targets[:, POSE:POSE + 3] - place, axis=1).min())


def test_a_motion_that_cannot_be_led_around_volumes_bends_around_them(stream):
    skill = Skill.learn_rhythmic(circles(HOME, 0.1, 3.3))
    stream.use(skill, 'wipe')
    stream.begin()
    circle = run(stream, 4000)
    on_it = circle[-1, POSE:POSE + 3].copy()
    assert nearest(circle, on_it) < 1e-3
    stream.stop_motion()
    run(stream, 2000)
    stream.surround(Scene([ball(on_it)]))
    stream.begin()
    bent = run(stream, 6000)
    # Without it, the references go through the middle; to keep the distance is up to the arm.
    assert nearest(bent, on_it) > 0.01
    # On the other side it is the same circle.
    beside = circle[np.argmax(np.linalg.norm(circle[:, POSE:POSE + 3] - on_it, axis=1))]
    assert nearest(bent[3000:], beside[POSE:POSE + 3]) < 2e-3


def test_what_has_moved_is_bent_around_by_the_next_motion_of_a_sequence_too(stream, skills):
    first, second, _ = skills
    sequence = SkillSequence([MotionStep('there', first), MotionStep('back', second)])
    stream.begin_sequence(sequence)
    run(stream, 300)
    middle = 0.5 * (first.goal[:3] + second.goal[:3])
    stream.surround(Scene([ball(middle)]))
    assert nearest(run(stream, 4000), middle) > 0.02


def test_a_sequence_that_is_refused_changes_nothing_for_the_motion_that_runs(stream, skills):
    first, *_ = skills
    stream.use(first, 'first')
    stream.surroundings.tool = Tool.ball(0.01)
    stream.begin()
    stream.surround(Scene([ball([0.9, 0.5, 0.2])]))
    stream.hand.known = False
    close = GripperStep('close', GripperEvent(0.0, 0.02, 0.0, 0.1))
    with pytest.raises(ParameterError, match='no state of one is known'):
        stream.begin_sequence(SkillSequence([MotionStep('there', first), close]))
    assert stream.surroundings.moved.names == ('ball',)
