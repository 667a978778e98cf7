"""Measure accuracy.

accuracy: the first demonstration of a LASA class on R², S², S³, SO(3) and SPD(2), both
connections, sampled at 1, 2, 5 and 10 ms: mean geodesic error / span (largest distance from the
start).

example:
  gdmp bench accuracy --class GShape --json accuracy.json
"""
from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import NamedTuple

from gdmp_ros.cli.terminal import progress, table
from gdmp_ros.dmp import Demonstration, Skill
from gdmp_ros.dmp.evaluation import reproduction_error
from gdmp_ros.dmp.skill import CONNECTIONS
from gdmp_ros.files import lasa

HELP = 'measure accuracy'
STEPS_MS = (1, 2, 5, 10)


class Row(NamedTuple):
    """Accuracy of one manifold, connection and sampling over the classes."""

    manifold: str
    connection: str
    dt_ms: int
    classes: int
    mean_relative_error: float
    max_relative_error: float


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('what', choices=['accuracy'])
    parser.add_argument('--class', dest='classes', action='append', choices=lasa.CLASSES,
                        metavar='CLASS', help='LASA class, may be repeated (default: all 30)')
    parser.add_argument('--n-basis', type=int, default=60, metavar='N')
    parser.add_argument('--json', type=Path, metavar='FILE', help='write the rows')


def run(options: argparse.Namespace) -> None:
    """Measure, print a table, write the file."""
    classes = options.classes or list(lasa.CLASSES)
    rows = accuracy(classes, options.n_basis)
    table(f'mean error / span, N = {options.n_basis}, {len(classes)} class(es)',
          ['manifold', 'connection', *(f'{ms} ms' for ms in STEPS_MS)],
          [[m, c, *(f'{r.mean_relative_error:.2e}' for r in rows
                    if (r.manifold, r.connection) == (m, c))]
           for m in lasa.MAPPINGS for c in CONNECTIONS])
    if options.json:
        document = {'n_basis': options.n_basis, 'rows': [row._asdict() for row in rows]}
        options.json.write_text(json.dumps(document, indent=1) + '\n')


def accuracy(classes: list[str], n_basis: int = 60) -> list[Row]:
    """Rows for every manifold, connection and sampling."""
    shown = {mapping: [lasa.riemannian(lasa.strokes(name)[0], mapping) for name in classes]
             for mapping in lasa.MAPPINGS}
    rows = []
    with progress('accuracy', len(lasa.MAPPINGS) * len(CONNECTIONS)) as step:
        for mapping in lasa.MAPPINGS:
            for connection in CONNECTIONS:
                rows += _rows(mapping, connection, shown[mapping], n_basis)
                step()
    return rows


def _rows(mapping: str, connection: str, shown: list[Demonstration], n_basis: int) -> list[Row]:
    skills = [Skill.learn(d, n_basis, connection=connection) for d in shown]
    rows = []
    for ms in STEPS_MS:
        errors = [float(reproduction_error(skill, d, ms * 1e-3)[0])
                  for skill, d in zip(skills, shown)]
        rows.append(Row(mapping, connection, ms, len(shown), sum(errors) / len(errors),
                        max(errors)))
    return rows
