"""
Sequences: skills, holds and commands for a gripper, one after the other.

A motion begins with position, velocity and acceleration of the one before, whatever that does at
the moment: nothing has a step at a join. The same steps are executed here and by a trajectory
server (`gdmp_ros.playback.sequence_runner`).
"""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
import math
from typing import Any

import numpy as np

from gdmp_ros.dmp.options import check_range, MAX_AMPLITUDE, merged_options, SHORTEST_DURATION
from gdmp_ros.dmp.primitive import checked_events, GripperEvent, State
from gdmp_ros.dmp.rollout import Rollout
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import DataError, ParameterError

#: Longest hold [s], and most cycles.
LONGEST_HOLD, MOST_CYCLES = 86400.0, 1e6


@dataclass(frozen=True, eq=False)
class Step:
    """
    One part of a sequence.

    :ivar name: for messages
    """

    name: str


@dataclass(frozen=True, eq=False)
class MotionStep(Step):
    """
    A skill that is executed.

    :ivar goal: point; of a rhythmic skill the centre; None for its own
    :ivar duration: of a rhythmic skill the period [s]; None for its own
    :ivar cycles: of a rhythmic skill
    :ivar until: signal that ends a rhythmic skill
    :ivar amplitude: of a rhythmic skill
    :ivar blend: how long before its end the next motion takes over [s]; 0: it comes to rest at its
        goal. A rhythmic one with a blend does not come to rest: the next motion takes over on the
        cycle
    """

    skill: Skill
    goal: np.ndarray | None = None
    duration: float | None = None
    cycles: float | None = None
    until: str = ''
    amplitude: float = 1.0
    blend: float = 0.0

    def __post_init__(self) -> None:
        duration = self.skill.duration
        if self.duration is not None:
            duration = check_range(f'step {self.name}: duration', self.duration,
                                   SHORTEST_DURATION, 1e6)
        check_range(f'step {self.name}: blend', self.blend, 0.0,
                    math.inf if self.skill.rhythmic else 0.5 * duration)
        if self.goal is not None:
            object.__setattr__(self, 'goal', self.skill.manifold.check_point(self.goal))
        if not self.skill.rhythmic:
            if self.cycles is not None or self.until or self.amplitude != 1.0:
                raise ParameterError(f'step {self.name}: cycles, until and amplitude need a '
                                     'rhythmic skill')
            return
        check_range(f'step {self.name}: amplitude', self.amplitude, 0.0, MAX_AMPLITUDE)
        if self.cycles is not None:
            check_range(f'step {self.name}: cycles', self.cycles, 0.0, MOST_CYCLES)
        elif not self.until:
            raise ParameterError(f'step {self.name}: a rhythmic skill needs cycles, or until with '
                                 'the name of a signal')

    def rollout(self, **options: Any) -> Rollout:
        """Roll-out of the skill with goal and duration of the step."""
        result = merged_options(options.pop('options', None), {'amplitude': self.amplitude})
        return Rollout(self.skill, goal=self.goal, duration=self.duration, options=result,
                       **options)


@dataclass(frozen=True, eq=False)
class HoldStep(Step):
    """
    Rest at the goal of the motion before.

    :ivar seconds: at most, or exactly without a signal
    :ivar until: signal that ends it; empty for none
    """

    seconds: float = math.inf
    until: str = ''

    def __post_init__(self) -> None:
        if not self.until or self.seconds != math.inf:
            check_range(f'step {self.name}: hold', self.seconds, 0.0, LONGEST_HOLD)


@dataclass(frozen=True, eq=False)
class GripperStep(Step):
    """
    A command for the gripper; the sequence goes on when it has been carried out.

    :ivar command: its progress does not count
    """

    command: GripperEvent = field(default_factory=lambda: GripperEvent(0.0, 0.0, 0.0, 0.1))

    def __post_init__(self) -> None:
        checked_events((self.command,))


class SkillSequence:
    """Steps that are executed one after the other."""

    def __init__(self, steps: Sequence[Step], name: str = 'sequence'):
        """
        Check that the steps fit.

        :param name: for messages
        :raises DataError: without a motion
        """
        self.steps, self.name = tuple(steps), name
        if not any(isinstance(step, MotionStep) for step in self.steps):
            raise DataError(f'{name}: a sequence needs a step with a skill')

    def __len__(self) -> int:
        return len(self.steps)

    def __repr__(self) -> str:
        return f'SkillSequence({self.name}: {", ".join(step.name for step in self.steps)})'

    def check_index(self, index: int) -> int:
        """:raises ParameterError: unless there is a step with this index"""
        if not isinstance(index, (int, np.integer)):
            raise ParameterError(f'{self.name}: step is {index!r}, expected an index')
        if not 0 <= index < len(self.steps):
            raise ParameterError(f'{self.name}: step is {index + 1}, expected 1 to '
                                 f'{len(self.steps)}')
        return index

    def blends(self, index: int) -> bool:
        """Whether the step after this one takes over before its end."""
        step = self.steps[index]
        return (isinstance(step, MotionStep) and step.blend > 0.0 and index + 1 < len(self.steps)
                and isinstance(self.steps[index + 1], MotionStep))


