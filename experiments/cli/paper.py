"""Reproduce the experiments of the paper, with the methods it compares with, and pictures.

fig2       a sphere: across both hemispheres, and through the antipode of the goal
fig3       the Riemannian LASA data set: every class, every demonstration, five manifolds
letters    the 2D-Letters data set on the same manifolds (needs the data: --letters)
fig4       a unit quaternion, with a new goal
fig5       the same beside the primitive in the logarithm of the error
baselines  every method on every data set it can handle, in one table
fig6       SPD(2) beside explicit parallel transport: accuracy and time
fig7       how the cost grows from SPD(2) to SPD(20)
fig8       a planar arm follows another one's manipulability
fig9       a stiffness goal switched while a mass is drawn along a path
fig10      the same over time
fig11      a Panda refills a watering can (with a film)
fig12      a Panda enters three boxes after one demonstration (with a film)
table1     which method handles which space
theorem1   the energy decreases, the goal is reached
all        everything

examples:
  python -m experiments paper all --out out/paper
  python -m experiments paper fig8 fig12 --out out/paper
  python -m experiments paper letters --letters 2Dletters

Each writes pictures, a data file ({id}.npz) and an entry of report.json; index.html shows them
all. Exit code 1 if a claim does not hold.
"""
from __future__ import annotations

import argparse
import os
from pathlib import Path

from gdmp_ros.errors import DataError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('what', nargs='+', metavar='WHAT', help='experiments, or all')
    parser.add_argument('--out', type=Path, default=Path('out/paper'), metavar='DIR',
                        help='where report and pictures go (default %(default)s)')
    parser.add_argument('--letters', type=Path, metavar='DIR',
                        help='folder of the 2D-Letters data set (default: GDMP_LETTERS)')
    parser.add_argument('--ros', action='store_true',
                        help='fig11 through the nodes instead of the same loop without ROS')
    parser.add_argument('--jobs', type=int, default=-1, metavar='N',
                        help='processes; -1: one per core (default %(default)s)')


def run(options: argparse.Namespace) -> int:
    """Run the experiments; 0 if every claim that could be tried holds."""
    from experiments.paper import report
    from experiments.paper.experiment import IDS, Settings
    for name in options.what:
        if name not in (*IDS, 'all'):
            raise DataError(f'experiment {name!r} is unknown, expected one of '
                            f'{", ".join(IDS)} or all')
    names = list(dict.fromkeys(IDS if 'all' in options.what else options.what))
    if options.jobs == 0:
        raise DataError('--jobs is 0, expected a number of processes, or -1 for one per core')
    if options.ros and 'fig11' not in names:
        raise DataError('--ros concerns fig11 only: the nodes stream poses with stiffness')
    given = options.letters or os.environ.get('GDMP_LETTERS')
    letters = Path(given) if given else None
    if letters is not None and not letters.is_dir() and {'letters', 'baselines'} & set(names):
        raise DataError(f'{letters}: no such folder of letters')
    settings = Settings(letters, options.ros, options.jobs, options.out)
    return 0 if report.run(names, settings) else 1
