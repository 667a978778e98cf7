"""The improvement of a skill: updates of a search by the costs of roll-outs."""
from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
import hashlib
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import GdmpError, ParameterError
from gdmp_ros.improvement.search import Search, search_of
from gdmp_ros.improvement.task import Outcome, Task
from gdmp_ros.improvement.variables import Variables

#: Number of the held-out situations in place of that of an update: beyond all of those.
HELD_OUT = 1 << 31


class Effort(NamedTuple):
    """
    How much is tried.

    :ivar updates: of the search
    :ivar samples: skills that are tried in each update, at least 2
    :ivar situations: roll-outs of each of them, each in another situation; the same situations
        for all skills of an update, so that they can be compared
    :ivar held_out: roll-outs with which the skill is judged before and after, in situations that
        are not used for learning
    """

    updates: int = 12
    samples: int = 10
    situations: int = 4
    held_out: int = 0

    @property
    def rollouts(self) -> int:
        """Roll-outs from which is learned."""
        return self.updates * self.samples * self.situations


class Job(NamedTuple):
    """
    A roll-out to make.

    :ivar values: of the variables
    :ivar seed: of the situation
    """

    task: Task
    variables: Variables
    values: np.ndarray
    seed: int


#: Makes roll-outs: a title, jobs by key -> what `roll_out` returns, by key.
Execute: TypeAlias = Callable[[str, dict[str, Job]], dict[str, Any]]


def skill_of(job: Job) -> Skill | Outcome:
    """Return the skill of a roll-out; an impossible one is a roll-out that was ended early."""
    try:
        return job.variables.apply(job.values)
    except GdmpError as error:
        return Outcome(None, ended=f'no such skill: {error}')


def roll_out(job: Job) -> list[Any]:
    """Make a roll-out; an `Outcome` as a list."""
    skill = skill_of(job)
    return list(skill if isinstance(skill, Outcome) else job.task.rollout(skill, job.seed))


class Update(NamedTuple):
    """
    An update of the search.

    :ivar costs: of its samples; None for one that was ended early
    :ivar ended: why roll-outs were ended early
    :ivar deviations: standard deviations of the variables after it, in units of the first ones
    """

    costs: list[float | None]
    ended: list[str]
    deviations: np.ndarray


class Judgement(NamedTuple):
    """
    How a skill does in situations that are not used for learning.

    :ivar costs: None for roll-outs that were ended early
    :ivar successes: None if the task does not say
    """

    costs: list[float | None]
    successes: list[bool] | None

    @property
    def median(self) -> float | None:
        """Median cost of the roll-outs that were not ended early; None without any."""
        known = [cost for cost in self.costs if cost is not None]
        return float(np.median(known)) if known else None

    @property
    def success(self) -> float | None:
        """Share of successes."""
        return None if self.successes is None else float(np.mean(self.successes))


    @property
    def rank(self) -> tuple[float, float, float]:
        """Sorts judgements of the same task: failures, roll-outs ended early, median cost."""
        median = self.median
        return (0.0 if self.success is None else 1.0 - self.success,
                float(np.mean([cost is None for cost in self.costs])),
                np.inf if median is None else median)


@dataclass
class Improvement:
    """
    An improvement under way, or at its end.

    :ivar search: with the best guess and its covariance
    :ivar updates: that have been made
    :ivar before: judgement of the skill before; None without held-out roll-outs
    :ivar after: of the improved skill
    """

    task: Task
    variables: Variables
    effort: Effort
    search_name: str
    seed: int
    search: Search
    updates: list[Update] = field(default_factory=list)
    before: Judgement | None = None
    after: Judgement | None = None

    @property
    def rollouts(self) -> int:
        """Roll-outs from which was learned so far."""
        return len(self.updates) * self.effort.samples * self.effort.situations

    @property
    def worse(self) -> bool:
        """Whether the best guess does worse than the skill before where both were judged."""
        return (self.before is not None and self.after is not None
                and self.after.rank > self.before.rank)

    def skill(self) -> Skill:
        """
        Return the skill at the best guess, which says where it comes from.

        If it does worse, this is the skill before, in the same way.
        """
        result = self.variables.skill if self.worse else self.variables.apply(self.search.mean)
        source: dict[str, Any] = {
            'task': self.task.name, 'search': self.search_name, 'rollouts': self.rollouts,
            'seed': self.seed, 'skill': dict(self.variables.skill.provenance)}
        for name, judged in (('before', self.before), ('after', self.after)):
            if judged is not None:
                source[name] = {'median_cost': judged.median, 'success': judged.success}
        if self.worse:
            source['kept'] = 'the skill before: the best guess does worse'
        return replace(result, provenance={'improved': source})


