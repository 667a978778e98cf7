"""The Riemannian LASA data set: every class, every demonstration, on every manifold."""
from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from experiments.paper.experiment import Data, Settings, Verdict
from gdmp_ros.choices import CONNECTIONS, LASA_CLASSES, LASA_COVARIANCES, LASA_MANIFOLDS
from gdmp_ros.data import lasa
from gdmp_ros.dmp import Demonstration, Skill
from gdmp_ros.dmp.development import Development
from gdmp_ros.dmp.evaluation import reproduction_error
from gdmp_ros.util.parallel import map_tasks
from gdmp_ros.util.terminal import table
from gdmp_ros.view import plots

CLAIM = ('Every demonstration of the 30 LASA classes is reproduced on R², S², S³, SO(3) and '
         'SPD(2) by one formulation.')
SOURCE = '[GDMP] Fig. 3, section 5.1'
SETS = (*LASA_MANIFOLDS, LASA_COVARIANCES)
#: Class in the picture, as in the paper.
PICTURED = 'GShape'
#: Largest mean error / span: of all strokes, of the first of each class, of covariances.
LIMIT, FIRST_LIMIT, COVARIANCE_LIMIT = 2e-4, 8e-5, 5e-4
#: Largest error of one demonstration, relative to the limit of the mean.
WORST = 10.0


def errors(task: tuple[str, str]) -> list[list[float]]:
    """Mean error / span of each demonstration of a class, with each connection."""
    return errors_of(lasa.data_set(*task))


def errors_of(shown: list[Demonstration]) -> list[list[float]]:
    """Mean error / span of demonstrations, each learned separately, with each connection."""
    return [[float(reproduction_error(
        Skill.learn(d, connection=connection, fit='forcing', end='moving'), d)[0])
             for d in shown] for connection in CONNECTIONS]


def run(settings: Settings) -> Data:
    """Errors of all; curves of one demonstration on each manifold."""
    done = map_tasks('Riemannian LASA', errors, {f'{name} {mapping}': (name, mapping)
                                                 for mapping in SETS for name in LASA_CLASSES},
                     settings.jobs)
    counts = {m: sum(len(lasa.strokes(name)) for name in LASA_CLASSES) if m in LASA_MANIFOLDS
              else len(LASA_CLASSES) for m in SETS}
    data: Data = {'expected': np.array([counts[m] for m in SETS])}
    data |= {f'errors_{mapping}_{connection}': np.array(
        [[*done[f'{name} {mapping}'][i]] for name in LASA_CLASSES])
             for mapping in SETS for i, connection in enumerate(CONNECTIONS)}
    for mapping in SETS:
        shown = lasa.data_set(PICTURED, mapping)[0]
        data.update({f'{mapping}_{key}': value for key, value in curves(shown).items()})
    return data


def curves(shown: Demonstration) -> Data:
    """A demonstration and its reproduction over time, their velocities and distance."""
    manifold, times = shown.manifold, shown.times - shown.times[0]
    skill = Skill.learn(shown, fit='forcing', end='moving')
    made = skill.rollout().sample(times)
    frame = manifold.frame(shown.points[0])
    flat = made.points.reshape(len(times), -1)
    velocities = [np.gradient(Development(manifold, points, frame).unrolled, times, axis=0)
                  for points in (shown.flat_points, flat)]
    return {'times': times, 'shown': np.array(shown.flat_points), 'made': flat,
            'shown_velocity': velocities[0], 'velocity': velocities[1],
            'distance': manifold.factor_distances(flat, shown.flat_points)[:, 0]}


