"""What a trajectory server does, without ROS: skills, the robot's pose, ticks, refusals."""
from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
import math
from typing import Any, TypeAlias

import numpy as np

from gdmp_ros.control.modes import StreamMode
from gdmp_ros.dmp.sequence import MotionStep, SkillSequence
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import ParameterError
from gdmp_ros.playback.bounds import NOTHING, StreamBounds
from gdmp_ros.playback.goal_check import ArmKinematics, GoalCheck, no_second_arm
from gdmp_ros.playback.gripper_sequence import GripperCommands, GripperLink, GripperSequence
from gdmp_ros.playback.measured_input import Measured, MeasuredInputs
from gdmp_ros.playback.motion_commands import LaterGoal, MotionCommands
from gdmp_ros.playback.motion_record import MotionRecord
from gdmp_ros.playback.objects import (
    Followed,
    NoObjects,
    Objects,
    ObjectSettings,
    ObjectSource,
)
from gdmp_ros.playback.plain_tick import BOUNDED, COUNTS, ENDS, Motion
from gdmp_ros.playback.player import Player
from gdmp_ros.playback.refusals import Refusals
from gdmp_ros.playback.rehearsal import rehearse
from gdmp_ros.playback.robot_watch import RobotSettings, RobotWatch
from gdmp_ros.playback.sequence_runner import OTHER_MOTION, SequenceRunner
from gdmp_ros.playback.settings import PlayerSettings, StreamSettings
from gdmp_ros.playback.states import Request, State, Status
from gdmp_ros.playback.streamed_skill import Kind, StreamedSkill
from gdmp_ros.playback.surroundings import Led, Surroundings
from gdmp_ros.realtime.loop import NS, RunningLoop
from gdmp_ros.realtime.statistics import LatenessRecorder
from gdmp_ros.scene.scene import Scene

#: Ticks between two readings of where the robot is.
READ_EVERY = 50
#: Time between two looks at a motion that is to stop [ns].
LOOK_NS = 5_000_000


#: Why a motion ends when the measured poses do.
ROBOT_LOST = 'the measured pose of the robot has ended: the motion was stopped; start another one'
_EXECUTED = (State.APPROACHING, State.MOVING, State.PAUSED, State.WAITING, State.RESTARTING)


#: Returns what a function reads, not while it is written.
Whole: TypeAlias = Callable[[Callable[[], np.ndarray | None]], np.ndarray | None]


def _as_it_is(read: Callable[[], np.ndarray | None]) -> np.ndarray | None:
    return read()


