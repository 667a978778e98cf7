"""Executes a sequence with a player: begins each step when the one before has ended."""
from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gdmp_ros.control.gripper import GripperCommand
from gdmp_ros.dmp.rollout import Rollout
from gdmp_ros.dmp.sequence import Course, GripperStep, HoldStep, MotionStep, SkillSequence
from gdmp_ros.errors import ParameterError
from gdmp_ros.playback.gripper_sequence import GripperCommands, GripperSequence
from gdmp_ros.playback.player import Player
from gdmp_ros.playback.rehearsal import rehearse
from gdmp_ros.playback.settings import PlayerSettings
from gdmp_ros.playback.states import Status
from gdmp_ros.playback.streamed_skill import StreamedSkill

_MOVING = (Status.MOVING, Status.PAUSED, Status.STOPPING)
#: Why a sequence ended: because of another motion.
OTHER_MOTION = 'another motion was started'


class PreparedStep(NamedTuple):
    """A motion of a sequence, ready to begin."""

    tool: StreamedSkill
    rollout: Rollout


class PreparedSequence(NamedTuple):
    """
    A sequence, ready to begin.

    :ivar first: index of the step that it begins with
    :ivar motions: by the index of their step
    """

    sequence: SkillSequence
    first: int
    motions: dict[int, PreparedStep]

    @property
    def first_tool(self) -> StreamedSkill:
        """Skill of the first motion; of a sequence that has none any more, of the last."""
        later = [item.tool for index, item in self.motions.items() if index >= self.first]
        return (later or [item.tool for item in self.motions.values()][-1:])[0]

    @property
    def moves_first(self) -> bool:
        """Whether the first step is a motion."""
        return self.first in self.motions


class SequenceStatus(NamedTuple):
    """
    Where a sequence is.

    :ivar step: counted from 1; that of the last one at the end
    :ivar running: whether it is being executed
    :ivar problem: why it ended early; empty if it did not
    :ivar gripper_failed: whether the gripper was the reason
    :ivar motion: number of the motion of the present step; 0 before it has one
    """

    name: str
    step: int
    steps: int
    step_name: str
    running: bool
    problem: str
    gripper_failed: bool = False
    motion: int = 0


class _Run:
    """One execution of a sequence; used by the thread that ticks."""

    def __init__(self, prepared: PreparedSequence, measured: np.ndarray | None):
        self.course = Course(prepared.sequence, prepared.first)
        self.prepared, self.measured = prepared.motions, measured
        self.motion = 0  # number of the motion of the present step; 0 before it has one
        self.entered, self.problem, self.gripper_failed = False, '', False


