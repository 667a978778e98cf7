"""Executes a sequence with a player: begins each step when the one before has ended."""
from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gdmp_ros.control.gripper import GripperCommand
from gdmp_ros.dmp.rollout import Rollout
from gdmp_ros.dmp.sequence import Course, GripperStep, HoldStep, MotionStep, SkillSequence
from gdmp_ros.playback.gripper_sequence import GripperCommands
from gdmp_ros.playback.player import Player
from gdmp_ros.playback.player_settings import PlayerSettings
from gdmp_ros.playback.requests import Status
from gdmp_ros.playback.streamed import streamed
from gdmp_ros.playback.streamed_skill import StreamedSkill

#: Why a sequence ended: because of another motion.
OTHER_MOTION = 'another motion was started'


class PreparedStep(NamedTuple):
    """A motion of a sequence, ready to begin."""

    tool: StreamedSkill
    rollout: Rollout


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


def prepared_steps(sequence: SkillSequence, settings: PlayerSettings,
                   check: Callable[[StreamedSkill, np.ndarray], None]
                   ) -> dict[int, PreparedStep]:
    """
    Motions of a sequence by the index of their step.

    :param check: refuses a place that a motion cannot have as goal
    :raises GdmpError: if a skill or goal cannot be used
    """
    made = {}
    for index, step in enumerate(sequence.steps):
        if isinstance(step, MotionStep):
            tool = streamed(step.skill, settings)
            rollout = step.rollout(options=tool.options(0.0, None))
            check(tool, tool.place_of(rollout.goal))
            made[index] = PreparedStep(tool, rollout)
    return made


class _Run:
    """One execution of a sequence; used by the thread that ticks."""

    def __init__(self, sequence: SkillSequence, first: int, prepared: dict[int, PreparedStep],
                 measured: np.ndarray | None):
        self.course, self.prepared, self.measured = Course(sequence, first), prepared, measured
        self.motion = 0  # number of the motion of the present step; 0 before it has one
        self.entered, self.problem, self.gripper_failed = False, '', False


class SequenceRunner:
    """
    Executes one sequence at a time; one thread calls `advance`, others the rest.

    :ivar gripper: for steps with a command for it; None without one
    """

    def __init__(self, gripper: GripperCommands | None):
        self.gripper = gripper
        self._run: _Run | None = None
        self._last: _Run | None = None

    def begin(self, sequence: SkillSequence, first: int, prepared: dict[int, PreparedStep],
              measured: np.ndarray | None) -> None:
        """
        Begin a sequence; another one ends.

        :param first: index of the first step
        :param measured: where the robot is; None to begin at the start of the first skill
        :raises ParameterError: unless there is such a step
        """
        self._run = self._last = _Run(sequence, first, prepared, measured)

    def cancel(self, reason: str) -> None:
        """End the sequence; the present motion goes on, or is stopped by somebody else."""
        run, self._run = self._run, None
        if run is not None:
            run.problem = reason

    def signal(self, name: str) -> None:
        """Tell the present step that something has happened."""
        run = self._run
        if run is not None:
            run.course.signal(name)

    @property
    def status(self) -> SequenceStatus | None:
        """Where the sequence is, or the last one ended; None before the first one."""
        run = self._last
        if run is None:
            return None
        steps, at = run.course.sequence.steps, run.course.index
        shown = min(at, len(steps) - 1)
        return SequenceStatus(run.course.sequence.name, shown + 1, len(steps), steps[shown].name,
                              self._run is run, run.problem, run.gripper_failed, run.motion)

    def advance(self, player: Player, dt: float) -> None:
        """Let ``dt`` seconds pass, after the tick of the player."""
        run = self._run
        if run is None:
            return
        if not run.entered:
            self._enter(run, player)
        if run.motion and not self._has_begun(run, player):
            return
        if self._ended(run, player, 0.0 if player.status is Status.PAUSED else dt):
            run.course.enter(run.course.index + 1)
            if run.course.step is None:
                self._run = None
                return
            self._enter(run, player)

    def _enter(self, run: _Run, player: Player) -> None:
        run.entered, step = True, run.course.step
        if isinstance(step, MotionStep):
            made = run.prepared[run.course.index]
            run.motion = player.begin(made.tool, made.rollout, run.measured,
                                      still=lambda: self._run is run)
            if step.skill.rhythmic and step.amplitude != 1.0:
                player.set_amplitude(step.amplitude)
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
            return rollout is not None and run.course.motion_ended(step, rollout)
        problem = '' if self.gripper is None else self.gripper.outcome(dt)
        if problem:
            run.gripper_failed = True
            self._end(run, f'gripper: {problem}')
            player.stop()
            return False
        return problem is not None

    def _end(self, run: _Run, problem: str) -> None:
        run.problem = problem
        if self._run is run:
            self._run = None
