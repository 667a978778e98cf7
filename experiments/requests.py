"""
Random sequences of requests to a server without ROS, beside a model of its documentation.

The model knows docs/nodes.md: which request is accepted in which status, and what the last one
asks for. The reference stays within its bounds in every tick, no request is lost without a reason,
and at the end the reference is where the last request says.
"""
from __future__ import annotations

from functools import partial
import math
from typing import Any

from hypothesis import strategies as st
from hypothesis.stateful import initialize, precondition, rule, RuleBasedStateMachine
import numpy as np

from experiments import sequences
from gdmp_ros.control.gripper import GripperCommand, GripperState
from gdmp_ros.control.target import POSE, TWIST
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.primitive import GripperEvent
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import ParameterError
from gdmp_ros.manifolds.poses import tool_manifold
from gdmp_ros.playback.channels import APPROACH_ACCELERATION
from gdmp_ros.playback.measured_input import MeasuredInput, MeasuredInputs
from gdmp_ros.playback.settings import PlayerSettings, StreamSettings
from gdmp_ros.playback.states import ENDED, NOTHING_EXECUTED
from gdmp_ros.playback.streamer import ROBOT_LOST, Streamer
from gdmp_ros.util.profiles import minimum_jerk

MS, DT = 1_000_000, 1e-3
HOME = np.array([0.4, 0.0, 0.5, 0.0, 1.0, 0.0, 0.0])
#: Ticks in which what is executed has ended, however slow it is.
LONGEST = 30_000
#: Rounding of speeds and accelerations.
ROUNDING = 1.0 + 1e-3


class Hand:
    """A gripper that needs some time for a command, or is jammed."""

    def __init__(self) -> None:
        self.sent, self.asked, self.jammed = 0, 0, False

    def send(self, command: GripperCommand) -> None:
        """Begin a command."""
        self.sent, self.asked = self.sent + 1, 0

    def state(self) -> GripperState:
        """Its state."""
        self.asked += 1
        done = self.asked > 300
        return GripperState(0.0, 0.08, not done, False, self.sent,
                            'it is jammed' if done and self.jammed else '')


class Clock:
    """A clock that stands where the ticks are."""

    def __init__(self) -> None:
        self.time = MS

    def now(self) -> int:
        """Time [ns]."""
        return self.time

    def sleep_until(self, deadline: int) -> None:
        """Never called."""
        raise NotImplementedError


def _skills() -> dict[str, Skill]:
    s = np.linspace(0.0, 1.0, 120)
    made = {}
    for name, duration, way in (('short', 0.5, [0.0, 0.25, -0.05]),
                                ('long', 2.0, [0.1, -0.2, 0.1]),
                                ('grasp', 1.0, [0.05, 0.1, 0.0])):
        points = np.tile(HOME, (len(s), 1))
        points[:, :3] += minimum_jerk(s)[:, None] * way
        made[name] = Skill.learn(Demonstration(duration * s, points, tool_manifold(None)), 20)
    made['grasp'] = made['grasp'].with_events([GripperEvent(0.95, 0.01, 0.0, 0.1)])
    angle = 2.0 * np.pi * np.linspace(0.0, 3.0, 300)
    points = np.tile(HOME, (300, 1))
    points[:, 1] += 0.04 * np.sin(angle)
    points[:, 2] += 0.04 * np.cos(angle)
    made['rhythm'] = Skill.learn_rhythmic(Demonstration(
        np.linspace(0.0, 4.5, 300), points, tool_manifold(None)))
    return made


SKILLS = _skills()