def subject(task: Task, variables: Variables, search: str, effort: Effort, seed: int) -> str:
    """What a journal of these roll-outs is about; other numbers of updates may share one."""
    skill = variables.skill
    digest = hashlib.sha256(repr((task, variables, search, effort.samples, effort.situations,
                                  seed, skill.manifold, skill.duration)).encode())
    for array in (skill.start, skill.goal, skill.weights, skill.velocity):
        digest.update(array.tobytes())
    return f'improvement {digest.hexdigest()[:16]}'


def improve(task: Task, variables: Variables, execute: Execute, effort: Effort,
            search: str = 'pibb', seed: int = 0) -> Iterator[Improvement]:
    """
    Improve a skill; the state after every update, and at last with the judgement.

    Random numbers depend on the seed and the update only, whoever makes the roll-outs, and in
    whatever order they end.

    :raises ParameterError: if a number is out of range, or the search unknown
    """
    for name, least in (('updates', 1), ('samples', 2), ('situations', 1), ('held_out', 0)):
        if getattr(effort, name) < least:
            raise ParameterError(f'{name} is {getattr(effort, name)}, expected at least {least}')
    result = search_of(search, variables.size)
    state = Improvement(task, variables, effort, search, seed, result)
    if effort.held_out:
        state.before = _judged(state, execute, 'before')
    for number in range(effort.updates):
        samples = result.ask(effort.samples, np.random.default_rng([seed, number]))
        jobs = {f'{number}/{k}/{m}': Job(task, variables, sample, _situation(seed, number, m))
                for k, sample in enumerate(samples) for m in range(effort.situations)}
        outcomes = _outcomes(execute(f'update {number + 1} of {effort.updates}', jobs))
        costs = [_mean([outcomes[f'{number}/{k}/{m}'].cost for m in range(effort.situations)])
                 for k in range(effort.samples)]
        result.tell(samples, costs)
        state.updates.append(Update(costs, sorted(
            item.ended for item in outcomes.values() if item.ended),
            np.sqrt(np.diag(result.covariance))))
        yield state
    if effort.held_out:
        state.after = _judged(state, execute, 'after')
        yield state


def _situation(seed: int, *which: int) -> int:
    return int(np.random.SeedSequence([seed, *which]).generate_state(1)[0])


def _judged(state: Improvement, execute: Execute, when: str) -> Judgement:
    """Judge the best guess, in situations of their own."""
    jobs = {f'{when}/{state.effort.updates if when == "after" else 0}/{m}': Job(
        state.task, state.variables, state.search.mean,
        _situation(state.seed, HELD_OUT, m)) for m in range(state.effort.held_out)}
    outcomes = list(_outcomes(execute(f'judging {when}', jobs)).values())
    successes = [outcome.success is True for outcome in outcomes]
    known = any(outcome.success is not None for outcome in outcomes)
    return Judgement([outcome.cost for outcome in outcomes], successes if known else None)


def _outcomes(plain: dict[str, Any]) -> dict[str, Outcome]:
    return {key: Outcome(*item) for key, item in plain.items()}


def _mean(costs: Sequence[float | None]) -> float | None:
    """Mean cost of a skill; None if one of its roll-outs was ended early."""
    known = [cost for cost in costs if cost is not None]
    return float(np.mean(known)) if len(known) == len(costs) else None
