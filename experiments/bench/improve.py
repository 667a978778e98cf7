"""
The two published demonstrations of dmpbbo, with reward-weighted averaging and with CMA-ES.

A via point with little acceleration (`demo_bbo_of_dmps.py`), in one and two dimensions, and a via
point in a force field with a schedule of gains (`demo_bbo_of_dmps_with_gains.py`): costs, numbers
of roll-outs and the simulation of the force field are those of dmpbbo.
"""
from __future__ import annotations

from dataclasses import dataclass
import math
from typing import Any

import numpy as np

from experiments import timing
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.rollout import Rollout
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.improvement.search import SEARCHES
from gdmp_ros.improvement.session import Effort, improve, Job, roll_out
from gdmp_ros.improvement.task import Outcome, Task
from gdmp_ros.improvement.variables import Variable, Variables, Weights
from gdmp_ros.manifolds.euclidean import Euclidean
from gdmp_ros.manifolds.product import Product
from gdmp_ros.manifolds.spd import SymmetricPositiveDefinite
from gdmp_ros.util.parallel import Journal, map_tasks
from gdmp_ros.util.profiles import minimum_jerk

TITLE = 'improvement: median (quartiles) over 10 seeds'
SEEDS = 10
#: Roll-outs with which a skill in a random field is judged at the end, and after every update.
JUDGED, GLANCED = 40, 8
#: The field is weaker than half of its peak before and after this time from the via point [s].
NEAR_S = 0.2


@dataclass
class ViaPoint:
    """A path from rest to rest that is to pass a point, with little acceleration."""

    name: str = 'via point, 1 dimension'
    dimensions: int = 1
    via: float = 3.0
    radius: float = 0.1
    acceleration_cost: float = 5e-5
    duration: float = 0.5
    dt: float = 0.01

    def skill(self) -> Skill:
        """From [1.8, 2] to [4, 3] with minimal jerk."""
        s, n = np.linspace(0.0, 1.0, 101), self.dimensions
        first, last = np.linspace(1.8, 2.0, n), np.linspace(4.0, 3.0, n)
        points = first + minimum_jerk(s)[:, None] * (last - first)
        return Skill.learn(Demonstration(self.duration * s, points, _named(Euclidean(n))), 10)

    def variables(self) -> list[Variable]:
        """The weights of all basis functions."""
        return [Weights(10, {'position': 0.3})]

    def rollout(self, skill: Skill, seed: int) -> Outcome:
        """See `Task`; the situation is always the same."""
        moving, points, accelerations = Rollout(skill), [], []
        times = np.arange(round(1.5 * self.duration / self.dt) + 1) * self.dt
        for k in range(len(times)):
            state = moving.advance(self.dt if k else 0.0)
            points.append(state.point)
            accelerations.append(state.acceleration)
        away = np.linalg.norm(np.array(points) - self.via, axis=1)
        # With one dimension at 0.3 s; otherwise at any time.
        nearest = away[int(np.argmax(times >= 0.3))] if self.dimensions == 1 else away.min()
        return Outcome({
            'via point': max(float(nearest) - self.radius, 0.0),
            'acceleration': self.acceleration_cost * float(np.square(accelerations).mean())})


