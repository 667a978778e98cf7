"""Make the film of the first page: teach, switch a goal, follow an object, go around others.

The nodes execute everything in real time, and it is recorded. The film is drawn from the bags,
which stay beside it. It takes about four minutes.

examples:
  python -m experiments film
  python -m experiments film --out out/film --again
"""
from __future__ import annotations

import argparse
from pathlib import Path

from gdmp_ros.util.optional_imports import optional_import, ROS


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('--out', type=Path, default=Path('out/film'), metavar='DIR',
                        help='folder for bags, clips and film (default %(default)s)')
    parser.add_argument('--again', action='store_true',
                        help='draw from the bags that are there, without executing anything')


def run(options: argparse.Namespace) -> None:
    """Execute, record, draw."""
    with optional_import(ROS):
        from experiments.film import draw, record
    options.out.mkdir(parents=True, exist_ok=True)
    if not options.again:
        record(options.out)
    durations = draw(options.out)
    print(f'{sum(durations.values()):.0f} s: ' + ', '.join(
        f'{name} {seconds:.0f} s' for name, seconds in durations.items()))