class Course:
    """
    Where a sequence is.

    :ivar index: of the present step; that of the last one plus one at the end
    """

    def __init__(self, sequence: SkillSequence, first: int = 0):
        """:raises ParameterError: unless there is such a step"""
        self.sequence = sequence
        self.enter(sequence.check_index(first))

    @property
    def step(self) -> Step | None:
        """The present step; None at the end."""
        steps = self.sequence.steps
        return steps[self.index] if self.index < len(steps) else None

    def enter(self, index: int) -> None:
        """Begin a step."""
        self.index, self._waited, self._ends = index, 0.0, False
        self._signals: set[str] = set()

    def signal(self, name: str) -> None:
        """Tell the present step that something has happened."""
        self._signals.add(name)

    def motion_ended(self, step: MotionStep, rollout: Rollout) -> bool:
        """
        Whether the present motion has ended; a cycle that is to end is told to.

        :param rollout: of the step
        """
        blends = self.sequence.blends(self.index)
        if not step.skill.rhythmic:
            left = (1.0 - rollout.progress) * rollout.duration
            return rollout.finished or (blends and left <= step.blend)
        if not self._ends:
            cycled = step.cycles is not None and rollout.progress >= step.cycles
            self._ends = cycled or (bool(step.until) and step.until in self._signals)
            if self._ends and not blends:
                rollout.set_amplitude(0.0)
        # The amplitude may have been set to 0 by a topic.
        return rollout.finished or (self._ends and blends)

    def hold_ended(self, step: HoldStep, dt: float) -> bool:
        """Let ``dt`` seconds pass; whether the present hold has ended."""
        self._waited += dt
        return self._waited >= step.seconds or bool(step.until and step.until in self._signals)


class SequenceRollout:
    """
    Executes a sequence of skills on one manifold, as `gdmp_ros.dmp.Rollout` executes a skill.

    Commands for a gripper take no time here.

    :ivar course: where it is
    """

    def __init__(self, sequence: SkillSequence, start: np.ndarray | None = None, first: int = 0):
        """
        Begin at the start of the first skill, or elsewhere.

        :param start: point; from rest
        :param first: index of the first step
        :raises ParameterError: unless there is such a step
        :raises ManifoldError: if the start is not on the manifold
        :raises DataError: if the skills are on different manifolds
        """
        motions = [step for step in sequence.steps if isinstance(step, MotionStep)]
        self.manifold = motions[0].skill.manifold
        for step in motions:
            if step.skill.manifold != self.manifold:
                raise DataError(f'{sequence.name}: step {step.name} is on '
                                f'{step.skill.manifold!r}, the first one on {self.manifold!r}: '
                                'learn both with, or without, a stiffness (gdmp learn '
                                '--stiffness none)')
        self.course = Course(sequence, first)
        later = [step for step in sequence.steps[first:] if isinstance(step, MotionStep)]
        begin = (later or motions[-1:])[0]
        ends = begin.skill.goal if begin.goal is None else begin.goal
        place = self.manifold.flat((begin.skill.start if later else ends) if start is None
                                   else self.manifold.check_point(start))
        rest = np.zeros(2 * self.manifold.tangent_size)
        self._resting = State(np.concatenate([[0.0, 1.0], place, rest]), self.manifold)
        self._rollout: Rollout | None = None
        self._time, self._last = 0.0, self._resting.point
        self._enter(first)

    @property
    def finished(self) -> bool:
        """Whether the last step has ended."""
        return self.course.step is None

    @property
    def rollout(self) -> Rollout | None:
        """The present motion, or the last one; None before the first."""
        return self._rollout

    @property
    def state(self) -> State:
        """The present state, without letting time pass."""
        return self.advance(0.0)

    def signal(self, name: str) -> None:
        """Tell the present step that something has happened."""
        self.course.signal(name)

    def go_to(self, index: int) -> None:
        """
        Go on with another step, from the present state.

        :raises ParameterError: unless there is such a step
        """
        self._enter(self.course.sequence.check_index(index))

    def advance(self, dt: float) -> State:
        """
        Let ``dt`` seconds pass and return the state then; a step ends at the end of such a time.

        :raises ParameterError: as `Rollout.advance`
        """
        state = self._now(dt)
        self._time += dt
        while (step := self.course.step) is not None and self._ended(step, dt):
            dt = 0.0
            self._enter(self.course.index + 1)
        numbers = np.array(state.numbers)
        numbers[0] = self._time
        # A skill may use the other representative (-q) of an orientation.
        last = self.manifold.align(state.point, self._last)
        numbers[2:2 + last.size], self._last = last.reshape(-1), last
        return State(numbers, self.manifold)

    def _now(self, dt: float) -> State:
        if self._rollout is not None:
            return self._rollout.advance(dt)
        check_range('the time to pass', dt, 0.0, LONGEST_HOLD)
        return self._resting

    def _ended(self, step: Step, dt: float) -> bool:
        if isinstance(step, HoldStep):
            return self.course.hold_ended(step, dt)
        if isinstance(step, MotionStep) and self._rollout is not None:
            return self.course.motion_ended(step, self._rollout)
        return True

    def _enter(self, index: int) -> None:
        self.course.enter(index)
        step = self.course.step
        if not isinstance(step, MotionStep):
            return
        state = self._now(0.0)
        rollout = step.rollout()
        rollout.begin(self.manifold.align(state.point, step.skill.start), state.velocity,
                      state.acceleration)
        self._rollout = rollout
