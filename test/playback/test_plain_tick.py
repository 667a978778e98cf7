"""Ticks of a stream that a kernel makes, beside the same ticks made one by one."""
import numpy as np
import pytest

from gdmp_ros.dmp.primitive import GripperEvent
from gdmp_ros.kernels import kernel
from gdmp_ros.manifolds.linalg import copy_into
from gdmp_ros.playback.measured_input import MeasuredInput, MeasuredInputs
from gdmp_ros.playback.plain_tick import CHANGES, DUE, MADE, plain_tick
from gdmp_ros.playback.settings import PlayerSettings, StreamSettings
from gdmp_ros.playback.states import State
from gdmp_ros.playback.streamer import READ_EVERY, Streamer
from test.lockstep.clock import SteppedClock
from test.playback.hand import Hand

PERIOD_NS, LONGEST_S = 1_000_000, 0.05


@kernel
def ticks(motion, dt, count, references):
    """Ticks until Python is needed; how many, and what the last one returned."""
    for k in range(count):
        result = plain_tick(motion, dt)
        if result != CHANGES:
            copy_into(motion.bounded, references[k])
        if result != MADE:
            return k + 1, result
    return count, MADE


class Stream:
    """A streamer, and the references that it has streamed."""

    def __init__(self, skill, by_kernel, gripper=None, **settings):
        self.measured = None
        self.streamer = Streamer(PERIOD_NS, MeasuredInputs(
            MeasuredInput(SteppedClock(), self._read, '/measured_pose')),
            StreamSettings(follow_goal_after_end=True, **settings),
            PlayerSettings(phase_stopping=20.0), gripper=gripper)
        self.hand = gripper
        self.streamer.use(skill, 'skill')
        self.streamer.activate(PERIOD_NS)
        self.by_kernel, self.now, self.references, self.made = by_kernel, 0, [], 0

    def _read(self):
        measured, self.measured = self.measured, None
        return None if measured is None else (measured, 0.0)

    def run(self, count):
        """As the loop of a server."""
        streamer, ends = self.streamer, self.now + count * PERIOD_NS
        while self.now < ends:
            alone = min(-(streamer.ticks + 1) % READ_EVERY, (ends - self.now) // PERIOD_NS)
            if self.by_kernel and alone and streamer.only_goes_on:
                alone = self._tick_by_kernel(alone)
            else:
                self.now += PERIOD_NS
                target = streamer.tick(self.now, LONGEST_S)
                self.references.append(None if target is None else target.copy())

    def _tick_by_kernel(self, alone):
        motion, references = self.streamer.motion(), np.empty((alone, len(
            self.streamer.bounds.out)))
        count, result = ticks(motion, 1e-9 * PERIOD_NS, alone, references)
        self.now += count * PERIOD_NS
        self.made += count
        self.streamer.catch_up(motion, count, self.now)
        self.references.extend(references[:count - (result == CHANGES)])
        if result == CHANGES:
            self.references.append(self.streamer.end_tick(1e-9 * PERIOD_NS).copy())
        elif result == DUE:
            self.streamer.command_gripper(1e-9 * PERIOD_NS)


def everything(stream, skill):
    """A motion with a switched goal, a pause, slow-down, an end; another one that is stopped."""
    streamer, start = stream.streamer, skill.start[:7]
    stream.measured = start.copy()
    stream.run(120)
    stream.measured = start.copy()
    streamer.begin()
    stream.run(700)
    streamer.commands.goal_pose(skill.goal[:7] + [0.05, 0.0, 0.02, 0, 0, 0, 0], 1e-9 * stream.now)
    stream.run(300)
    stream.measured = stream.references[-1][:7] + [0.05, 0.0, 0.0, 0, 0, 0, 0]
    stream.run(300)
    stream.measured = stream.references[-1][:7].copy()
    stream.run(200)
    streamer.pause(True)
    stream.run(600)
    streamer.pause(False)
    stream.run(12_000)
    assert streamer.player.state is State.FINISHED
    # A goal after the end is followed.
    streamer.commands.goal_pose(skill.goal[:7], 1e-9 * stream.now)
    stream.run(3000)
    stream.measured = stream.references[-1][:7].copy()
    streamer.begin()
    stream.run(900)
    streamer.stop_motion()
    stream.run(1500)
    assert streamer.player.state is State.RESTING


@pytest.mark.parametrize('settings', [{}, {'stream_speed': 0.1, 'stream_acceleration': 0.5}],
                         ids=['free', 'bounded'])
def test_the_stream_is_the_same_to_the_bit(letter, settings):
    one, other = (Stream(letter, by_kernel, **settings) for by_kernel in (False, True))
    for stream in (one, other):
        everything(stream, letter)
    assert other.made > 0.8 * len(other.references)
    for k, (first, second) in enumerate(zip(one.references, other.references, strict=True)):
        assert (first is None) is (second is None), k
        if first is not None:
            np.testing.assert_array_equal(first, second, err_msg=f'tick {k}')
    assert one.streamer.bounds.bounded == other.streamer.bounds.bounded
    assert one.streamer.player.motion == other.streamer.player.motion == 2
    assert one.streamer.time == pytest.approx(other.streamer.time, abs=1e-9)


def test_commands_for_a_gripper_come_in_the_same_ticks(letter):
    skill = letter.with_events([GripperEvent(at, 0.02, 0.0, 0.1) for at in (0.2, 0.6, 1.0)])
    one, other = (Stream(skill, by_kernel, Hand()) for by_kernel in (False, True))
    for stream in (one, other):
        stream.measured = skill.start[:7].copy()
        stream.run(120)
        stream.measured = skill.start[:7].copy()
        stream.streamer.begin()
        stream.run(6000)
        assert stream.streamer.player.state is State.FINISHED
        assert len(stream.hand.sent) == 3
    # Python makes the ticks in which a command is awaited.
    assert other.made > 0.7 * len(other.references)
    # There is no reference before the first measured pose.
    first = next(k for k, reference in enumerate(one.references) if reference is not None)
    assert all(reference is None for reference in other.references[:first])
    np.testing.assert_array_equal(one.references[first:], other.references[first:])


def test_a_motion_that_is_resumed_meanwhile_needs_no_gripper_yet(letter):
    """Another thread resumes it between the question whether it goes on, and the tick."""
    stream = Stream(letter.with_events([GripperEvent(0.3, 0.02, 0.0, 0.1)]), True, Hand())
    streamer = stream.streamer
    stream.measured = letter.start[:7].copy()
    stream.run(120)
    stream.measured = letter.start[:7].copy()
    streamer.begin()
    while streamer.player.rollout is None or streamer.player.rollout.progress < 0.297:
        stream.run(1)
    streamer.pause(True)
    stream.run(600)
    assert streamer.player.rollout.progress > 0.3 and streamer.only_goes_on
    streamer.pause(False)
    motion = streamer.motion()
    assert motion.due.dtype == float and plain_tick(motion, 1e-3) == DUE


def test_what_is_asked_for_is_left_to_the_player(letter):
    stream, called = Stream(letter, True), []
    streamer = stream.streamer
    stream.measured = letter.start[:7].copy()
    stream.run(READ_EVERY + 1)
    stream.measured = letter.start[:7].copy()
    streamer.begin()
    stream.run(5)
    streamer.called = lambda: called.append(0)
    for ask in (lambda: streamer.commands.goal_pose(letter.goal[:7], 0.0),
                lambda: streamer.player.set_speed(0.5), lambda: streamer.pause(True),
                lambda: streamer.stop_motion()):
        assert streamer.only_goes_on
        called.clear()
        ask()
        assert called and not streamer.only_goes_on
        stream.run(2)