class Streamer:
    """
    Streams a skill as references; one thread calls `tick`, any thread the other methods.

    :ivar player: None before there is a skill
    :ivar robot: what is known of the robot
    :ivar kinematics: of the arm; None if it is not known
    :ivar bounds: of speed and acceleration
    :ivar whole: reads numbers that another thread may be writing
    :ivar commands: for the motion that is executed
    :ivar objects: where task frames are
    :ivar surroundings: what is around the tool
    :ivar gripper: commands of the skill that is executed; None without a gripper
    :ivar sequence: executes sequences
    :ivar record: how the robot followed the last motion
    :ivar active: whether ticks are made
    :ivar called: called after something was asked for, to wake a compiled loop
    :ivar lost_motion: number of the last motion that ended because the robot was lost
    :ivar member: the loop that makes the ticks; None while inactive
    :ivar looking: the loop that calls `look`; None if the ticks do so, and while inactive
    :ivar ticks: number of calls of `tick`
    :ivar ticked: gives the time of the last tick, also of one that a kernel has made [ns]
    :ivar context: that the skill of the next start is for
    :ivar time_jumps: [s], not reported yet
    :ivar jumps: number of time jumps
    """

    def __init__(self, period_ns: int, inputs: MeasuredInputs, settings: StreamSettings,
                 player_settings: PlayerSettings, robot_settings: RobotSettings | None = None,
                 kinematics: ArmKinematics | None = None, gripper: GripperLink | None = None,
                 second_base: Callable[[], np.ndarray] = no_second_arm,
                 objects: ObjectSource | None = None,
                 object_settings: ObjectSettings | None = None):
        """
        Prepare to stream.

        :param inputs: where the robot is; their clock is that of the streamer
        :param gripper: for skills with commands for a gripper
        :param second_base: see `GoalCheck`
        :param objects: tells where they are
        """
        self.settings, self.kinematics = settings, kinematics
        self.robot = RobotWatch(robot_settings or RobotSettings())
        self.player: Player | None = None
        self._skill: Skill | None = None
        self.skill_name, self.context = '', dict[str, float]()
        self.refusals, self.record = Refusals(), MotionRecord()
        self.lateness = LatenessRecorder(period_ns)
        self.member: RunningLoop | None = None
        self.looking: RunningLoop | None = None
        self.active = False
        self.time_jumps: deque[float] = deque(maxlen=10)
        self.called: Callable[[], None] = lambda: None
        self.whole: Whole = _as_it_is
        self._player_settings = player_settings
        commands = None if gripper is None else GripperCommands(gripper)
        self.gripper = None if commands is None else GripperSequence(commands)
        self.sequence = SequenceRunner(commands, self.gripper)
        self._inputs = inputs
        self._used: Measured | None = None
        self.lost_motion = 0
        self.bounds = StreamBounds(settings)
        self.ticks = self.jumps = 0
        # Time of the last tick that was made here [ns], and that the motions have had then [s]:
        # together, because other threads read them.
        self._when = 0, 0.0
        self.ticked = self._ticked
        self._goals = GoalCheck(settings, kinematics, second_base)
        self.objects = Objects(object_settings or ObjectSettings(), objects or NoObjects(),
                               self._goals, self.refusals.add)
        self.commands = MotionCommands(self._goals, self.loaded, self.refusals.add)
        self.surroundings, self._led = Surroundings(), False

    def configure(self, settings: StreamSettings, player_settings: PlayerSettings,
                  robot_settings: RobotSettings, object_settings: ObjectSettings) -> None:
        """Use other settings from now on; those of the player from the next motion on."""
        self.objects.settings = object_settings
        self.settings, self._player_settings = settings, player_settings
        self._goals.settings = settings
        self.robot.settings = robot_settings
        self.bounds.configure(settings)
        if self.player is not None:
            self.player.configure(player_settings)

    @property
    def joints(self) -> int:
        """Number of the joints of which the references are; 0: they are of the tool."""
        return 0 if self.player is None else self.player.joints

    @property
    def kind(self) -> Kind:
        """What the references are of."""
        return Kind.TOOL if self.player is None else self.player.playing.kind

    @property
    def mode(self) -> StreamMode:
        """What the stream of references says of itself."""
        return StreamMode.HOLDING if self.player is None else self.player.mode

    def use(self, skill: Skill, name: str, context: Mapping[str, float] | None = None) -> None:
        """
        Use a skill for the next start.

        :param context: that it is for
        :raises GdmpError: if it is neither one of a pose, nor of two, nor of joints, or nothing
            is measured for such a skill; the present skill stays
        """
        self._inputs.of(StreamedSkill(skill, self._player_settings).kind)
        rehearse(skill, self._player_settings)
        if self.player is None:
            self._play(skill)
        else:
            self.player.load(skill)
        self._skill = skill
        self.skill_name, self.context = name, dict(context or {})

    def loaded(self) -> Player:
        """
        Return the player.

        :raises ParameterError: if there is no skill
        """
        if self.player is None:
            raise ParameterError('no skill is loaded: set the parameter skill or demonstrations, '
                                 'or call ~/load_skill or ~/learn_skill')
        return self.player

    def begin(self, goal_pose: np.ndarray | None = None, goal_stiffness: Any = None,
              duration: float | None = None,
              tolerances: tuple[float, float] | None = None, cycles: float | None = None,
              goal_after: float = 0.0, objects: Mapping[str, np.ndarray] | None = None) -> int:
        """
        Start the loaded skill.

        :param goal_pose: four zeros for its rotation: that of the skill
        :param goal_after: time after the start from which the pose is the goal [s]
        :param goal_stiffness: 9 or 36 numbers; None or empty for that of the skill
        :param cycles: of a rhythmic skill (`Player.start`)
        :param objects: poses of task frames, instead of those that are looked up
        :returns: number of the motion (`Player.start`)
        :raises GdmpError: if it cannot start; what is streamed does not change
        """
        player = self.loaded()
        if not self.active:
            raise ParameterError('the node is not active')
        if cycles is not None and not player.tool.skill.rhythmic:
            raise ParameterError('cycles: the skill is not rhythmic')
        if self._led and self._skill is not None:
            player.load(self._skill)
            self._led = False
        followed: Followed = {}
        if self._skill is not None and (self._skill.views or objects):
            skill, followed = self.objects.place(self._skill, self.time, objects)
            player.load(skill)
            if goal_pose is not None:
                followed.pop(skill.views[-1].name, None)
        factor = None
        if goal_stiffness is not None and len(goal_stiffness):
            factor = player.tool.stiffness_factor(goal_stiffness)
        tool = player.tool
        measured = self._start_place(tool)
        player.check_kind(tool)
        goal = tool.place_of(tool.skill.goal)
        if goal_pose is not None:
            goal = self._goals.place_for(tool, goal_pose, goal)
        self._goals.check_reach(tool, goal)
        led = Led(tool.skill)
        if tool.kind is Kind.TOOL and goal_after <= 0.0 and not followed:
            led = self.surroundings.led(tool.skill, tool.start_at(measured), tool.changed(
                tool.skill.goal, None if goal_pose is None else goal, factor))
            if led.motion is not tool.skill:
                player.load(led.motion)
                self._led, tool, goal_pose, factor = True, player.tool, None, None
        later = None
        if goal_pose is not None and goal_after > 0.0:
            later, goal_pose = LaterGoal(self.time + goal_after, goal), None
        self.sequence.cancel(OTHER_MOTION)
        self.commands.begin(later)
        self.robot.begin()
        motion = player.start(measured, None if goal_pose is None else goal, factor, duration,
                              tolerances, cycles)
        player.avoid(self.surroundings.begin(led), self.surroundings.radius)
        self.objects.begin(followed, motion)
        return motion

    def surround(self, scene: Scene) -> None:
        """
        Lead motions around a scene from the next one on; the present one bends around what moves.

        :param scene: in the frame of the references
        """
        self.surroundings.scene = scene.copy()
        player = self.player
        if player is not None and (self.sequence.running
                                   or player.state not in (State.IDLE, State.RESTING)):
            player.avoid(self.surroundings.moved, self.surroundings.radius)
        self.called()

    def _led_steps(self, sequence: SkillSequence, first: int) -> Led[SkillSequence]:
        """A sequence whose motions, if they are of the tool, are led around the scene."""
        sequence.check_index(first)
        tools = [StreamedSkill(step.skill, self._player_settings)
                 for step in sequence.steps[first:] if isinstance(step, MotionStep)]
        if not tools or any(tool.kind is not Kind.TOOL for tool in tools):
            return Led(sequence)
        return self.surroundings.led_steps(sequence, first, self._start_place(tools[0]),
                                           self._player_settings)

    def begin_sequence(self, sequence: SkillSequence, first: int = 0) -> None:
        """
        Start a sequence, from the present motion if there is one.

        :param first: index of its first step
        :raises GdmpError: if it cannot start; what is streamed does not change
        """
        if not self.active:
            raise ParameterError('the node is not active')
        led = self._led_steps(self.objects.place_steps(sequence, self.time), first)
        prepared = self.sequence.prepare(led.motion, first, self._player_settings,
                                         self._goals.check)
        tool = prepared.first_tool
        measured = self._start_place(tool)
        player = self.player or self._play(tool.skill)
        player.check_kind(tool)
        moves = not player.state.at_rest
        self.commands.begin()
        self.robot.begin()
        self.sequence.begin(prepared, measured)
        player.avoid(self.surroundings.begin(led), self.surroundings.radius)
        if moves and not prepared.moves_first:
            player.end()
        self.called()

    def _play(self, skill: Skill) -> Player:
        """Make the player."""
        player = self.player = Player(skill, self._player_settings, self.refusals,
                                      self._when[1])
        player.called = lambda: self.called()
        return player

    def pause(self, paused: bool) -> None:
        """
        Come to a smooth stop on the path, or continue; a sequence waits with it.

        :raises ParameterError: if nothing is executed
        """
        player, request = self.loaded(), Request.PAUSE if paused else Request.RESUME
        if not self.sequence.running:
            player.check(request)
        self.sequence.paused = paused
        if player.allows(request):
            player.pause(paused)

    def stop_motion(self) -> None:
        """
        Stop a motion, and a sequence, smoothly.

        :raises ParameterError: if nothing is executed
        """
        player = self.loaded()
        if not self.sequence.running:
            player.check(Request.STOP)
        self.sequence.cancel('stopped')
        player.end()

    @property
    def now(self) -> float:
        """Time of the last tick [s]."""
        return max(self.ticked(), self._when[0]) / NS

    @property
    def time(self) -> float:
        """Time that the motions have had, without jumps [s]."""
        last, time = self._when
        return time + max(self.ticked() - last, 0) / NS

    @property
    def failure(self) -> BaseException | None:
        """Why ticks are not made any more, or nothing is seen or heard; None if all is well."""
        failures = [one.failure for one in (self.member, self.looking) if one is not None]
        return next((one for one in failures if one is not None), None)

    def _ticked(self) -> int:
        return self._when[0]

    def robot_is_known(self) -> bool:
        """Whether the robot's pose is recent enough to start a motion; True while inactive."""
        try:
            self._start_place(None if self.player is None else self.player.tool)
        except ParameterError:
            return not self.active
        return True

    def activate(self, period_ns: int) -> None:
        """Begin to tick; what was held before is forgotten: the robot may be elsewhere now."""
        if self.player is not None:
            self.player.forget()
        self._used = None
        self._inputs.forget()
        self.robot.reset()
        self.bounds.reset()
        self.lateness = LatenessRecorder(period_ns)
        self._when, self.ticked = (0, self._when[1]), self._ticked
        self.active = True

    def stop(self) -> None:
        """Stop a motion smoothly, and wait until it has stopped."""
        player = self.player
        self.sequence.cancel('the node was deactivated')
        if player is None or player.state.at_rest:
            return
        player.stop()
        clock = self._inputs.clock
        latest = clock.now() + round((2.0 / player.speed_rate + 1.0) * NS)
        while player.status is Status.STOPPING and clock.now() < latest:
            clock.sleep_until(clock.now() + LOOK_NS)

    def tick(self, now_ns: int, longest_s: float) -> np.ndarray | None:
        """
        Advance the motion to the present time; look around once in `READ_EVERY` ticks.

        :param longest_s: a longer step is a jump of the time: the motion does not advance then [s]
        :returns: see `Player.tick`; None without a skill
        """
        dt = self._pass(now_ns, longest_s)
        if self.ticks % READ_EVERY == 0:
            self.look()
        return self._advance(dt)

    def tick_only(self, now_ns: int, longest_s: float) -> np.ndarray | None:
        """As `tick`; another thread calls `look`."""
        return self._advance(self._pass(now_ns, longest_s))

    def _pass(self, now_ns: int, longest_s: float) -> float:
        """Let time pass until the present; how much, 0 after a jump [s]."""
        self.ticks += 1
        last, time = self._when
        dt = (now_ns - last) / NS if last else 0.0
        if not 0.0 <= dt <= longest_s:
            self.time_jumps.append(dt)
            self.jumps += 1
            dt = 0.0
        self._when = now_ns, time + dt
        return dt

    def look(self) -> None:
        """Find out where the robot is, and use the goal whose time has come."""
        player = self.player
        if player is not None:
            self._use_pose(player)
            self.commands.pass_time(self.now, self.time, player)

    def follow_objects(self) -> None:
        """Let the motion follow the task frames that move."""
        if self.player is not None:
            self.objects.follow(self.player, self.time)

    def _advance(self, dt: float) -> np.ndarray | None:
        """Advance the motion."""
        player = self.player
        if player is None:
            return None
        target = player.tick(dt, self.bounds.tempo)
        self.command_gripper(dt)
        self.sequence.advance(player, dt)
        return None if target is None else self.bounds.apply(player.playing, target, dt,
                                                             player.rollout)

    def command_gripper(self, dt: float) -> None:
        """Carry out the commands of the skill for a gripper, after a tick of ``dt`` seconds."""
        player = self.loaded()
        if self.gripper is not None and player.playing.skill.events:
            self.gripper.advance(player, dt)

    def _due(self, player: Player) -> float:
        """See `GripperSequence.due`."""
        return math.inf if self.gripper is None else self.gripper.due(player)

    @property
    def only_goes_on(self) -> bool:
        """Whether a kernel can make the next tick."""
        player = self.player
        if player is None or player.target is None or not self.active:
            return False
        playing = player.playing
        return (player.only_goes_on and playing.kind is Kind.TOOL and not self.sequence.running
                and self._due(player) > -math.inf
                and self.bounds.continues(playing, player.target))

    def motion(self) -> Motion:
        """What a kernel must know to make ticks, as long as the stream `only_goes_on`."""
        player, bounds = self.player, self.bounds
        if player is None or player.target is None or bounds.out is None:
            raise RuntimeError('there is no stream')
        rollout, counts = player.rollout, np.zeros(COUNTS, dtype=np.int64)
        bounds.follow(rollout)
        counts[ENDS] = player.ends
        return Motion(counts, np.array([self._due(player)]),
                      NOTHING if rollout is None else rollout.memory, player.numbers,
                      player.playing.table, player.target, bounds.parts, bounds.out, bounds.work,
                      bounds.tempos, bounds.ahead)

    def catch_up(self, motion: Motion, ticks: int, now_ns: int) -> None:
        """
        Know what ticks of a kernel have done.

        :param now_ns: time of the last of them
        """
        last, time = self._when
        seconds = (now_ns - last) / NS
        self.ticks += ticks
        self._when = now_ns, time + seconds
        self.bounds.bounded += int(motion.counts[BOUNDED])
        self.loaded().catch_up(seconds)

    def end_tick(self, dt: float) -> np.ndarray:
        """End a tick of a kernel, of ``dt`` seconds, in which the state of the player changes."""
        player = self.loaded()
        rollout, target = player.rollout, player.end_tick(self.bounds.tempo * dt)
        self.command_gripper(dt)
        return self.bounds.apply(player.playing, target, dt, rollout)

    def _use_pose(self, player: Player) -> None:
        """Let the player and the watch use where the robot is."""
        idle = player.status is Status.IDLE
        skill = player.tool if idle else player.playing
        self.robot.measure_by(skill.kind, skill.distance)
        source = self._inputs.of(skill.kind)
        measured = source.newest()
        known = measured is not None and source.age(measured) <= self.settings.measured_pose_age
        reference = self.whole(lambda: player.place)
        if reference is not None:
            self.robot.update(self.time, measured.place if measured is not None and known else
                              None, reference, player.status is Status.MOVING)
        if not known and self.robot.seen and player.state in _EXECUTED:
            self.lost_motion = player.started
            self.refusals.add(ROBOT_LOST)
            self.sequence.cancel(ROBOT_LOST)
            player.end()
        if measured is None or measured is self._used:
            return
        self._used = measured
        self.record.add(player, reference, measured.place)
        if reference is None and idle:
            player.hold(measured.place)
        elif player.stops_phase:
            player.observe(measured.place, reference)

    def _start_place(self, skill: StreamedSkill | None) -> np.ndarray | None:
        measured = self._inputs.of(Kind.TOOL if skill is None else skill.kind)
        if self.settings.start_from == 'skill':
            return None
        return measured.recent(self.settings.measured_pose_age)
