"""
Several takes of real tasks: alignment, conditioned skills and tubes, each take left out once.

The error is the mean distance of the position of the held-out take from the skill that was learned
from the others, moved to its start and goal. The time of the take is warped onto each skill alike:
how fast somebody moved is no error of the path.
"""
from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import chi2

from experiments import timing
from gdmp_ros.data import public_sets
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.distribution import Distribution
from gdmp_ros.dmp.rollout import Rollout
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import DataError
from gdmp_ros.learning.alignment import aligned
from gdmp_ros.util.terminal import progress

TITLE = 'RoboTasks9, leave one take out'
N_BASIS = 40
#: Of the path that a take is warped onto.
SAMPLES = 400
#: Where tubes are tried, and their shares.
MOMENTS, SHARES = np.linspace(0.02, 0.98, 33), (0.68, 0.95)


class _Left(NamedTuple):
    """Figures of one take that was left out."""

    raw: float
    aligned: float
    conditioned: float
    inside: np.ndarray


def run(settings: timing.TimingSettings) -> dict[str, Any]:
    """Figures of each task; none without the data set."""
    if settings.robottasks is None:
        return {'tasks': []}
    found = public_sets.task_files(settings.robottasks)
    result = []
    with progress('takes', len(found)) as step:
        for path in found:
            result.append(_task(path))
            step()
    return {'tasks': result}


def _task(path: Path) -> dict[str, Any]:
    raw = public_sets.task_takes(path)
    even = aligned(raw)
    left = [_leave_out(raw, even, number) for number in range(len(raw))]
    before, after, conditioned = (float(np.mean([getattr(one, name) for one in left]))
                                  for name in ('raw', 'aligned', 'conditioned'))
    inside = np.mean([one.inside for one in left], axis=0)
    return {'task': path.stem, 'takes': len(raw), 'raw_mm': 1e3 * before,
            'aligned_mm': 1e3 * after, 'aligned_to_raw': after / before,
            'conditioned_to_moved': conditioned / after,
            'position_inside': inside[0].tolist(), 'rotation_inside': inside[1].tolist()}


def _leave_out(raw: list[Demonstration], even: list[Demonstration], number: int) -> _Left:
    out = even[number]
    plain = Skill.learn(raw[:number] + raw[number + 1:], N_BASIS, align=False)
    skill = Skill.learn(even[:number] + even[number + 1:], N_BASIS)
    distribution = skill.distribution
    if distribution is None:
        raise DataError(f'{len(raw)} takes, expected at least 3')
    made = distribution.condition([(0.0, out.points[0]), (1.0, out.points[-1])])
    remaining = made.distribution or distribution
    take = raw[number]
    return _Left(_error(plain, take), _error(skill, take), _error(made, take),
                 _inside(remaining, out))


def _error(skill: Skill, take: Demonstration) -> float:
    moved = Rollout(skill, start=take.points[0], goal=take.points[-1], duration=take.duration)
    times = np.linspace(0.0, take.duration, SAMPLES)
    path = Demonstration(times, moved.sample(times).points, take.manifold)
    # Both are warped half the way, onto the same progress.
    own, there = aligned([take, path], [path, path])
    reached = there.at(own.times - own.times[0])
    return float(np.linalg.norm(own.points[:, :3] - reached[:, :3], axis=1).mean())


def _inside(distribution: Distribution, take: Demonstration) -> np.ndarray:
    """Share of samples inside the tubes: rows position and rotation, columns `SHARES`."""
    manifold, found = take.manifold, []
    for s in MOMENTS:
        mean, covariance = distribution.mean(s), distribution.covariance(s)
        shown = manifold.align(take.at(np.array([take.times[0] + s * take.duration]))[0], mean)
        away = manifold.log_in_frame(manifold.frame(mean), shown)[0]
        found.append([[away[part] @ np.linalg.solve(covariance[part, part], away[part])
                       <= chi2.ppf(share, 3) for share in SHARES]
                      for part in manifold.tangent_slices])
    return np.asarray(np.mean(found, axis=0))


def rows(document: dict[str, Any]) -> list[list[str]]:
    """Table: heading, then lines."""
    lines = [[one['task'], f'{one["raw_mm"]:.1f}', f'{one["aligned_mm"]:.1f}',
              f'{one["aligned_to_raw"]:.2f}', f'{one["conditioned_to_moved"]:.2f}',
              *(', '.join(f'{100.0 * share:.0f} %' for share in one[key])
                for key in ('position_inside', 'rotation_inside'))]
             for one in document['tasks']]
    return [['task', 'raw [mm]', 'aligned [mm]', 'ratio', 'conditioned / moved',
             'position in 68 %, 95 %', 'rotation'],
            *(lines or [['not measured: name the data with --robottasks', *([''] * 6)]])]
