"""Work the nodes for a long time: random skills, goals, tempo changes and pauses, all watched.

examples:
  gdmp soak --minutes 30 --out out/soak
  gdmp soak --minutes 1 --seed 7

Counts every reference by its sequence number, compares missed ticks with those of a loop that only
sleeps, follows the memory of both nodes and the limits of the arm. Writes soak.json and soak.png.
Exit code 1 if something does not hold.
"""
from __future__ import annotations

import argparse
from pathlib import Path

from gdmp_ros.errors import DataError
from gdmp_ros.util.optional_imports import optional_import, ROS

HELP = 'work the nodes for a long time and watch them'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('--minutes', type=float, default=30.0, metavar='M',
                        help='how long (default %(default)g)')
    parser.add_argument('--out', type=Path, default=Path('out/soak'), metavar='DIR',
                        help='where report and picture go (default %(default)s)')
    parser.add_argument('--seed', type=int, default=0, help='of what is done (default 0)')


def run(options: argparse.Namespace) -> int:
    """Run the soak; 0 if everything holds."""
    if not 0.2 <= options.minutes <= 10_000:
        raise DataError(f'--minutes is {options.minutes:g}, expected 0.2 to 10000')
    with optional_import(ROS):
        from gdmp_ros.experiments.reliability import soak
    return 0 if soak.run(options.minutes, options.out, options.seed) else 1