def verdict(data: Data) -> Verdict:
    """Mean over all demonstrations of each manifold and connection; the table by class."""
    print_errors(data, SETS, LASA_CLASSES)
    measured: dict[str, Any] = {'classes': len(LASA_CLASSES),
                                'demonstrations': int(data['expected'][0])}
    holds = True
    for mapping, expected in zip(SETS, data['expected']):
        limit = COVARIANCE_LIMIT if mapping == LASA_COVARIANCES else LIMIT
        for connection in CONNECTIONS:
            values = data[f'errors_{mapping}_{connection}']
            mean, worst = float(values.mean()), float(values.max())
            measured[f'{mapping}_{connection}_mean'] = mean
            measured[f'{mapping}_{connection}_largest'] = worst
            holds = (holds and values.size == expected and mean <= limit
                     and worst <= WORST * limit)
    first = {f'{m}_{c}_first_of_each_class': float(data[f'errors_{m}_{c}'][:, 0].mean())
             for m in LASA_MANIFOLDS for c in CONNECTIONS}
    return Verdict(bool(holds and max(first.values()) <= FIRST_LIMIT), {**measured, **first})


def print_errors(data: Data, sets: Sequence[str], classes: Sequence[str]) -> None:
    """Print the mean error of each class on each manifold."""
    def cell(mapping: str, i: int) -> str:
        means = (1e5 * np.nanmean(data[f'errors_{mapping}_{c}'][i]) for c in CONNECTIONS)
        return '{:.1f} ({:.1f})'.format(*means)
    table('mean error / span, 1e-5: parallel (published)', ['class', *sets],
          [[name, *(cell(m, i) for m in sets)] for i, name in enumerate(classes)])


def draw(data: Data) -> dict[str, Any]:
    """Per manifold: profile, derivative, error and Cartesian view; errors of all classes."""
    sets = [m for m in SETS if f'{m}_times' in data]
    return {'fig3': profiles(data, sets),
            'fig3-errors': spread(data, SETS)}


def spread(data: Data, sets: Sequence[str]) -> Any:
    """Box plots of the errors of all demonstrations."""
    figure, axes = plots.panels(1, 2, (5.4, 3.6))
    for panel, connection in zip(axes[0], CONNECTIONS):
        groups = {m: data[f'errors_{m}_{connection}'].reshape(-1) for m in sets}
        plots.boxes(panel, {m: v[np.isfinite(v)] for m, v in groups.items()},
                    'mean error / span [1]')
        panel.set(yscale='log', xlabel='manifold', title=connection)
        panel.tick_params(axis='x', labelsize=7)
    return figure


def profiles(data: Data, sets: list[str]) -> Any:
    """Grid as in the paper: one row per manifold."""
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
        panel.plot(times, data[f'{mapping}_distance'], color=plots.INK[0])
        panel.set(xlabel='time [s]', ylabel='distance [1]')
        _view(figure, grid[row, 3], mapping, data)
    return figure


def _pairs(panel: Any, times: np.ndarray, shown: np.ndarray, made: np.ndarray,
           label: str) -> None:
    panel.plot(times, shown, color='0.7', lw=2.6)
    panel.plot([], [], color='0.7', lw=2.6, label='demonstration')
    plots.series(panel, times, made, [f'G-DMP {i + 1}' for i in range(made.shape[1])], label)
    _explain(panel, ncols=4)


def _view(figure: Any, cell: Any, mapping: str, data: Data) -> None:
    """Cartesian view: in the plane, on the sphere, or as ellipses along the path."""
    shown, made = data[f'{mapping}_shown'], data[f'{mapping}_made']
    if mapping in ('R2', 'SPD2', LASA_COVARIANCES):
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
    _explain(panel, ncols=2)


def _explain(panel: Any, ncols: int) -> None:
    """A legend above the curves."""
    panel.legend(fontsize=6, ncols=ncols, loc='lower left', bbox_to_anchor=(0.0, 1.0),
                 borderaxespad=0.2)


def _direction(points: np.ndarray, mapping: str) -> np.ndarray:
    """Points of S² unchanged; of rotations the image of the z axis."""
    if mapping == 'S2':
        return points
    if mapping == 'SO3':
        return points.reshape(-1, 3, 3)[:, :, 2]
    w, x, y, z = points.T
    return np.column_stack([2.0 * (x * z + w * y), 2.0 * (y * z - w * x),
                            1.0 - 2.0 * (x * x + y * y)])
