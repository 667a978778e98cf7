"""
Task frames beside published methods: takes between two frames, done where other takes were.

The data set and its measures are those of Franzese, Prakash, Kober, "Generalization of task
parameterized dynamical systems using Gaussian process transportation" (2024): planar motions from
a start frame into a goal frame. From one take: every take is done in the frames of every other
one. From several: takes are drawn, and done in the frames of one that was not. Beside ours stand
the mean of skills learned from single takes, on the same draws, and a skill without frames that
goes to the goal of the other take; figures of other methods are those published there.
"""
from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from experiments import timing
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.frames import placed, seen_from
from gdmp_ros.dmp.rollout import Rollout
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import DataError
from gdmp_ros.manifolds.euclidean import Euclidean
from gdmp_ros.util.terminal import progress

TITLE = 'task frames: takes between a start frame and a goal frame, done in the frames of others'
FILE = 'reach_target.npz'
MEASURES = 'frechet', 'warping', 'final_position', 'final_angle'
#: No times are published.
DURATION = 5.0
#: Takes that are learned from, draws of them, and the seed of the draws.
COUNTS, DRAWS, SEED = (2, 3, 5, 7), 10, 0
PLANE = Euclidean(2)
#: Published, by number of takes: means of the four measures.
PUBLISHED: dict[str, dict[str, tuple[float, ...]]] = {
    'DMP': {'1': (24.6, 1112.0, 3.7, 1.18)},
    'Laplacian editing': {'1': (14.6, 542.0, 3.35, 0.33)},
    'GP transportation': {'1': (11.5, 442.0, 3.60, 0.13)},
    'TP-GMM': {'5': (15.5, 418.0, 13.2, 0.25), '7': (12.1, 312.0, 10.2, 0.20)},
    'HMM': {'5': (16.3, 569.0, 12.8, 0.34), '7': (14.9, 466.0, 10.3, 0.28)}}


def read(folder: Path) -> list[Demonstration]:
    """
    The published takes with their frames.

    :raises DataError: if the file is missing or is another one
    """
    path = folder / FILE
    try:
        with np.load(path, allow_pickle=False) as data:
            count = sum(name.endswith('_points') for name in data.files)
            return [_take(*(data[f'take{k}_{name}'] for name in (
                'points', 'rotations', 'origins'))) for k in range(count)]
    except (OSError, KeyError, ValueError) as error:
        raise DataError(f'{path}: not the takes with their frames: {error}') from None


def _take(points: np.ndarray, rotations: np.ndarray, origins: np.ndarray) -> Demonstration:
    return Demonstration(np.linspace(0.0, DURATION, len(points)), points, PLANE, frames={
        'start': (rotations[0], origins[0]), 'goal': (rotations[1], origins[1])})


def measures(path: np.ndarray, take: Demonstration) -> np.ndarray:
    """
    The four published measures, see `MEASURES`.

    :param path: shape ``(samples, 2)``
    :param take: what was shown in the same situation
    """
    distances = np.linalg.norm(path[:, None] - take.points[None], axis=2)
    # As seen from the goal frame, which changes neither: both are differences.
    ways = path[-1] - path[-5], take.points[-1] - take.points[-2]
    angle = np.arctan2(*ways[0][::-1]) - np.arctan2(*ways[1][::-1])
    return np.array([_frechet(distances), _warping(distances),
                     distances[-1, -1],
                     abs((angle + np.pi) % (2.0 * np.pi) - np.pi)])


def _frechet(distances: np.ndarray) -> float:
    """Discrete Fréchet distance."""
    reached = np.empty_like(distances)
    reached[0] = np.maximum.accumulate(distances[0])
    reached[:, 0] = np.maximum.accumulate(distances[:, 0])
    for i in range(1, len(distances)):
        for j in range(1, distances.shape[1]):
            reached[i, j] = max(distances[i, j], min(
                reached[i - 1, j], reached[i - 1, j - 1], reached[i, j - 1]))
    return float(reached[-1, -1])


def _warping(distances: np.ndarray) -> float:
    """Sum of distances along the cheapest alignment."""
    total = np.full((distances.shape[0] + 1, distances.shape[1] + 1), np.inf)
    total[0, 0] = 0.0
    for i, row in enumerate(distances):
        for j, distance in enumerate(row):
            total[i + 1, j + 1] = distance + min(total[i, j + 1], total[i + 1, j], total[i, j])
    return float(total[-1, -1])


