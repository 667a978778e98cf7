"""
Plays a skill tick by tick, as references for an impedance controller.

One thread calls `Player.tick`. Requests may come from any thread: they wait in one queue, and the
next tick carries them out in the order in which they came. What a request does in which state is
in `gdmp_ros.playback.states`.
"""
from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from gdmp_ros.control.modes import StreamMode
from gdmp_ros.dmp.frames import View
from gdmp_ros.dmp.options import check_range, MAX_SPEED
from gdmp_ros.dmp.rollout import Rollout
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import GdmpError, ParameterError
from gdmp_ros.manifolds.poses import moved_on
from gdmp_ros.playback.approach import Approach
from gdmp_ros.playback.plain_tick import end_of
from gdmp_ros.playback.refusals import Refusals
from gdmp_ros.playback.settings import PlayerSettings
from gdmp_ros.playback.states import after, Request, State, Status, TABLE
from gdmp_ros.playback.streamed_skill import Kind, StreamedSkill
from gdmp_ros.scene.scene import Scene

#: Requests that may wait for the next tick.
MAX_WAITING = 1000
#: Smallest initial tempo of a motion that takes over from another one.
LEAST_SPEED = 0.1
# Looked up once: this is done in every tick.
_FREE, _ENDS = (State.MOVING, State.FINISHED), (State.STOPPING, State.RESTARTING, State.WAITING)


class Goal(NamedTuple):
    """
    Where a motion is to end, as far as it is given.

    :ivar place: None: as before
    :ivar side: of two tools, the one that the place is of; None: of all
    :ivar stiffness: None: as before
    :ivar twist: with which the place moves on [m/s, rad/s]; None if it rests
    """

    place: np.ndarray | None = None
    side: int | None = None
    stiffness: np.ndarray | None = None
    twist: np.ndarray | None = None


class FrameMotion(NamedTuple):
    """
    A measurement of a task frame.

    :ivar at: when it was there, of the player [s]
    :ivar twist: None: not known
    """

    pose: np.ndarray
    at: float
    twist: np.ndarray | None = None


@dataclass
class _Pending:
    """
    A motion that has not begun, and what has been asked of it meanwhile.

    :ivar measured: where the robot is; None to begin where the reference is
    :ivar number: of the motion
    :ivar cycles: of a rhythmic motion, before it comes to rest at its centre
    :ivar wanted: whether it is still to begin, asked by the tick that begins it
    :ivar place_since: time of the player at which the place of the goal was set [s]
    :ivar frames: newest measurements of task frames
    """

    tool: StreamedSkill
    rollout: Rollout
    measured: np.ndarray | None
    number: int
    cycles: float | None
    wanted: Callable[[], bool]
    goal: Goal = Goal()
    place_since: float = 0.0
    amplitude: float | None = None
    frequency: float | None = None
    frames: dict[str, FrameMotion] = field(default_factory=dict)


class _Waiting(NamedTuple):
    """A request that the next tick carries out."""

    request: Request
    carry_out: Callable[..., None]
    arguments: tuple[Any, ...]


