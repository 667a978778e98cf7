"""The Riemannian LASA data set: every class, every demonstration, on every manifold."""
from __future__ import annotations

from typing import Any

import numpy as np

from gdmp_ros.data import lasa
from gdmp_ros.dmp import Demonstration, Skill
from gdmp_ros.dmp.development import Development
from gdmp_ros.dmp.evaluation import reproduction_error
from gdmp_ros.dmp.primitive import CONNECTIONS
from gdmp_ros.experiments.paper.experiment import Data, Settings, Verdict
from gdmp_ros.experiments.paper.fig8 import distances
from gdmp_ros.util.parallel import map_tasks
from gdmp_ros.util.terminal import table
from gdmp_ros.view import plots

CLAIM = ('Every demonstration of the 30 LASA classes is reproduced on R², S², S³, SO(3) and '
         'SPD(2) by one formulation.')
SOURCE = '[GDMP] Fig. 3, section 5.1'
SETS = (*lasa.MAPPINGS, lasa.COVARIANCES)
#: What the picture shows, as the paper's does.
PICTURED = 'GShape'
#: Largest mean error / span that counts as reproduced: of all strokes, of the first of each class,
#: and of covariances.
LIMIT, FIRST_LIMIT, COVARIANCE_LIMIT = 2e-4, 8e-5, 5e-4
#: The worst single one may be so many times the limit of the mean.
WORST = 10.0


def errors(task: tuple[str, str]) -> list[list[float]]:
    """Mean error / span of each demonstration of a class, with each connection."""
    return errors_of(lasa.data_set(*task))


def errors_of(shown: list[Demonstration]) -> list[list[float]]:
    """Mean error / span of demonstrations, each learned by itself, with each connection."""
    return [[float(reproduction_error(Skill.learn(d, connection=connection), d)[0])
             for d in shown] for connection in CONNECTIONS]


def run(settings: Settings) -> Data:
    """Errors of all; curves of one demonstration on each manifold."""
    done = map_tasks('Riemannian LASA', errors, {f'{name} {mapping}': (name, mapping)
                                              for mapping in SETS for name in lasa.CLASSES},
                  settings.jobs)
    counts = {m: sum(len(lasa.strokes(name)) for name in lasa.CLASSES) if m in lasa.MAPPINGS
              else len(lasa.CLASSES) for m in SETS}
    data: Data = {'expected': np.array([counts[m] for m in SETS])}
    data |= {f'errors_{mapping}_{connection}': np.array(
        [[*done[f'{name} {mapping}'][i]] for name in lasa.CLASSES])
        for mapping in SETS for i, connection in enumerate(CONNECTIONS)}
    for mapping in SETS:
        shown = lasa.data_set(PICTURED, mapping)[0]
        data.update({f'{mapping}_{key}': value for key, value in curves(shown).items()})
    return data


def curves(shown: Demonstration) -> Data:
    """A demonstration and its reproduction over time, their velocities and distance."""
    manifold, times = shown.manifold, shown.times - shown.times[0]
    skill = Skill.learn(shown)
    made = skill.rollout().sample(times)
    frame = manifold.frame(shown.points[0])
    flat = made.points.reshape(len(times), -1)
    velocities = [np.gradient(Development(manifold, points, frame).unrolled, times, axis=0)
                  for points in (shown.flat_points, flat)]
    return {'times': times, 'shown': np.array(shown.flat_points), 'made': flat,
            'shown_velocity': velocities[0], 'velocity': velocities[1],
            'distance': distances(manifold, flat, shown.flat_points)[:, 0]}


def verdict(data: Data) -> Verdict:
    """Mean over all demonstrations of each manifold and connection; the table by class."""
    limits = dict.fromkeys(lasa.MAPPINGS, LIMIT) | {lasa.COVARIANCES: COVARIANCE_LIMIT}
    result = judged(data, limits, lasa.CLASSES)
    first = {f'{m}_{c}_first_of_each_class': float(data[f'errors_{m}_{c}'][:, 0].mean())
             for m in lasa.MAPPINGS for c in CONNECTIONS}
    return Verdict(bool(result.holds) and max(first.values()) <= FIRST_LIMIT,
                   {**result.measured, **first})


def judged(data: Data, limits: dict[str, float], classes: tuple[str, ...],
           connections: tuple[str, ...] = CONNECTIONS) -> Verdict:
    """
    Verdict on errors by manifold and class; prints the table.

    :param limits: largest mean error / span, by manifold
    :param connections: those that are held against it
    """
    sets = list(limits)

    def cell(mapping: str, i: int) -> str:
        means = (1e5 * np.nanmean(data[f'errors_{mapping}_{c}'][i]) for c in CONNECTIONS)
        return '{:.1f} ({:.1f})'.format(*means)
    table('mean error / span, 1e-5: parallel (published)', ['class', *sets],
          [[name, *(cell(m, i) for m in sets)] for i, name in enumerate(classes)])
    measured: dict[str, Any] = {'classes': len(classes),
                                'demonstrations': int(data['expected'][0])}
    holds = True
    for mapping, expected in zip(sets, data['expected']):
        for connection in CONNECTIONS:
            values = data[f'errors_{mapping}_{connection}']
            mean, worst = float(np.nanmean(values)), float(np.nanmax(values))
            measured[f'{mapping}_{connection}_mean'] = mean
            measured[f'{mapping}_{connection}_largest'] = worst
            holds = holds and np.isfinite(values).sum() == expected and (
                connection not in connections
                or (mean <= limits[mapping] and worst <= WORST * limits[mapping]))
    return Verdict(bool(holds), measured)