def path_of(skill: Skill, take: Demonstration) -> np.ndarray:
    """The skill where the frames of a take were, from its start, as many samples as it has."""
    rollout = Rollout(skill, take.points[0], frames=take.frames)
    return rollout.sample(np.linspace(0.0, skill.duration, len(take.times))).points


def _plain_path(shown: Demonstration, skill: Skill, take: Demonstration) -> np.ndarray:
    """A skill without frames, from the start of a take to where its goal frame has the goal."""
    goal = placed(PLANE, take.frames['goal'], seen_from(
        PLANE, shown.frames['goal'], shown.points[-1:]))[0]
    rollout = Rollout(skill, take.points[0], goal)
    return rollout.sample(np.linspace(0.0, skill.duration, len(take.times))).points


def compare(takes: list[Demonstration], step: Callable[[], None]) -> dict[str, Any]:
    """
    Figures of one take and of several.

    :param step: is called after each part
    """
    singles = [Skill.learn(take) for take in takes]
    plain = [Skill.learn(Demonstration(take.times, take.points, PLANE)) for take in takes]
    step()
    pairs = [(k, j) for k in range(len(takes)) for j in range(len(takes)) if j != k]
    one = {'frames': _mean(measures(path_of(singles[k], takes[j]), takes[j]) for k, j in pairs),
           'goal_switch': _mean(measures(_plain_path(takes[k], plain[k], takes[j]), takes[j])
                                for k, j in pairs)}
    step()
    several: dict[str, Any] = {}
    rng = np.random.default_rng(SEED)
    for count in (n for n in COUNTS if n < len(takes)):
        ours, blends = [], []
        for _ in range(DRAWS):
            order = rng.permutation(len(takes))
            out, learned = takes[order[-1]], sorted(order[:count])
            ours.append(measures(path_of(Skill.learn([takes[k] for k in learned]), out), out))
            blends.append(measures(np.mean([path_of(singles[k], out) for k in learned], axis=0),
                                   out))
        several[str(count)] = {'frames': _mean(ours), 'single_takes': _mean(blends)}
        step()
    return {'pairs': len(pairs), 'one_take': one, 'several': several}


def _mean(found: Any) -> dict[str, float]:
    return dict(zip(MEASURES, np.mean(list(found), axis=0).tolist()))


def run(settings: timing.TimingSettings) -> dict[str, Any]:
    """Figures; no planar ones without the data set."""
    published = {name: {count: dict(zip(MEASURES, row)) for count, row in rows.items()}
                 for name, rows in PUBLISHED.items()}
    document: dict[str, Any] = {'draws': DRAWS, 'seed': SEED, 'published': published}
    if settings.frames is not None:
        takes = read(settings.frames)
        with progress('takes between frames', 2 + len(COUNTS)) as step:
            document.update(compare(takes, step))
    document['tasks'] = _tasks(settings)
    return document


def _tasks(settings: timing.TimingSettings) -> dict[str, Any]:
    """Successes of the tasks on the simulated arm; none if no situations are asked for."""
    if not settings.situations:
        return {}
    from experiments.frame_tasks import measure, SKILLS, TASKS
    with progress('tasks with objects', len(TASKS) * len(SKILLS) * settings.situations) as step:
        return {name: measure(name, settings.situations, SEED, step) for name in TASKS}


def rows(document: dict[str, Any]) -> list[list[str]]:
    """Table: heading, then lines."""
    lines = [[f'{name}, published', count, *_cells(one)]
             for name, by_count in document['published'].items()
             for count, one in by_count.items()]
    if 'one_take' not in document:
        lines.append(['not measured: name the data with --frames', *([''] * 5)])
    else:
        names = {'frames': 'task frames', 'goal_switch': 'goal switch, without frames',
                 'single_takes': 'mean of single takes'}
        lines += [[names[name], '1', *_cells(one)] for name, one in document['one_take'].items()]
        lines += [[names[name], count, *_cells(one)]
                  for count, found in document['several'].items() for name, one in found.items()]
    tasks = [[f'{name} on the simulated arm, {found["situations"]} situations', kind.replace(
        '_', ' '), f'{100.0 * found[kind]:.0f} %', '', '', '']
             for name, found in document['tasks'].items()
             for kind in found if kind != 'situations']
    return [['method', 'takes', 'Fréchet', 'warping', 'final position', 'final angle [rad]'],
            *sorted(lines, key=lambda line: line[1]), *tasks]


def _cells(one: Mapping[str, float]) -> list[str]:
    return [f'{one["frechet"]:.1f}', f'{one["warping"]:.0f}', f'{one["final_position"]:.2f}',
            f'{one["final_angle"]:.2f}']