class Player:
    """
    Holds, starts, follows goals, pauses and stops.

    Only the thread that ticks changes anything but the queue.

    :ivar tool: the skill and settings of the next start
    :ivar playing: skill and settings of the present motion
    :ivar rollout: the present motion, also while its goal is held; only to be read
    :ivar target: the reference of the last tick; None before the first one
    :ivar numbers: of the last state of the motion
    :ivar goal_switched: whether the present motion has got another goal place
    :ivar called: called after a request was added, to wake a compiled loop
    :ivar motion: number of the motion that was begun last (see `start`), 0 before the first
    :ivar started: number of the motion that was asked for last; it may not have begun yet
    """

    def __init__(self, skill: Skill, settings: PlayerSettings, refusals: Refusals | None = None,
                 time: float = 0.0):
        """
        Prepare to play a skill.

        :param refusals: counts requests that turn out to be impossible
        :param time: that has passed before the first tick [s]
        :raises DataError: if the skill is neither one of a pose nor of joints
        """
        self.tool = self.playing = StreamedSkill(skill, settings)
        self.refusals = refusals or Refusals()
        self.rollout: Rollout | None = None
        self.target: np.ndarray | None = None
        self.motion = self.started = 0
        self.goal_switched = False
        self._state = State.IDLE
        self._queue: deque[_Waiting] = deque()
        self._pending: _Pending | None = None
        self._approach: Approach | None = None
        self._time, self._passing = time, 1.0
        # Point where the motion ends, or where it was set if it moves on with the twist.
        self._goal: np.ndarray | None = None
        self._goal_twist: np.ndarray | None = None
        # Time for which a goal that moves has waited with the motion [s].
        self._goal_waited = 0.0
        # Tempo of all motions; of the present one only; cycles after which it ends.
        self._speed, self._waits = 1.0, False
        self._own_speed: float | None = None
        self._cycles: float | None = None
        # What motions bend around, and the distance that they keep beyond its margins [m].
        self._around = Scene(), 0.0
        # Whether the reference has a wrench that no motion asks for any more.
        self._releases = False
        self.numbers = np.empty(0)
        self.called: Callable[[], None] = lambda: None
        self._copy_wanted = False
        self._copy: Rollout | None = None

    # What it does

    @property
    def state(self) -> State:
        """What the player does, as if the waiting requests had been carried out."""
        state = self._state
        for item in tuple(self._queue):
            state = after(state, item.request)
        return state

    @property
    def status(self) -> Status:
        """`state`, as the server reports it."""
        return self.state.status

    @property
    def mode(self) -> StreamMode:
        """What the stream of references says of itself: an arm begins to follow motions only."""
        rests = self._state in (State.RESTING, State.FINISHED)
        holds = rests or self.rollout is None or self.target is None
        return StreamMode.HOLDING if holds else StreamMode.STREAMING

    @property
    def stops_phase(self) -> bool:
        """Whether the present motion uses the measured pose (`observe`)."""
        return self.playing.settings.phase_stopping > 0.0

    @property
    def speed_rate(self) -> float:
        """Largest rate of change of the tempo of the present motion [1/s]."""
        return self.playing.settings.speed_rate

    @property
    def joints(self) -> int:
        """Number of the joints of which the references are; 0: they are of the tool."""
        return self.playing.manifold.point_size if self.playing.kind is Kind.JOINTS else 0

    @property
    def period(self) -> float:
        """Duration of the present motion at tempo 1, of the skill before there is one [s]."""
        rollout = self.rollout
        return self.playing.skill.duration if rollout is None else rollout.duration

    @property
    def joint_names(self) -> list[str]:
        """Names of the joints of the next start's skill; empty if it does not tell them."""
        return list(self.tool.skill.provenance.get('joints', ()))

    @property
    def goal(self) -> np.ndarray:
        """Goal of the motion, also before it begins; of the skill without one: a place."""
        goal, pending = self._present_goal(), self._pending
        if pending is not None:
            asked = pending.goal
            return pending.tool.place_of(pending.tool.changed(
                pending.rollout.goal, asked.place, side=asked.side))
        if goal is None:
            return self.tool.place_of(self.tool.skill.goal)
        return self.playing.place_of(goal)

    @property
    def place(self) -> np.ndarray | None:
        """Where the reference of the last tick is."""
        target = self.target
        return None if target is None else self.playing.place_in(target)

    def distances(self) -> list[float]:
        """Distance of each factor from the goal: m, rad, and geodesic for the stiffness."""
        target, goal = self.target, self._present_goal()
        if self.rollout is None or target is None or goal is None:
            return []
        return self.playing.distances(target, goal)

    def _present_goal(self) -> np.ndarray | None:
        rollout = self.rollout
        if rollout is None or self._goal_twist is None and not rollout.skill.views:
            return self._goal
        return rollout.goal

    @property
    def next_tool(self) -> StreamedSkill:
        """Skill of the motion that is executed, or that is about to begin."""
        pending = self._pending
        return self.playing if pending is None else pending.tool

    def view(self, name: str) -> View | None:
        """The motion as seen from a task frame; None without such a frame."""
        return next((view for view in self.next_tool.skill.views if view.name == name), None)

    def has_grasped(self, name: str) -> bool:
        """Whether the tool holds the object of a task frame."""
        view, rollout = self.view(name), self.rollout
        return (view is not None and view.grasped is not None and rollout is not None
                and self._pending is None and rollout.progress >= view.grasped)

    # Requests

    def load(self, skill: Skill) -> None:
        """Use another skill from the next start on."""
        self.tool = StreamedSkill(skill, self.tool.settings)

    def configure(self, settings: PlayerSettings) -> None:
        """Use other settings from the next start on."""
        self.tool = StreamedSkill(self.tool.skill, settings)

    def forget(self) -> None:
        """Stream nothing until there is something to hold; only while no tick is made."""
        self._queue.clear()
        self._hold(None)

    def allows(self, request: Request) -> bool:
        """Whether the state of the player allows a request."""
        return not isinstance(TABLE[self.state][request], str)

    def check(self, request: Request) -> None:
        """:raises ParameterError: if the state of the player refuses a request"""
        reason = TABLE[self.state][request]
        if isinstance(reason, str):
            raise ParameterError(reason)

    def check_kind(self, tool: StreamedSkill, state: State | None = None) -> None:
        """
        Check that a skill is of the kind of what is executed.

        :param state: in which it is to begin; by default that after the waiting requests
        :raises ParameterError: if it is of another kind
        """
        if tool.kind is not self.playing.kind and not (state or self.state).at_rest:
            raise ParameterError(f'a motion of {self.playing.kind.value} is being executed: stop '
                                 'it first')

    def hold(self, place: np.ndarray) -> None:
        """Hold a pose (x, y, z, qw, qx, qy, qz), or positions of the joints."""
        tool = self.tool
        self._ask(Request.HOLD, self._hold, tool.first_target(place), tool)

    def start(self, measured: np.ndarray | None, goal_place: np.ndarray | None = None,
              goal_stiffness: np.ndarray | None = None, duration: float | None = None,
              tolerances: tuple[float, float] | None = None, cycles: float | None = None) -> int:
        """
        Start the loaded skill where the robot is, without a step in the reference.

        :param measured: where the robot is; None starts at the start of the skill
        :param goal_place: instead of that of the skill
        :param goal_stiffness: factor (`StreamedSkill.stiffness_factor`) instead of the skill's
        :param duration: instead of that of the skill [s]
        :param tolerances: at the goal [m, rad]
        :param cycles: of a rhythmic skill, before it comes to rest at its centre; None: until its
            amplitude is 0
        :returns: number of the motion; `motion` has it as soon as the motion has begun
        :raises GdmpError: if the motion is not possible; nothing has changed then
        """
        tool = self.tool
        # Prepared and validated here; the tick only chooses the start, from the newest reference.
        rollout = Rollout(tool.skill, start=tool.start_at(measured), duration=duration,
                          goal=tool.changed(tool.skill.goal, goal_place, goal_stiffness),
                          options=tool.options(0.0, tolerances))
        return self.begin(tool, rollout, measured, cycles)

    def begin(self, tool: StreamedSkill, rollout: Rollout, measured: np.ndarray | None,
              cycles: float | None = None, wanted: Callable[[], bool] = lambda: True) -> int:
        """
        Begin a motion that has been prepared.

        :param rollout: of the skill of ``tool``
        :param measured: where the robot is; None where the reference is, or at the skill's start
        :param cycles: see `start`
        :param wanted: asked by the tick; nothing happens if it is not wanted any more
        :returns: number of the motion
        """
        number = self.started + 1
        self._ask(Request.START, self._start,
                  _Pending(tool, rollout, measured, number, cycles, wanted))
        self.started = number
        return number

    def go_to(self, place: np.ndarray, twist: np.ndarray | None = None, side: int | None = None
              ) -> None:
        """
        Switch the goal.

        :param place: pose, positions of the joints, or poses of two tools
        :param twist: with which it moves on, linear and angular [m/s, rad/s]; None if it rests
        :param side: of two tools, the one whose pose is given: the other one follows
        """
        self._ask(Request.GOAL, self._retarget, Goal(place, side, None, twist))

    def goal_stiffness(self, factor: np.ndarray) -> None:
        """Switch the stiffness goal (`StreamedSkill.stiffness_factor`)."""
        self._ask(Request.GOAL, self._retarget, Goal(stiffness=factor))

    def avoid(self, scene: Scene, keep: float) -> None:
        """
        Bend this motion and the next ones around volumes (`Rollout.set_obstacles`).

        :param scene: instead of that of the call before
        """
        # Allowed in the same states as the tempo: it holds for the next motions, too.
        self._ask(Request.SPEED, self._avoid, scene, keep)

    def move_frame(self, name: str, pose: np.ndarray, at: float, twist: np.ndarray | None = None
                   ) -> None:
        """
        Take a measurement of a task frame (`Rollout.move_frame`).

        :param at: when the frame was there, of the player, which counts from its first time [s]
        :param twist: of the frame, in this time [m/s, rad/s]
        """
        self._ask(Request.GOAL, self._move_frame, name, FrameMotion(pose, at, twist))

    def rest_frame(self, name: str) -> None:
        """Let a task frame come to rest where it is (`Rollout.rest_frame`)."""
        self._ask(Request.GOAL, self._rest_frame, name)

    def set_speed(self, scale: float) -> None:
        """
        Change the tempo of this motion and of the next ones.

        :raises ParameterError: outside 0 … 2
        """
        check_range('speed', scale, 0.0, MAX_SPEED)
        self._ask(Request.SPEED, self._set_speed, scale)

    def set_amplitude(self, amplitude: float) -> None:
        """Change the amplitude of a rhythmic motion (`Rollout.set_amplitude`)."""
        self._ask(Request.AMPLITUDE, self._set_amplitude, amplitude)

    def set_frequency(self, frequency: float) -> None:
        """Change the frequency of this rhythmic motion [Hz]; the tempo of others stays."""
        self._ask(Request.AMPLITUDE, self._set_frequency, frequency)

    def pause(self, paused: bool) -> None:
        """Come to a smooth stop on the path, or continue."""
        if paused:
            self._ask(Request.PAUSE, self._pause)
        else:
            self._ask(Request.RESUME, self._resume)

    def stop(self) -> None:
        """Come to a smooth stop on the path and hold there."""
        self._ask(Request.STOP, self._stop)

    def end(self) -> None:
        """Stop what is executed; at rest nothing happens."""
        if self.allows(Request.STOP):
            self.stop()

    def wait(self, waits: bool) -> None:
        """Stop on the path until something else has happened, or go on; only for the ticks."""
        self._waits = waits
        if self.rollout is not None and self._state is State.MOVING:
            self.rollout.set_speed(self._tempo)

    def observe(self, measured: np.ndarray, reference: np.ndarray | None = None) -> None:
        """
        Slow the motion down while the robot is behind (`gdmp_ros.dmp.Rollout.observe`).

        Any thread may call it.

        :param measured: place of the robot
        :param reference: that of the reference meanwhile; by default the present one
        """
        rollout, playing = self.rollout, self.playing
        reference = self.place if reference is None else reference
        # Not if a motion of another kind has begun since.
        if (rollout is not None and reference is not None and self.stops_phase
                and len(measured) == len(reference)):
            rollout.slow_down(playing.error(reference, measured))

    def request_copy(self) -> None:
        """Let the next tick copy the motion for `taken_copy`."""
        self._copy_wanted = True
        self.called()

    def taken_copy(self) -> Rollout | None:
        """Copy of the motion (`request_copy`), once; None without one."""
        rollout, self._copy = self._copy, None
        return rollout

    def _ask(self, request: Request, carry_out: Callable[..., None], *arguments: Any) -> None:
        if len(self._queue) >= MAX_WAITING:
            raise ParameterError(f'{MAX_WAITING} requests are waiting: no tick carries them out')
        self._queue.append(_Waiting(request, carry_out, arguments))
        self.called()

    # Ticks

    def tick(self, dt: float, tempo: float = 1.0) -> np.ndarray | None:
        """
        Carry out the requests, and let ``dt`` seconds pass.

        :param tempo: part of them that passes for the motion; a goal that moves does not wait
        :returns: numbers of the target, valid until the next tick; None while there is nothing to
            hold
        """
        self._passing = tempo
        if self._queue:
            self._carry_out()
        self._time += dt
        if self._goal_twist is not None and (tempo < 1.0 or self._goal_waited):
            self._move_goal(dt, tempo)
        dt *= tempo
        target, rollout = self.target, self.rollout
        if target is None:
            return None
        if self._approach is not None:
            if self._approach.advance(dt, target):
                self._approach = None
                self._rested()
        elif rollout is not None:
            self._advance(rollout, target, dt)
        elif self._state is State.RESTARTING:
            self._rested()
        self._release(target, dt)
        return target

    @property
    def only_goes_on(self) -> bool:
        """Whether a kernel can make the next tick: a motion goes on, or a place is held."""
        moves = self.rollout is not None
        return not (self._queue or self.target is None or self._approach is not None
                    or self._releases or self._goal_twist is not None
                    or self._cycles is not None or self._copy_wanted
                    or self._state is State.RESTARTING and not moves)

    @property
    def ends(self) -> int:
        """What ends the next tick (`gdmp_ros.playback.plain_tick`)."""
        return end_of(self._state, self.rollout is not None)

    def catch_up(self, seconds: float) -> None:
        """Know that time has passed, in ticks that a kernel has made."""
        self._time += seconds

    def end_tick(self, dt: float) -> np.ndarray:
        """
        End a tick of a kernel in which the state changes.

        :param dt: that has passed for the motion [s]
        """
        target = self.target
        if target is None or self.rollout is None:
            raise RuntimeError('there is no motion')
        self._after_step(self.rollout, target)
        self._release(target, dt)
        return target

    def _release(self, target: np.ndarray, dt: float) -> None:
        """Let decrease what no motion asks for any more."""
        if self._releases:
            self._releases = self.playing.release(target, dt)

    def _move_goal(self, dt: float, tempo: float) -> None:
        """Move a goal on that has waited with the motion, as soon as that does not wait."""
        self._goal_waited += (1.0 - tempo) * dt
        rollout, twist, waited = self.rollout, self._goal_twist, self._goal_waited
        if tempo == 1.0 and rollout is not None and twist is not None:
            self._retarget(Goal(moved_on(self.playing.place_of(rollout.goal), twist, waited),
                                twist=twist))

    def _carry_out(self) -> None:
        while self._queue:
            # Removed afterwards: until then `state` still counts it.
            request, carry_out, arguments = self._queue[0]
            next_state = TABLE[self._state][request]
            try:
                if not isinstance(next_state, str):
                    carry_out(*arguments)
                elif request is not Request.STOP:  # at rest a stop has nothing to do
                    raise ParameterError(next_state)
            except GdmpError as error:
                self.refusals.add(str(error))
            self._queue.popleft()

    def _advance(self, rollout: Rollout, target: np.ndarray, dt: float) -> None:
        if self._copy_wanted:
            self._copy_wanted, self._copy = False, rollout.copy()
        self.playing.advance(rollout, dt, self.numbers, target)
        self._after_step(rollout, target)

    def _after_step(self, rollout: Rollout, target: np.ndarray) -> None:
        """Find out what the motion does from now on."""
        if self._cycles is not None and rollout.progress >= self._cycles:
            self._cycles = None
            rollout.set_amplitude(0.0)
        if self._state in _FREE:
            # A motion whose goal moves is executed until it is stopped, or the goal rests.
            ended = (rollout.finished and self._goal_twist is None
                     and not rollout.frames_move)
            self._state = State.FINISHED if ended else State.MOVING
        elif self._state in _ENDS and rollout.speed == 0.0:
            self.rollout, self._releases = None, True
            self.playing.stop(target)
            self._rested()

    def _rested(self) -> None:
        """Go on when the reference has come to rest without a motion."""
        if self._state is State.STOPPING:
            self._state = State.RESTING
        elif self._state is State.APPROACHING:
            self._begin(self._pending, None)
        elif self._state is State.RESTARTING:
            pending = self._pending
            if pending is not None and self._is_far(pending.measured):
                self._go_to_robot(pending)
            else:
                self._begin(pending, None if pending is None else pending.measured)

    # What requests do

    def _hold(self, target: np.ndarray | None, tool: StreamedSkill | None = None) -> None:
        """Hold a reference at rest; None: nothing."""
        if tool is not None:
            self.playing = tool
        self.target, self.rollout, self._goal, self._goal_twist = target, None, None, None
        self._approach, self._pending = None, None
        self._state = State.IDLE if target is None else State.RESTING

    def _start(self, pending: _Pending) -> None:
        """Begin a motion: at the robot, or where the reference is if it moves or is near."""
        if not pending.wanted():
            return
        try:
            self.check_kind(pending.tool, self._state)
        except ParameterError:
            self.motion = pending.number
            raise
        if pending.tool.kind is not self.playing.kind:
            # The motion begins where the robot is.
            self._hold(None)
        far = self._is_far(pending.measured)
        if self._approach is not None and far:
            self._approach.stop()
            self._pending, self._state = pending, State.RESTARTING
        elif far and self._state in (State.STOPPING, State.RESTARTING, State.WAITING):
            # The robot does not follow: come to rest first, then go there.
            self._pending, self._state = pending, State.RESTARTING
        elif far and self._state in (State.RESTING, State.FINISHED):
            self._go_to_robot(pending)
        else:
            self._approach = None
            self._begin(pending, pending.measured)

    def _go_to_robot(self, pending: _Pending) -> None:
        """Begin to go to the robot from a reference at rest."""
        if self.target is None or pending.measured is None:
            raise RuntimeError('there is no reference, or no robot')
        self._approach = self.playing.approach(self.target, pending.measured)
        self.rollout, self._pending, self._releases = None, pending, True
        self.goal_switched = False
        self._state, self.motion = State.APPROACHING, pending.number

    def _begin(self, pending: _Pending | None, measured: np.ndarray | None) -> None:
        """Begin a motion at the reference; without one, where the robot is."""
        self._pending = None
        if pending is None:
            raise RuntimeError('there is no motion to begin')
        tool, rollout = pending.tool, pending.rollout
        try:
            target = self._begin_at(tool, rollout, measured)
        except GdmpError as error:
            # What is executed comes to rest.
            self._stop()
            self.motion = pending.number
            self.refusals.add(str(error))
            return
        self._waits, self._own_speed, self._cycles = False, None, pending.cycles
        rollout.set_speed(self._speed)
        self.playing, self.rollout, self.target = tool, rollout, target
        self._goal, self._goal_twist, self._state = rollout.goal, None, State.MOVING
        self._goal_waited = 0.0
        self.goal_switched = False
        self.numbers = np.empty(rollout.state_size)
        self._bend()
        try:
            self._ask_of_begun(pending)
        except GdmpError as error:
            self.refusals.add(str(error))
        # Set last: a thread that reads the new number then also reads the new motion.
        self.motion = pending.number

    def _ask_of_begun(self, pending: _Pending) -> None:
        """Carry out what was asked before the motion began."""
        goal = pending.goal
        if goal.place is not None and goal.twist is not None:
            goal = goal._replace(place=moved_on(goal.place, goal.twist,
                                                self._time - pending.place_since))
        if goal.place is not None or goal.stiffness is not None:
            self._retarget(goal)
        if pending.amplitude is not None:
            self._set_amplitude(pending.amplitude)
        if pending.frequency is not None:
            self._set_frequency(pending.frequency)
        views = pending.tool.skill.views
        for name, measured in pending.frames.items():
            if goal.place is None or name != views[-1].name:
                self._move_frame(name, measured)

    def _begin_at(self, tool: StreamedSkill, rollout: Rollout, measured: np.ndarray | None
                  ) -> np.ndarray:
        """Begin at the present reference, or where the robot is; returns the target to fill."""
        target = self.target
        if target is None:
            rollout.begin(tool.start_at(measured), speed=0.0)
            target = tool.first_target(tool.place_of(tool.skill.start))
        else:
            start, motion = tool.point_of(target), tool.motion_of(target)
            if motion is None:
                rollout.begin(start, speed=0.0)
            else:
                rollout.begin(start, *motion, max(LEAST_SPEED, min(self._speed, 1.0)))
        self._releases = tool.releases
        tool.take_over(target)
        return target

    def _is_far(self, measured: np.ndarray | None) -> bool:
        return (measured is not None and self.target is not None
                and not self.playing.is_near(self.target, measured))

    def _retarget(self, goal: Goal) -> None:
        """Switch the goal of the motion, or of the one that has not begun."""
        pending, rollout = self._pending, self.rollout
        self.goal_switched |= goal.place is not None
        if pending is not None:
            if goal.place is None:
                pending.goal = pending.goal._replace(stiffness=goal.stiffness)
            else:
                pending.goal = goal._replace(stiffness=pending.goal.stiffness)
                pending.place_since = self._time
            return
        if rollout is None:
            return
        twist = self._goal_twist if goal.place is None else goal.twist
        velocity = None if twist is None else self.playing.tangent_of_twist(twist)
        rollout.retarget(self.playing.changed(rollout.goal, goal.place, goal.stiffness, goal.side),
                         velocity)
        self._goal, self._goal_twist = rollout.goal, twist
        if goal.place is not None:
            self._goal_waited = 0.0

    def _move_frame(self, name: str, measured: FrameMotion) -> None:
        """Take a measurement of a frame of the motion, or of the one that has not begun."""
        pending, rollout, twist = self._pending, self.rollout, measured.twist
        passed = self._time - measured.at
        if pending is not None:
            pending.frames[name] = measured
        elif rollout is not None and twist is None:
            rollout.move_frame(name, measured.pose, stamp=rollout.time - passed)
        elif rollout is not None and twist is not None:
            # The frame does not wait with the motion: in the time of that it is faster.
            rollout.move_frame(name, moved_on(measured.pose, twist, passed),
                               twist / self._passing)

    def _avoid(self, scene: Scene, keep: float) -> None:
        self._around = scene, keep
        self._bend()

    def _bend(self) -> None:
        """Tell a motion of one tool what it bends around; one with task frames cannot."""
        rollout, (scene, keep) = self.rollout, self._around
        if (rollout is not None and self.playing.kind is Kind.TOOL
                and rollout.motion.sizes.position > 0 and not rollout.skill.views):
            rollout.set_obstacles(scene, keep=keep)

    def _rest_frame(self, name: str) -> None:
        if self._pending is None and self.rollout is not None:
            self.rollout.rest_frame(name)

    def _set_speed(self, scale: float) -> None:
        self._speed, self._own_speed = scale, None
        if self.rollout is not None and self._state in _FREE:
            self.rollout.set_speed(self._tempo)

    def _set_amplitude(self, amplitude: float) -> None:
        if self._pending is not None:
            self._pending.amplitude = amplitude
        elif self.rollout is not None:
            self.rollout.set_amplitude(amplitude)

    def _set_frequency(self, frequency: float) -> None:
        if self._pending is not None:
            self._pending.frequency = frequency
        elif self.rollout is not None:
            if self._state in _FREE and not self._waits:
                self.rollout.set_frequency(frequency)
            self._own_speed = frequency * self.rollout.duration

    @property
    def _tempo(self) -> float:
        """Tempo that is wanted now."""
        target = self._speed if self._own_speed is None else self._own_speed
        return 0.0 if self._waits else target

    def _pause(self) -> None:
        if self._pending is not None:
            self._state = State.WAITING
            if self._approach is not None:
                self._approach.stop()
        elif self.rollout is not None:
            self._state = State.PAUSED
            self.rollout.set_speed(0.0)

    def _resume(self) -> None:
        if self._state is State.WAITING:
            # At rest it goes to the robot from where it is.
            self._state = State.RESTARTING
        elif self._state is State.PAUSED and self.rollout is not None:
            self._state = State.MOVING
            self.rollout.set_speed(self._tempo)

    def _stop(self) -> None:
        if self._pending is not None:
            # It ends before it has begun.
            self.motion, self._pending = self._pending.number, None
        if self._approach is not None:
            self._approach.stop()
        if self.rollout is not None:
            self.rollout.set_speed(0.0)
        if self._approach is not None or self.rollout is not None:
            self._state = State.STOPPING
        else:
            self._state = State.IDLE if self.target is None else State.RESTING