class Requests(RuleBasedStateMachine):
    """A server without ROS, and what the documentation says of it."""

    def __init__(self) -> None:
        super().__init__()
        self.clock, self.hand = Clock(), Hand()
        self.robot: np.ndarray | None = HOME.copy()
        self.age = 0.0
        pose = MeasuredInput(self.clock, self._read, '/pose')  # type: ignore[arg-type]
        self.stream = Streamer(MS, MeasuredInputs(pose), StreamSettings(),
                               PlayerSettings(phase_stopping=0.0), gripper=self.hand)
        self.stream.activate(MS)
        self.before: np.ndarray | None = None
        self.way: np.ndarray | None = None
        # What the documentation says: what is executed, whether it is paused, and its goal.
        self.executing, self.paused = False, False
        self.loaded = self.present = 'long'
        self.goal, self.speed, self.motion = np.empty(7), 1.0, 0

    def _read(self) -> tuple[np.ndarray, float] | None:
        return None if self.robot is None else (self.robot.copy(), 0.0)

    def pass_ticks(self, count: int) -> np.ndarray:
        """Let ticks pass; the reference keeps its bounds in each."""
        limits = self.stream.settings
        reference = np.empty(0)
        for _ in range(count):
            self.clock.time += MS
            target = self.stream.tick(self.clock.time, 1.0)
            if target is None:
                continue
            reference = target.copy()
            self.check_way()
            for first, speed, acceleration in (
                    (0, limits.stream_speed, limits.stream_acceleration),
                    (3, limits.stream_angular_speed, limits.stream_angular_acceleration)):
                own = reference[TWIST + first:TWIST + first + 3]
                assert math.sqrt(own @ own) <= speed * ROUNDING
                if self.before is not None:
                    change = own - self.before[TWIST + first:TWIST + first + 3]
                    assert math.sqrt(change @ change) <= acceleration * DT * ROUNDING
            if self.before is not None:
                mean = 0.5 * (reference[TWIST:TWIST + 3] + self.before[TWIST:TWIST + 3])
                step = reference[POSE:POSE + 3] - self.before[POSE:POSE + 3] - DT * mean
                assert math.sqrt(step @ step) <= limits.stream_acceleration * DT * DT * ROUNDING
            self.before = reference
        # What was accepted in the last tick of a motion is refused with a reason by the next one.
        for reason in self.stream.refusals.take_new():
            assert reason in (ENDED, ROBOT_LOST) or 'not rhythmic' in reason or (
                reason == NOTHING_EXECUTED and not self.executing), reason
        return reference

    def check_way(self) -> None:
        """Without a motion the reference keeps the bounds of its way to the robot."""
        player, before = self.stream.loaded(), self.way
        self.way = None
        if player.rollout is None and player.target is not None:
            self.way = player.target[TWIST:TWIST + 3].copy()
            if before is not None:
                change = float(np.linalg.norm(self.way - before))
                assert change <= APPROACH_ACCELERATION['position'] * DT * ROUNDING

    @property
    def status(self) -> str:
        """As reported."""
        return '' if self.stream.player is None else self.stream.player.status.value

    def ask(self, accepted: bool, request: Any, *arguments: Any) -> None:
        """Ask for something; it is accepted, or refused with a reason, as documented."""
        try:
            request(*arguments)
        except ParameterError as error:
            assert not accepted and str(error), (self.status, error)
        else:
            assert accepted, (self.status, request)

    @initialize()
    def begin(self) -> None:
        """The server begins with a skill."""
        self.stream.use(SKILLS['long'], 'long')
        self.pass_ticks(60)

    @rule(count=st.sampled_from([1, 10, 50, 200, 2500]))
    def tick(self, count: int) -> None:
        """Time passes."""
        self.pass_ticks(count)
        self.look()

    def look(self) -> None:
        """A motion ends by itself for two reasons only: the gripper failed, the robot was lost."""
        gripper = self.stream.gripper
        if self.executing and gripper is not None and gripper.problem(self.motion):
            self.executing = self.paused = False
        if self.executing and self.motion == self.stream.lost_motion:
            self.executing = self.paused = False
        if self.executing:
            assert self.status == ('paused' if self.paused else self.status)
            assert self.status in ('moving', 'paused', 'holding')

    @rule(name=st.sampled_from(sorted(SKILLS)))
    def load(self, name: str) -> None:
        """Another skill is loaded for the next start."""
        self.stream.use(SKILLS[name], name)
        self.loaded = name

    @rule()
    def start(self) -> None:
        """A motion is started: accepted if the robot is known."""
        self.look()
        known = self.robot is not None and self.stream.robot_is_known()
        try:
            self.motion = self.stream.begin()
        except ParameterError as error:
            assert not known and str(error)
        else:
            assert known
            self.executing, self.paused, self.present = True, False, self.loaded
            self.goal = SKILLS[self.loaded].goal[:7].copy()

    @rule(x=st.sampled_from([-0.15, 0.15]), ticks=st.sampled_from([1, 100, 300]))
    def start_far(self, x: float, ticks: int) -> None:
        """A motion is started while the robot is far from the reference."""
        self.move_robot(x)
        self.start()
        self.pass_ticks(ticks)
        self.look()

    @rule()
    def stop(self) -> None:
        """A stop: accepted if something is executed, or its goal held."""
        self.look()
        self.ask(self.executing or self.status == 'stopping', self.stream.stop_motion)
        self.executing = self.paused = False

    @rule(paused=st.booleans())
    def pause(self, paused: bool) -> None:
        """A pause or its end: accepted while something is executed, before its end."""
        self.look()
        accepted = self.executing and self.status in ('moving', 'paused')
        self.ask(accepted, self.stream.pause, paused)
        if accepted:
            self.paused = paused
            reference = self.pass_ticks(600)
            if paused:
                assert not reference[TWIST:TWIST + 6].any()
            self.look()

    @rule(y=st.floats(-0.4, 0.4), z=st.floats(0.2, 0.7), age=st.sampled_from([0.0, 0.02, 0.2]))
    def goal_pose(self, y: float, z: float, age: float) -> None:
        """A goal, perhaps a late one: accepted until a motion has ended, also while it stops."""
        self.look()
        pose = self.goal.copy() if self.executing else HOME.copy()
        pose[1:3] = y, z
        accepted = (self.executing and self.status != 'holding') or self.status == 'stopping'
        now = self.stream.now
        self.ask(accepted, self.stream.commands.goal_pose, pose, now, age)
        if accepted and self.executing:
            self.goal = pose
            # The next goal is another one: it does not continue this one.
            self.pass_ticks(450)
            self.look()

    @rule(scale=st.sampled_from([0.2, 0.7, 1.0, 1.6]))
    def set_speed(self, scale: float) -> None:
        """A tempo, for this motion and the next ones."""
        self.stream.loaded().set_speed(scale)
        self.speed = scale

    @rule(value=st.sampled_from([0.3, 1.0, 1.7]))
    def set_amplitude(self, value: float) -> None:
        """An amplitude: accepted while a rhythmic skill is executed or stops."""
        self.look()
        player = self.stream.loaded()
        going = self.executing or self.status == 'stopping'
        # On the way to the robot the motion before is still known.
        if player.motion == 0 or self.present != getattr(self.stream, 'skill_name', ''):
            return
        if going and player.rollout is not None:
            rhythmic = player.playing.skill.rhythmic
            self.ask(rhythmic, self.stream.commands.amplitude, value)

    @rule(x=st.sampled_from([-0.15, -0.01, 0.0, 0.01, 0.15]))
    def move_robot(self, x: float) -> None:
        """The robot is elsewhere: near its reference, or far."""
        self.robot = HOME.copy() if self.before is None else self.before[:7].copy()
        self.robot[0] = min(max(self.robot[0] + x, 0.2), 0.7)

    @rule()
    @precondition(lambda self: self.robot is not None)
    def lose_robot(self) -> None:
        """The measured poses end."""
        self.robot = None
        self.pass_ticks(600)
        self.look()

    @rule(jammed=st.booleans())
    def jam(self, jammed: bool) -> None:
        """The gripper jams, or does not."""
        self.hand.jammed = jammed

    def teardown(self) -> None:
        """At the end the reference is where the last request says."""
        self.look()
        if self.executing and self.paused:
            self.stream.pause(False)
            self.paused = False
        self.hand.jammed = False
        self.stream.loaded().set_speed(1.0)
        if self.executing and SKILLS[self.present].rhythmic:
            self.stream.stop_motion()
            self.executing = False
        ticks = 0
        reference = self.pass_ticks(500)
        while ticks < LONGEST and (self.status in ('moving', 'stopping')
                                   or np.abs(reference[TWIST:TWIST + 6]).max() > 1e-3):
            reference = self.pass_ticks(200)
            ticks += 200
        self.look()
        if not len(reference):
            return
        assert self.status == 'holding', self.status
        if self.executing:
            assert np.abs(reference[:3] - self.goal[:3]).max() < 2e-3
        else:
            assert np.abs(reference[TWIST:TWIST + 6]).max() < 1e-2


#: Try random sequences (`experiments.sequences.run`).
run = partial(sequences.run, Requests)
