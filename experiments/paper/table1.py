"""Table 1: which method handles which space; one trial per cell where the method is defined."""
from __future__ import annotations

from typing import Any

import numpy as np

from experiments import timing
from experiments.baselines.baseline import Baseline
from experiments.baselines.classical import Classical
from experiments.baselines.log_error import LogError
from experiments.baselines.ours import Ours, Published
from experiments.baselines.quaternion import AbuDakkaQuaternion, UdeQuaternion
from experiments.baselines.rotation import UdeRotation
from experiments.baselines.transported import TransportedToStart
from experiments.paper.experiment import Data, Settings, Verdict
from gdmp_ros.dmp import Demonstration
from gdmp_ros.dmp.evaluation import mean_distance
from gdmp_ros.manifolds import (
    Euclidean,
    Manifold,
    Product,
    SpecialOrthogonal,
    Sphere,
    SymmetricPositiveDefinite,
    UnitQuaternion,
)
from gdmp_ros.util.terminal import table
from gdmp_ros.view import plots

CLAIM = 'G-DMP handles every space of Table 1; each of the others handles those marked for it.'
SOURCE = '[GDMP] Table 1'
COLUMNS: dict[str, Manifold] = {
    'R^m': Euclidean(4), 'S³': UnitQuaternion(), 'S^m': Sphere(3), 'SO(3)': SpecialOrthogonal(3),
    'SO(m)': SpecialOrthogonal(4), 'SPD(m)': SymmetricPositiveDefinite(3),
    'S³ × R³': Product(UnitQuaternion(), Euclidean(3))}
#: Rows of the table, the primitives that stand for each, and the spaces the paper marks.
ROWS: dict[str, tuple[tuple[type[Baseline], ...], tuple[str, ...]]] = {
    '[4, 7] Ijspeert': ((Classical,), ('R^m',)),
    '[8] Ude': ((UdeQuaternion, UdeRotation), ('S³', 'SO(3)')),
    '[9] Koutras': ((LogError,), ('S³',)),
    '[17] Abu-Dakka': ((AbuDakkaQuaternion,), ('S³',)),
    '[18] Abu-Dakka': ((TransportedToStart,), ('SPD(m)',)),
    'G-DMP parallel': ((Ours,), tuple(COLUMNS)),
    'G-DMP published': ((Published,), tuple(COLUMNS))}
#: A space is handled if the output is this near to it, and the error / span is this small.
ON_IT, EXACT = 1e-9, 1e-3


def demonstration(column: str) -> Demonstration:
    """A smooth motion on a space."""
    return timing.demonstration(COLUMNS[column], 2.0, seed=3, samples=500)


def cell(row: str, column: str) -> tuple[bool, float, float]:
    """
    Try a method on a space.

    :returns: whether it handles it, its mean error / span and its distance off the space (both
        NaN if it is not defined on the space)
    """
    shown = demonstration(column)
    for kind in ROWS[row][0]:
        if kind.handles(shown):
            points, raw = kind(shown).rollout(len(shown.times) - 1)
            away = shown.manifold.factor_distances(points, shown.flat_points)
            error = mean_distance(away) / shown.span()
            off = max(off_the_space(shown.manifold, point) for point in raw)
            return bool(error < EXACT and off < ON_IT), error, off
    return False, float('nan'), float('nan')


def off_the_space(manifold: Manifold, point: np.ndarray) -> float:
    """Distance of the numbers of a flat point from the nearest point of the space."""
    shaped = point.reshape(manifold.point_shape)
    return float(np.linalg.norm(shaped - manifold.project(shaped)))


def run(settings: Settings) -> Data:
    """Every cell."""
    results = np.array([[cell(row, column) for column in COLUMNS] for row in ROWS])
    return {'handles': results[:, :, 0] > 0.5, 'error': results[:, :, 1], 'off': results[:, :, 2],
            'marked': np.array([[column in ROWS[row][1] for column in COLUMNS] for row in ROWS])}


def verdict(data: Data) -> Verdict:
    """Whether our table is the paper's; [4] on SPD is the one cell where it may differ."""
    agree = data['handles'] == data['marked']
    lines = [[row, *('yes' if yes else '-' for yes in data['handles'][i])]
             for i, row in enumerate(ROWS)]
    table('which method handles which space', ['', *COLUMNS], lines)
    ours = [i for i, row in enumerate(ROWS) if row.startswith('G-DMP')]
    differing = [f'{row} on {column}' for i, row in enumerate(ROWS)
                 for j, column in enumerate(COLUMNS) if not agree[i, j]]
    tried = ~np.isnan(data['error'])
    measured: dict[str, Any] = {'cells': agree.size, 'tried': int(tried.sum()),
                                'by_definition': int((~tried).sum()),
                                'as_in_the_paper': int(agree.sum()),
                                'as_in_the_paper_of_those_tried': int(agree[tried].sum()),
                                'ours_handled': int(data['handles'][ours].sum()),
                                'ours_cells': data['handles'][ours].size,
                                'differing': differing or 'none',
                                'largest_error_of_ours': float(data['error'][ours].max()),
                                **{line[0]: ' '.join(line[1:]) for line in lines}}
    holds = bool(data['handles'][ours].all() and (data['handles'] | ~data['marked']).all()
                 and set(differing) <= {'[4, 7] Ijspeert on SPD(m)'})
    return Verdict(holds, measured, (
        f'{int(tried.sum())} of {agree.size} cells are tried. The other {int((~tried).sum())} are '
        '“-” by definition: the equations of the method do not exist on this space. [4] exists '
        'on every space and is tried on every space. It stays inside the cone of this SPD '
        'trajectory, but nothing guarantees it: only symmetry is linear. [19] merges several '
        'primitives of [17].'))


def draw(data: Data) -> dict[str, Any]:
    """The table as a picture: ticks, with the error that was measured."""
    figure, axes = plots.panels(1, 1, (9.0, 3.6))
    panel = axes[0, 0]
    for i in range(len(ROWS)):
        for j in range(len(COLUMNS)):
            handled, error = data['handles'][i, j], data['error'][i, j]
            word = f'yes\n{error:.0e}' if handled else (
                '-' if np.isnan(error) else f'leaves it\nby {data["off"][i, j]:.0e}')
            panel.text(j, i, word, ha='center', va='center', fontsize=8,
                       weight='bold' if handled else 'normal')
    panel.plot([], [], 's', color='0.85', label='handled: mean error / span [1]')
    panel.imshow(np.where(data['handles'], 0.85, 1.0), cmap='gray', vmin=0.0, vmax=1.0,
                 aspect='auto')
    panel.set_xticks(range(len(COLUMNS)), COLUMNS)
    panel.set_yticks(range(len(ROWS)), ROWS)
    panel.set(xlabel='space', ylabel='method')
    panel.grid(False)
    panel.legend(loc='upper center', bbox_to_anchor=(0.5, -0.16))
    return {'table1': figure}
