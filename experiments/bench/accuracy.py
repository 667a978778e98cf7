"""
Reproduction error of handwriting on every manifold, with both connections and several time steps.

The first demonstration of each LASA class; mean geodesic error / span (largest distance from the
start). Separate rows: covariance profiles of each class by Gaussian mixture regression, on SPD(2).
"""
from __future__ import annotations

from typing import Any

import numpy as np

from experiments import timing
from gdmp_ros.choices import CONNECTIONS
from gdmp_ros.data import lasa
from gdmp_ros.dmp.evaluation import reproduction_error
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.util.parallel import Journal, map_tasks

TITLE = 'mean error / span over LASA classes'
STEPS_MS = (1, 2, 5, 10)
#: Name of the separate rows.
COVARIANCES = 'SPD2 covariances'


def one_class(task: tuple[str, str, str, int]) -> list[float]:
    """Errors of one class on one manifold with one connection, for each of `STEPS_MS`."""
    name, mapping, connection, n_basis = task
    if mapping == COVARIANCES:
        shown = lasa.covariance_profile(name)
    else:
        shown = lasa.riemannian(lasa.strokes(name)[0], mapping)
    skill = Skill.learn(shown, n_basis, connection=connection, end='moving')
    return [float(reproduction_error(skill, shown, ms * 1e-3)[0]) for ms in STEPS_MS]


def run(settings: timing.TimingSettings) -> dict[str, Any]:
    """Figures; the keys are those of the file."""
    cells = [(mapping, connection) for mapping in (*lasa.MAPPINGS, COVARIANCES)
             for connection in CONNECTIONS]
    tasks = {f'{name} {mapping} {connection}': (name, mapping, connection, settings.n_basis)
             for mapping, connection in cells for name in settings.classes}
    journal = Journal(settings.resume, f'accuracy with {settings.n_basis} basis functions')
    done = map_tasks('accuracy', one_class, tasks, settings.jobs, settings.dask, journal)
    result = []
    for mapping, connection in cells:
        errors = np.array([done[f'{name} {mapping} {connection}'] for name in settings.classes])
        for ms, column in zip(STEPS_MS, errors.T):
            row = {'manifold': mapping, 'connection': connection, 'dt_ms': ms,
                   'classes': len(settings.classes),
                   'mean_relative_error': float(column.mean()),
                   'max_relative_error': float(column.max())}
            result.append({**row, 'separate': True} if mapping == COVARIANCES else row)
    return {'n_basis': settings.n_basis, 'rows': result}


def rows(document: dict[str, Any]) -> list[list[str]]:
    """Table: heading, then lines."""
    cells = dict.fromkeys((r['manifold'], r['connection']) for r in document['rows'])
    lines = [[*cell, *(f'{r["mean_relative_error"]:.2e}' for r in document['rows']
                       if (r['manifold'], r['connection']) == cell)] for cell in cells]
    return [['manifold', 'connection', *(f'{ms} ms' for ms in STEPS_MS)], *lines]


def draw(document: dict[str, Any], axes: Any) -> None:
    """Errors of the rows at 1 and at 10 ms."""
    main = [r for r in document['rows'] if not r.get('separate')]
    cells = list(dict.fromkeys((r['manifold'], r['connection']) for r in main))
    for ms, marker in ((1, 'o'), (10, 'x')):
        values = [r['mean_relative_error'] for r in main if r['dt_ms'] == ms]
        axes.plot(range(len(cells)), values, marker, color='black', ms=6, mfc='none',
                  label=f'sampled every {ms} ms')
    axes.set_xticks(range(len(cells)), [f'{m}\n{c}' for m, c in cells], fontsize=6)
    axes.set(ylabel='mean error / span', title=TITLE,
             ylim=(0.0, 1.1 * max(r['mean_relative_error'] for r in main)))
    axes.legend()
