"""Measure speed, accuracy and calm, beside the peers.

step         a step of a roll-out from Python, beside movement_primitives
learn        learning, beside movement_primitives
accuracy     reproduction of all LASA classes on five manifolds, for 1 to 10 ms
goal-switch  accelerations when the goal jumps, beside movement_primitives
tempo        the path when the tempo changes, beside movement_primitives
spd          both connections on SPD(2) to SPD(20), explicit transport, pymanopt's maps
stream       the nodes' punctuality beside a bare loop (needs ROS)
loop         the closed-loop simulation against real time, without ROS
all          everything, with pictures

examples:
  gdmp bench step --json step.json
  gdmp bench accuracy --jobs 2 --resume accuracy.jsonl --json accuracy.json
  gdmp bench all --out out/bench

The peers come with: pip install 'gdmp_ros[bench]'
"""
from __future__ import annotations

import argparse
import importlib
from pathlib import Path
from typing import Any

from gdmp_ros.errors import DataError
from gdmp_ros.util.atomic_write import write_json
from gdmp_ros.util.terminal import table

HELP = 'measure speed, accuracy and calm beside the peers'
SUBJECTS = ('step', 'learn', 'accuracy', 'goal-switch', 'tempo', 'spd', 'stream', 'loop')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('what', choices=[*SUBJECTS, 'all'], metavar='WHAT',
                        help=', '.join([*SUBJECTS, 'all']))
    parser.add_argument('--json', type=Path, metavar='FILE', help='write the figures')
    parser.add_argument('--out', type=Path, default=Path('out/bench'), metavar='DIR',
                        help='for all: where figures and pictures go (default %(default)s)')
    parser.add_argument('--repetitions', type=int, default=9, metavar='N',
                        help='of every timing, at least 7; the median counts (default '
                             '%(default)s)')
    parser.add_argument('--seconds', type=float, default=60.0, metavar='S',
                        help='how long stream streams (default %(default)s)')
    parser.add_argument('--class', dest='classes', action='append', metavar='CLASS',
                        help='LASA class for accuracy, may be repeated (default: all 30)')
    parser.add_argument('--n-basis', type=int, default=60, metavar='N',
                        help='basis functions for accuracy (default %(default)s)')
    add_parallel_arguments(parser)


def add_parallel_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare where many tasks are done."""
    parser.add_argument('--jobs', type=int, default=1, metavar='N',
                        help='processes; -1: one per core (default %(default)s)')
    parser.add_argument('--backend', nargs=2, default=(), metavar=('dask', 'ADDRESS'),
                        help='work on a Dask cluster instead')
    parser.add_argument('--resume', type=Path, metavar='FILE',
                        help='keep finished parts here and go on where they stopped')


def run(options: argparse.Namespace) -> None:
    """Measure, print a table, write the files."""
    from gdmp_ros.data import lasa
    from gdmp_ros.experiments.timing import environment, Settings
    from gdmp_ros.util.parallel import scheduler_address
    classes = tuple(options.classes or lasa.CLASSES)
    for name in classes:
        if name not in lasa.CLASSES:
            raise DataError(f'LASA class {name!r} is unknown, expected one of '
                            f'{", ".join(lasa.CLASSES)}')
    if options.repetitions < 7:
        raise DataError(f'--repetitions is {options.repetitions}, expected at least 7')
    if not 0.0 < options.seconds <= 86400.0:
        raise DataError(f'--seconds is {options.seconds:g}, expected more than 0 to 86400')
    settings = Settings(options.repetitions, options.seconds, options.jobs,
                        scheduler_address(options.backend), options.resume, classes, options.n_basis)
    if options.what != 'all':
        document = _measure(options.what, settings)
        if options.json:
            _write(options.json, {**document, 'environment': environment()})
        return
    options.out.mkdir(parents=True, exist_ok=True)
    documents = {}
    for what in SUBJECTS:
        documents[what] = _measure(what, settings)
        _write(options.out / f'{what}.json', {**documents[what], 'environment': environment()})
    if options.json:
        _write(options.json, {**documents, 'environment': environment()})
    _draw(documents, options.out)
    print(f'figures and pictures: {options.out}')


def _module(what: str) -> Any:
    return importlib.import_module(f'gdmp_ros.experiments.bench.{what.replace("-", "_")}')


def _measure(what: str, settings: Any) -> dict[str, Any]:
    module = _module(what)
    document: dict[str, Any] = module.run(settings)
    heads, *lines = module.rows(document)
    table(module.TITLE, heads, lines)
    return document


def _write(path: Path, document: dict[str, Any]) -> None:
    try:
        write_json(path, document)
    except OSError as error:
        raise DataError(f'{path}: cannot write the figures: {error.strerror}') from None


def _draw(documents: dict[str, dict[str, Any]], folder: Path) -> None:
    from gdmp_ros.view import plots
    for what, document in documents.items():
        draw = getattr(_module(what), 'draw', None)
        if draw is not None:
            figure = plots.blank_figure()
            draw(document, figure.subplots())
            plots.save(figure, folder / f'{what}.png')
