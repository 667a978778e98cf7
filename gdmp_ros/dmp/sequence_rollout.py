"""The execution of a sequence on one manifold."""
from __future__ import annotations

import numpy as np

from gdmp_ros.dmp.options import check_range
from gdmp_ros.dmp.rollout import Rollout
from gdmp_ros.dmp.sequence import Course, HoldStep, LONGEST_HOLD, MotionStep, SkillSequence, Step
from gdmp_ros.dmp.state import State
from gdmp_ros.errors import DataError


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
        :raises DataError: if the skills are on different manifolds
        """
        motions = [step for step in sequence.steps if isinstance(step, MotionStep)]
        self.manifold = motions[0].skill.manifold
        for step in motions:
            if step.skill.manifold != self.manifold:
                raise DataError(f'{sequence.name}: step {step.name} is on '
                                f'{step.skill.manifold!r}, the first one on {self.manifold!r}')
        self.course = Course(sequence, first)
        later = [step for step in sequence.steps[first:] if isinstance(step, MotionStep)]
        begin = (later or motions[-1:])[0]
        if start is None:
            start = begin.skill.start if later else begin.goal
        place = self.manifold.flat(begin.skill.goal if start is None else start)
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
