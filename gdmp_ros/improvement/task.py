"""Tasks: what a roll-out of a skill costs. Built in, a Python file, or an executable."""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import functools
import hashlib
import importlib.util
import os
from pathlib import Path
import subprocess
import tempfile
import traceback
from types import ModuleType
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import DataError, ParameterError
from gdmp_ros.improvement.trial import perform, Trial
from gdmp_ros.improvement.variables import Variable
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.closed_loop import ClosedLoop
from gdmp_ros.sim.path_check import PathChecker, Reach

#: Time in which an executable has to score a roll-out [s].
SCORE_S = 60.0


class Outcome(NamedTuple):
    """
    What came of a roll-out.

    :ivar terms: of its cost by name; None if it was ended early
    :ivar success: whether the task was done; None if the task does not say
    :ivar ended: why it was ended early; empty if it was not
    """

    terms: dict[str, float] | None
    success: bool | None = None
    ended: str = ''

    @property
    def cost(self) -> float | None:
        """Sum of the terms."""
        return None if self.terms is None else sum(self.terms.values())


class Task(Protocol):
    """
    A task; it goes to other processes, so it is made of plain values.

    :ivar name: for people
    """

    name: str

    def rollout(self, skill: Skill, seed: int) -> Outcome:
        """
        Execute a skill once.

        :param seed: the same one gives the same situation and the same outcome
        """


@runtime_checkable
class ProvidesSkill(Protocol):
    """A task that brings the skill that is improved, and what varies."""

    def skill(self) -> Skill:
        """Return the skill before improvement."""

    def variables(self) -> Sequence[Variable]:
        """What varies."""


class Scored(NamedTuple):
    """
    What scoring a trial gives.

    :ivar terms: of the cost by name
    :ivar success: whether the task was done; None if that is not known
    """

    terms: Mapping[str, float]
    success: bool | None = None


@dataclass
class SimulatedTask:
    """A task of a simulated arm: subclasses say in which situation, and what a trial costs."""

    name: str = 'simulation'
    largest_force: float = np.inf

    def arm(self, seed: int) -> Arm:
        """Arm, with what is around it; the built-in Panda alone by default."""
        return Arm()

    def score(self, trial: Trial) -> Scored:
        """Score a roll-out that was not ended early."""
        raise NotImplementedError

    def rollout(self, skill: Skill, seed: int) -> Outcome:
        """Execute a skill once; : the arm begins at the start of the skill."""
        arm, alone = self.arm(seed), Arm()
        loop = ClosedLoop(arm)
        loop.reset(Reach(alone).posture(skill.start[:7], alone.home))
        return self.outcome(perform(skill, loop, PathChecker(alone), self.largest_force))

    def outcome(self, trial: Trial) -> Outcome:
        """What came of a trial."""
        if trial.ended:
            return Outcome(None, ended=trial.ended)
        scored = self.score(trial)
        return Outcome(_finite(self.name, scored.terms), scored.success)


@dataclass
class FileTask(SimulatedTask):
    """
    A Python file.

    ``score(trial)`` returns the cost: a number, a dictionary of its terms, or a `Scored`.
    ``arm(seed)`` is optional, and returns the `Arm` of a roll-out.

    :ivar digest: of its contents, to recognise it
    """

    path: str = ''
    digest: str = ''

    def arm(self, seed: int) -> Arm:
        """Arm, with what is around it; the built-in Panda alone by default."""
        make = getattr(self.module(), 'arm', None)
        result = super().arm(seed) if make is None else make(seed)
        if not isinstance(result, Arm):
            raise DataError(f'{self.path}: arm returned {result!r}, expected a gdmp_ros.sim.Arm')
        return result

    def score(self, trial: Trial) -> Scored:
        """Score a roll-out that was not ended early."""
        module = self.module()
        try:
            given = module.score(trial)
        except Exception as error:
            last = traceback.extract_tb(error.__traceback__)[-1]
            raise DataError(f'{last.filename}, line {last.lineno}: score(trial) failed: '
                            f'{type(error).__name__}: {error}') from error
        if isinstance(given, Scored):
            return given
        return Scored(given if isinstance(given, Mapping) else {'cost': given})

    def module(self) -> ModuleType:
        """
        Execute the file, once.

        :raises DataError: if it fails
        """
        return _module(self.path, os.stat(self.path).st_mtime_ns)


@dataclass
class ExecutableTask(SimulatedTask):
    """
    An executable: it gets a file with a trial (NumPy, ``.npz``), and prints its cost.

    :ivar digest: of its contents, to recognise it
    """

    path: str = ''
    digest: str = ''

    def score(self, trial: Trial) -> Scored:
        """Score a roll-out that was not ended early."""
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / 'trial.npz'
            np.savez(file, **{name: value for name, value in trial._asdict().items()
                              if name != 'ended'})
            try:
                done = subprocess.run([self.path, str(file)], capture_output=True, text=True,
                                      timeout=SCORE_S, check=False)
            except subprocess.TimeoutExpired:
                raise DataError(f'{self.path}: no score after {SCORE_S:g} s') from None
        if done.returncode != 0:
            raise DataError(f'{self.path}: exit code {done.returncode}: {done.stderr.strip()}')
        words = done.stdout.split()
        try:
            return Scored({'cost': float(words[-1])})
        except (ValueError, IndexError):
            raise DataError(f'{self.path}: printed {done.stdout.strip()!r}, expected a number as '
                            'the last word') from None


@functools.cache
def _module(path: str, changed: int) -> ModuleType:
    """
    Execute a Python file once.

    :param changed: when it was changed; a changed one is executed again
    """
    spec = importlib.util.spec_from_file_location('gdmp_task', path)
    if spec is None or spec.loader is None:
        raise DataError(f'{path}: not a Python file')
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise DataError(f'{path}: {type(error).__name__}: {error}') from error
    return module


def task_from_file(path: Path, largest_force: float = np.inf) -> SimulatedTask:
    """
    Read a task.

    :param path: Python file with ``score(trial)``, or executable
    :raises DataError: if it is neither
    """
    if not path.is_file():
        raise DataError(f'{path}: there is no such file')
    absolute = str(path.resolve())
    digest = hashlib.sha256(path.read_bytes()).hexdigest()[:16]
    if path.suffix == '.py':
        task = FileTask(path.name, largest_force, absolute, digest)
        if not callable(getattr(task.module(), 'score', None)):
            raise DataError(f'{path}: expected a function score(trial)')
        return task
    if not os.access(path, os.X_OK):
        raise DataError(f'{path}: neither a Python file nor executable')
    return ExecutableTask(path.name, largest_force, absolute, digest)


def _finite(name: str, terms: Mapping[str, float]) -> dict[str, float]:
    result = {}
    for term, value in terms.items():
        try:
            result[str(term)] = float(value)
        except (TypeError, ValueError):
            raise ParameterError(f'{name}: the cost {term} is {value!r}, expected a number'
                                 ) from None
        if not np.isfinite(result[str(term)]):
            raise ParameterError(f'{name}: the cost {term} is {value!r}, expected a finite number')
    return result