def draw(data: Data) -> dict[str, Any]:
    """Per manifold: profile, derivative, error and Cartesian view; errors of all classes."""
    sets = [m for m in SETS if f'{m}_times' in data]
    return {'fig3': profiles(data, sets),
            'fig3-errors': spread(data, SETS)}


def spread(data: Data, sets: tuple[str, ...]) -> Any:
    """Box plots of all demonstrations' errors."""
    figure, axes = plots.panels(1, 2, (5.4, 3.6))
    for panel, connection in zip(axes[0], CONNECTIONS):
        groups = {m: data[f'errors_{m}_{connection}'].reshape(-1) for m in sets}
        plots.boxes(panel, {m: v[np.isfinite(v)] for m, v in groups.items()},
                    'mean error / span [1]')
        panel.set(yscale='log', xlabel='manifold', title=connection)
        panel.tick_params(axis='x', labelsize=7)
    return figure


def profiles(data: Data, sets: list[str]) -> Any:
    """The paper's grid: rows are manifolds."""
    figure, grid = plots.blank_grid(len(sets), 4, (15.0, 2.7 * len(sets)))
    for row, mapping in enumerate(sets):
        times = data[f'{mapping}_times']
        shown, made = data[f'{mapping}_shown'], data[f'{mapping}_made']
        keep = list(range(shown.shape[1]))
        if mapping == 'SO3':
            keep = [0, 3, 6, 1, 4, 7]
        elif shown.shape[1] == 4 and mapping != 'S3':
            keep = [0, 1, 3]
        panel = figure.add_subplot(grid[row, 0])
        _pairs(panel, times, shown[:, keep], made[:, keep], f'{mapping} [1]')
        panel = figure.add_subplot(grid[row, 1])
        _pairs(panel, times, data[f'{mapping}_shown_velocity'], data[f'{mapping}_velocity'],
               'derivative in the frame [1/s]')
        panel = figure.add_subplot(grid[row, 2])
        panel.plot(times, data[f'{mapping}_distance'], color=plots.INK[0], label='distance')
        panel.set(xlabel='time [s]', ylabel='distance [1]')
        panel.legend()
        _view(figure, grid[row, 3], mapping, data)
    return figure


def _pairs(panel: Any, times: np.ndarray, shown: np.ndarray, made: np.ndarray,
           label: str) -> None:
    panel.plot(times, shown, color='0.7', lw=2.6)
    panel.plot([], [], color='0.7', lw=2.6, label='demonstration')
    plots.series(panel, times, made, [f'G-DMP {i + 1}' for i in range(made.shape[1])], label)
    panel.legend(fontsize=6, ncols=4)


def _view(figure: Any, cell: Any, mapping: str, data: Data) -> None:
    """Where the motion goes: in the plane, on a sphere of directions, as ellipses along it."""
    shown, made = data[f'{mapping}_shown'], data[f'{mapping}_made']
    if mapping in ('R2', 'SPD2', lasa.COVARIANCES):
        panel, plane = figure.add_subplot(cell), data['R2_made']
        panel.plot(*data['R2_shown'].T, '--', color='black', lw=1.0, label='demonstration')
        panel.plot(*plane.T, color=plots.INK[1], lw=1.0, label='reproduction')
        if mapping != 'R2':
            at = np.linspace(0, len(made) - 1, 14).round().astype(int)
            largest = np.linalg.eigvalsh(made.reshape(-1, 2, 2)).max()
            scale = 0.12 * np.ptp(plane, axis=0).max() / largest
            where = plane[np.round(at * (len(plane) - 1) / (len(made) - 1)).astype(int)]
            for points, style in ((shown, {'color': '0.6', 'lw': 2.2}),
                                  (made, {'color': plots.INK[1], 'lw': 1.0, 'ls': '--'})):
                plots.ellipses(panel, where, points[at].reshape(-1, 2, 2), scale, **style)
        panel.set(xlabel='x [1]', ylabel='y [1]')
        panel.set_aspect('equal', adjustable='datalim')
    else:
        panel = figure.add_subplot(cell, projection='3d')
        plots.sphere(panel)
        for points, style in ((shown, {'ls': '--', 'color': 'black', 'lw': 2.0,
                                       'label': 'demonstration'}),
                              (made, {'color': plots.INK[1], 'lw': 1.2,
                                      'label': 'reproduction'})):
            panel.plot(*_direction(points, mapping).T, **style)
    panel.legend(fontsize=7)


def _direction(points: np.ndarray, mapping: str) -> np.ndarray:
    """Points of S² as they are; of rotations where they take the z axis."""
    if mapping == 'S2':
        return points
    if mapping == 'SO3':
        return points.reshape(-1, 3, 3)[:, :, 2]
    w, x, y, z = points.T
    return np.column_stack([2.0 * (x * z + w * y), 2.0 * (y * z - w * x),
                            1.0 - 2.0 * (x * x + y * y)])