@dataclass
class ForceField:
    """A mass that a spring pulls along a path through a via point, in a field around it."""

    name: str = 'random force field'
    random: bool = True
    strength: float = 20.0
    via_time: float = 0.5
    via: float = 0.5
    via_cost: float = 3.0
    gains: tuple[float, float] = (10.0, 1000.0)
    steps: int = 25

    def skill(self) -> Skill:
        """From 0 to 1 in 1 s with minimal jerk, with the smallest gain."""
        s = np.linspace(0.0, 1.0, 51)
        points = np.column_stack([minimum_jerk(s), np.full(len(s), self.gains[0])])
        return Skill.learn(Demonstration(s, points, Product(
            Euclidean(1), SymmetricPositiveDefinite(1), names=('position', 'stiffness'))), 12)

    def variables(self) -> list[Variable]:
        """Weights of the path, and of the gain."""
        return [Weights(7, {'position': 0.05}), Weights(6, {'stiffness': 1.0})]

    def rollout(self, skill: Skill, seed: int) -> Outcome:
        """See `Task`."""
        strength = (np.random.default_rng(seed).uniform(-self.strength, self.strength)
                    if self.random else -self.strength)
        times, y, gains = self.perform(skill, strength)
        at = int(np.argmax(times >= self.via_time))
        low, high = self.gains
        return Outcome({'via point': self.via_cost * abs(float(y[at]) - self.via),
                        'gains': float(gains.sum() - low) / (self.steps * high)})

    def perform(self, skill: Skill, strength: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Times, positions and gains."""
        times = np.linspace(0.0, 1.2 * skill.duration, self.steps)
        dt, width = times[1], math.sqrt(0.05 * self.via_time)
        moving = Rollout(skill)
        y, velocity, positions, gains = float(skill.start[0]), 0.0, [], []
        for k, time in enumerate(times):
            state = moving.advance(dt if k else 0.0)
            gain = float(np.clip(state.point[1], *self.gains))
            if k:
                field = strength * math.exp(-0.5 * ((time - self.via_time) / width) ** 2)
                velocity += dt * (state.acceleration[0] - gain * (y - state.point[0])
                                  - math.sqrt(gain) * (velocity - state.velocity[0]) + field)
                y += dt * velocity
            positions.append(y)
            gains.append(gain)
        return times, np.array(positions), np.array(gains)


#: Tasks, and updates and samples as published.
TASKS: dict[str, tuple[Any, Effort]] = {
    'via-1': (ViaPoint(), Effort(40, 10, 1)),
    'via-2': (ViaPoint('via point, 2 dimensions', 2), Effort(40, 10, 1)),
    'constant': (ForceField('constant force field', random=False), Effort(50, 10, 1)),
    'random': (ForceField(), Effort(25, 10, 2))}


def one_search(which: tuple[str, str, int]) -> dict[str, Any]:
    """
    Costs of the best guess before and after every update, and the gains at the end.

    :param which: name of the task, of the search, and the seed
    """
    name, search, seed = which
    task, effort = TASKS[name]
    variables = Variables(task.skill(), task.variables())

    def execute(title: str, jobs: dict[str, Job]) -> dict[str, Any]:
        return {key: roll_out(job) for key, job in jobs.items()}
    costs = [_cost(task, variables.skill, JUDGED)]
    for state in improve(task, variables, execute, effort, search, seed):
        costs.append(_cost(task, state.skill(), GLANCED))
    costs[-1] = _cost(task, state.skill(), JUDGED)
    found: dict[str, Any] = {'costs': costs}
    if isinstance(task, ForceField):
        times, _, gains = task.perform(state.skill(), 0.0)
        found.update(times=times.tolist(), gains=gains.tolist())
    return found


def _cost(task: Task, skill: Skill, count: int) -> float:
    if not getattr(task, 'random', False):
        count = 1
    return float(np.mean([task.rollout(skill, 1_000_000 + k).cost or 0.0 for k in range(count)]))


def _named(manifold: Euclidean) -> Product:
    return Product(manifold, names=('position',))


def run(settings: timing.TimingSettings) -> dict[str, Any]:
    """Figures; the keys are those of the file."""
    keys = {f'{name}/{search}/{seed}': (name, search, seed)
            for name in TASKS for search in SEARCHES for seed in range(SEEDS)}
    found = map_tasks('improving', one_search, keys, settings.jobs, settings.dask,
                      Journal(settings.resume, 'improve'))
    document: dict[str, Any] = {}
    for name, (task, effort) in TASKS.items():
        document[name] = {'task': task.name, 'rollouts': effort.rollouts}
        for search in SEARCHES:
            runs = [found[f'{name}/{search}/{seed}'] for seed in range(SEEDS)]
            costs = np.array([one['costs'] for one in runs])
            entry = document[name][search] = {
                'costs': costs.tolist(), 'before': float(costs[0, 0]),
                'quartiles': np.percentile(costs[:, -1], (25, 50, 75)).tolist()}
            if 'gains' in runs[0]:
                entry.update(_gains(task, runs))
    return document


def _gains(task: ForceField, runs: list[dict[str, Any]]) -> dict[str, Any]:
    """Quartiles of the schedules of the gain; the largest median near the via point, and not."""
    times = np.array(runs[0]['times'])
    quartiles = np.percentile([one['gains'] for one in runs], (25, 50, 75), axis=0)
    near = np.abs(times - task.via_time) <= NEAR_S
    return {'times': times.tolist(), 'gains': quartiles.tolist(),
            'near': float(quartiles[1, near].max()), 'far': float(quartiles[1, ~near].max())}


def rows(document: dict[str, Any]) -> list[list[str]]:
    """Table: heading, then lines."""
    lines = []
    for one in document.values():
        for search in SEARCHES:
            entry = one[search]
            gains = [f'{entry[key]:.0f}' if key in entry else '' for key in ('near', 'far')]
            low, middle, high = entry['quartiles']
            lines.append([one['task'], search, str(one['rollouts']), f'{entry["before"]:.3f}',
                          f'{middle:.3f} ({low:.3f}, {high:.3f})', *gains])
    return [['task', 'search', 'roll-outs', 'cost before', 'cost after',
             'largest gain near the via point', 'elsewhere'], *lines]


def draw(document: dict[str, Any], axes: Any) -> None:
    """Draw the median costs."""
    for one in document.values():
        for search, style in zip(SEARCHES, ('-', '--')):
            costs = np.array(one[search]['costs'])
            axes.plot(np.median(costs, axis=0) / costs[0, 0], style,
                      label=f'{one["task"]}, {search}')
    axes.set(xlabel='updates', ylabel='cost / cost before', yscale='log')
    axes.legend(fontsize='small')
