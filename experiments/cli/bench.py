"""Measure speed, accuracy and smoothness, compared with other libraries.

step         a step of a roll-out from Python, compared with movement_primitives
learn        learning, compared with movement_primitives
accuracy     reproduction of all LASA classes on five manifolds, for steps of 1 to 10 ms
goal-switch  accelerations after a goal switch, compared with movement_primitives
tempo        the path when the tempo changes, compared with movement_primitives
noise        demonstrations with noise on R³, S³ and SPD(3)
takes        several takes of real tasks, each left out once (needs the data: --robottasks)
generalise   task frames: takes between two frames, done in the frames of others, beside the
             published results of other methods (needs the data: --frames)
spd          both connections on SPD(2) to SPD(20), explicit transport, pymanopt's maps
obstacles    past volumes: a way that is searched, the bend, potentials of Ginesi et al., and
             movement_primitives
stiffness    a stiffness that is streamed, beside a fixed one, on an arm that takes positions
improve      improvement from the cost of roll-outs: two demonstrations of dmpbbo, and CMA-ES
stream       the lateness of the nodes, compared with a bare loop (needs ROS)
clouds       the CPU load of an arm that follows clouds of points (needs ROS)
tick         a tick of the closed loop without ROS, compared with the simulation alone
franka       a cycle of a Franka over its protocol, compared with a client that only reads
all          everything, with pictures

examples:
  python -m experiments bench step --json step.json
  python -m experiments bench accuracy --jobs 2 --resume accuracy.jsonl --json accuracy.json
  python -m experiments bench all --out out/bench

The other libraries come with: pip install '.[bench]' in the folder of gdmp_ros
"""
from __future__ import annotations

import argparse
import importlib
import os
from pathlib import Path
from typing import Any, TYPE_CHECKING

from gdmp_ros.choices import check_lasa_class, LASA_CLASSES
from gdmp_ros.cli.arguments import add_parallel, integer, number
from gdmp_ros.errors import DataError
from gdmp_ros.util.terminal import table

if TYPE_CHECKING:
    from experiments.timing import TimingSettings

#: Benches; the module of each in `experiments.bench` has its name.
SUBJECTS = ('step', 'learn', 'accuracy', 'goal-switch', 'tempo', 'noise', 'takes',
            'generalise', 'spd', 'improve', 'obstacles', 'stiffness', 'stream', 'clouds', 'tick',
            'franka')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('what', choices=[*SUBJECTS, 'all'], metavar='WHAT',
                        help=', '.join([*SUBJECTS, 'all']))
    parser.add_argument('--json', type=Path, metavar='FILE', help='write the figures')
    parser.add_argument('--out', type=Path, default=Path('out/bench'), metavar='DIR',
                        help='for all: folder for figures and pictures (default %(default)s)')
    parser.add_argument('--repetitions', type=integer(7), default=9, metavar='N',
                        help='of every timing, at least 7; the median is reported (default '
                             '%(default)s)')
    parser.add_argument('--seconds', type=number(above=0.0, high=86400.0), default=60.0,
                        metavar='S', help='duration of stream, and of each part of clouds [s] '
                        '(default %(default)s)')
    parser.add_argument('--class', dest='classes', action='append', metavar='CLASS',
                        help='LASA class for accuracy, may be repeated (default: all 30)')
    parser.add_argument('--n-basis', type=int, default=60, metavar='N',
                        help='basis functions for accuracy (default %(default)s)')
    parser.add_argument('--robottasks', type=Path, metavar='DIR',
                        help='folder of RoboTasks9 for takes (default: GDMP_ROBOTTASKS)')
    parser.add_argument('--frames', type=Path, metavar='DIR',
                        help='folder with reach_target.npz for generalise (default: GDMP_FRAMES)')
    parser.add_argument('--situations', type=integer(0), default=100, metavar='N',
                        help='of each task of generalise on the simulated arm, 10 s each; 0: no '
                             'tasks (default %(default)s)')
    add_parallel(parser)


def run(options: argparse.Namespace) -> None:
    """Measure, print a table, write the files."""
    classes = tuple(options.classes or LASA_CLASSES)
    for name in classes:
        check_lasa_class(name)
    from experiments.timing import environment, TimingSettings
    from gdmp_ros.util.parallel import scheduler_address
    robottasks, frames = (Path(given) if given else None for given in (
        options.robottasks or os.environ.get('GDMP_ROBOTTASKS'),
        options.frames or os.environ.get('GDMP_FRAMES')))
    settings = TimingSettings(options.repetitions, options.seconds, options.jobs,
                        scheduler_address(options.backend), options.resume, classes,
                        options.n_basis, robottasks, frames, options.situations)
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
    return importlib.import_module(f'experiments.bench.{what.replace("-", "_")}')


def _measure(what: str, settings: TimingSettings) -> dict[str, Any]:
    module = _module(what)
    document: dict[str, Any] = module.run(settings)
    heads, *lines = module.rows(document)
    table(module.TITLE, heads, lines)
    return document


def _write(path: Path, document: dict[str, Any]) -> None:
    from gdmp_ros.util.files import write_json
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