class SequenceRunner:
    """
    Executes one sequence at a time; one thread calls `advance`, others the rest.

    :ivar gripper: for steps with a command for it; None without one
    :ivar paused: no step begins and no hold passes meanwhile
    """

    def __init__(self, gripper: GripperCommands | None, events: GripperSequence | None):
        """:param events: carries out the gripper commands of skills; None without a gripper"""
        self.gripper, self._events, self.paused = gripper, events, False
        self._run: _Run | None = None
        self._last: _Run | None = None

    def prepare(self, sequence: SkillSequence, first: int, settings: PlayerSettings,
                check: Callable[[StreamedSkill, np.ndarray], None]) -> PreparedSequence:
        """
        Check a sequence, and prepare its motions.

        :param first: index of the step to begin with
        :param check: refuses a place that a motion cannot have as goal
        :raises GdmpError: if a skill or goal cannot be used, or there is no such step
        """
        sequence.check_index(first)
        result: dict[int, PreparedStep] = {}
        for index, step in enumerate(sequence.steps):
            if isinstance(step, MotionStep):
                tool = StreamedSkill(step.skill, settings)
                rollout = step.rollout(options=tool.options(0.0, None))
                check(tool, tool.place_of(rollout.goal))
                result[index] = PreparedStep(tool, rollout)
        name, tools = sequence.name, [item.tool for item in result.values()]
        if len({tool.kind for tool in tools}) > 1:
            raise ParameterError(f'{name}: skills of the tool, of two tools and of the joints '
                                 'cannot be in one sequence')
        commands = any(isinstance(step, GripperStep) for step in sequence.steps)
        if (commands or any(tool.skill.events for tool in tools)) and (
                self.gripper is None or not self.gripper.is_known()):
            raise ParameterError(f'{name}: it has commands for a gripper, and no state of one is '
                                 'known')
        for skill in {tool.skill for tool in tools}:
            rehearse(skill, settings)
        return PreparedSequence(sequence, first, result)

    def begin(self, prepared: PreparedSequence, measured: np.ndarray | None) -> None:
        """
        Begin a sequence; another one ends.

        :param measured: where the robot is; None to begin at the start of the first skill
        """
        self.paused = False
        self._run = self._last = _Run(prepared, measured)

    def cancel(self, reason: str) -> None:
        """End the sequence; its present motion goes on unless the caller stops it."""
        run, self._run = self._run, None
        if run is not None:
            run.problem = reason

    def signal(self, name: str) -> None:
        """
        Tell the present step that something has happened.

        :raises ParameterError: if no sequence is executed
        """
        run = self._run
        if run is None:
            raise ParameterError(f'signal {name!r}: no sequence is being executed')
        run.course.signal(name)

    @property
    def running(self) -> bool:
        """Whether a sequence is being executed."""
        return self._run is not None

    @property
    def status(self) -> SequenceStatus | None:
        """Where the sequence is, or the last one ended; None before the first one."""
        run = self._last
        if run is None:
            return None
        steps, at = run.course.sequence.steps, run.course.index
        index = min(at, len(steps) - 1)
        return SequenceStatus(run.course.sequence.name, index + 1, len(steps), steps[index].name,
                              self._run is run, run.problem, run.gripper_failed, run.motion)

    def advance(self, player: Player, dt: float) -> None:
        """Let ``dt`` seconds pass, after the tick of the player."""
        run = self._run
        if run is None or self.paused:
            return
        if not run.entered:
            if not isinstance(run.course.step, MotionStep) and player.status in _MOVING:
                return  # the motion before stops first
            self._enter(run, player)
        if run.motion and not self._has_begun(run, player):
            return
        if self._ended(run, player, dt):
            run.course.enter(run.course.index + 1)
            if run.course.step is not None:
                self._enter(run, player)
            elif self._run is run:
                self._run = None

    def _enter(self, run: _Run, player: Player) -> None:
        run.entered, step = True, run.course.step
        if isinstance(step, MotionStep):
            result = run.prepared[run.course.index]
            run.motion = player.begin(result.tool, result.rollout, run.measured,
                                      wanted=lambda: self._run is run)
            run.measured = None
        elif isinstance(step, GripperStep) and self.gripper is not None:
            self.gripper.begin(GripperCommand(*step.command[1:]))

    def _has_begun(self, run: _Run, player: Player) -> bool:
        """Whether the motion of the step is there; otherwise it waits, or the sequence ends."""
        if player.motion < run.motion:
            return False
        if player.motion > run.motion:
            self._end(run, OTHER_MOTION)
        elif player.rollout is None and player.status is Status.HOLDING:
            self._end(run, 'the motion was stopped, or could not begin')
        return self._run is run and player.rollout is not None

    def _ended(self, run: _Run, player: Player, dt: float) -> bool:
        step, rollout = run.course.step, player.rollout
        if isinstance(step, HoldStep):
            return run.course.hold_ended(step, dt)
        if isinstance(step, MotionStep):
            if self._events is not None and step.skill.events:
                failed = self._events.problem(run.motion)
                if failed:
                    self._fail(run, player, failed)
                if failed or self._events.waits_for_more(player):
                    return False
            return rollout is not None and run.course.motion_ended(step, rollout)
        problem = '' if self.gripper is None else self.gripper.outcome(dt)
        if problem:
            self._fail(run, player, f'gripper: {problem}')
            return False
        return problem is not None

    def _fail(self, run: _Run, player: Player, problem: str) -> None:
        run.gripper_failed = True
        self._end(run, problem)
        player.end()

    def _end(self, run: _Run, problem: str) -> None:
        run.problem = problem
        if self._run is run:
            self._run = None
