"""Roll-outs on a robot, one by one: each begins when a person says go."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import GdmpError
from gdmp_ros.improvement.session import Job, skill_of
from gdmp_ros.improvement.task import Outcome, SimulatedTask
from gdmp_ros.improvement.trial import Trial
from gdmp_ros.util.parallel import Journal

#: Samples of a path that is compared with that of the skill before.
SAMPLES = 60
REPEAT, WORST, QUIT = 'r', 'w', 'q'
AGAIN = 'repeat the last one'


class Robot(Protocol):
    """A robot that executes skills from the same posture."""

    def perform(self, skill: Skill) -> Trial:
        """
        Go to where roll-outs begin, and execute a skill.

        :raises GdmpError: if it was not begun, and may be tried again
        """

    def go_back(self) -> None:
        """
        Go back the way it came, to where roll-outs begin.

        :raises GdmpError: if it does not arrive; it may be tried again
        """


@dataclass
class RobotTask:
    """
    A task of a robot, scored as in simulation; see `gdmp_ros.improvement.task.Task`.

    :ivar scored: says what a trial costs
    """

    scored: SimulatedTask
    robot: Robot = field(repr=False)
    name: str = ''

    def __post_init__(self) -> None:
        self.name = self.name or self.scored.name

    def rollout(self, skill: Skill, seed: int) -> Outcome:
        """Execute a skill once; the situation is what the person has set up."""
        return self.scored.outcome(self.robot.perform(skill))


class Quit(GdmpError):
    """The person has ended the session."""


class OneByOne:
    """
    Makes roll-outs one after the other (`gdmp_ros.improvement.session.Execute`).

    Roll-outs of the same situation follow each other: it is set up once for all of them.
    """

    def __init__(self, robot: Robot, journal: Journal, ask: Callable[[str], str] = input,
                 tell: Callable[[str], None] = print):
        """
        Prepare.

        :param journal: keeps every roll-out; those in it are not made again
        :param ask: asks the person; returns the answer; EOFError if nobody answers
        :param tell: tells the person something
        """
        self._robot, self._journal, self._ask, self._tell = robot, journal, ask, tell

    def __call__(self, title: str, jobs: dict[str, Job]) -> dict[str, Any]:
        """
        Make the roll-outs that are not in the journal.

        :raises Quit: if the person quits
        """
        results = self._journal.results
        order = sorted(jobs, key=_situation)
        several = len({_situation(key) for key in order}) > 1
        result: list[str] = []
        while True:
            left = [key for key in order if key not in results]
            if not left:
                if not result or self._choose(f'{title}: all are made', {
                        '': 'go on', REPEAT: AGAIN, QUIT: 'quit'}) != REPEAT:
                    break
                del results[result.pop()]
                continue
            key, job = left[0], jobs[left[0]]
            skill = skill_of(job)
            if isinstance(skill, Outcome):
                self._journal.keep(key, list(skill))
                continue
            where = f'{title}, roll-out {len(order) - len(left) + 1} of {len(order)}'
            if several:
                where += f', situation {_situation(key) + 1}'
            self._tell(f'{where}: {_described(skill, job.variables.skill)}')
            answer = self._choose(where, {
                '': 'go', **({REPEAT: AGAIN} if result else {}),
                WORST: 'do not try it, score it worst', QUIT: 'quit'})
            if answer == REPEAT:
                del results[result.pop()]
            elif answer == WORST:
                self._journal.keep(key, list(Outcome(None, ended='not begun: the person did not '
                                                                 'want it')))
            elif self._made(key, job, skill):
                result.append(key)
        return {key: results[key] for key in jobs}

    def _choose(self, where: str, offered: dict[str, str]) -> str:
        """
        What the person wants.

        :param offered: what each answer means; an empty one is Enter
        :raises Quit: if the person quits, or nobody answers
        """
        choices = ', '.join(f'{key or "Enter"}: {meaning}' for key, meaning in offered.items())
        while True:
            try:
                answer = self._ask(f'{where} [{choices}] ').strip().lower()
            except EOFError:
                answer = QUIT
            if answer == QUIT:
                raise Quit('ended by the person; every roll-out is kept')
            if answer in offered:
                return answer

    def _made(self, key: str, job: Job, skill: Skill) -> bool:
        """Make a roll-out and bring the robot back; whether it counts."""
        counts = False
        try:
            outcome = job.task.rollout(skill, job.seed)
            self._journal.keep(key, list(outcome))
            self._tell(f'cost {outcome.cost:.4g}' if outcome.cost is not None
                       else f'worst: {outcome.ended}')
            counts = True
        except GdmpError as error:
            self._tell(f'this roll-out does not count: {error}')
        self._bring_back()
        return counts

    def _bring_back(self) -> None:
        """Bring the robot to where it began; after a problem as often as the person says so."""
        while True:
            try:
                self._robot.go_back()
                return
            except GdmpError as error:
                self._tell(f'the robot is not back: {error}')
                self._choose('the way back', {'': 'try again', QUIT: 'quit'})


def _situation(key: str) -> int:
    """Number of the situation of a roll-out: the last part of its key."""
    return int(key.rpartition('/')[2])


def _described(skill: Skill, before: Skill) -> str:
    """How a skill differs from the one before, for a person who is to say go."""
    paths = [item.rollout().sample(np.linspace(0.0, item.duration, SAMPLES)).points.reshape(
        SAMPLES, -1)[:, :3] for item in (skill, before)]
    distance = np.linalg.norm(paths[0] - paths[1], axis=1).max()
    steps = np.linalg.norm(np.diff(paths[0], axis=0), axis=1)
    speed = steps.max() * (SAMPLES - 1) / skill.duration
    return (f'{skill.duration:.2f} s, at most {speed:.2f} m/s, up to {1e3 * distance:.0f} mm from '
            'the skill before')
