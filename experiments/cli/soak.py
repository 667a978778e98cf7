"""Operate the nodes for a long time with random skills, goals, tempo changes and pauses.

examples:
  python -m experiments soak --minutes 30 --out out/soak
  python -m experiments soak --minutes 1 --seed 7

Counts every reference by its sequence number, compares missed ticks with those of a loop that only
sleeps, and watches the memory of both nodes and the limits of the arm. Writes soak.json and
soak.png. Exit code 1 if something does not hold.
"""
from __future__ import annotations

import argparse
from pathlib import Path

from gdmp_ros.cli.arguments import number
from gdmp_ros.util.optional_imports import optional_import, ROS


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('--minutes', type=number(0.2, 10_000.0), default=30.0, metavar='M',
                        help='duration [min] (default %(default)g)')
    parser.add_argument('--out', type=Path, default=Path('out/soak'), metavar='DIR',
                        help='folder for report and picture (default %(default)s)')
    parser.add_argument('--seed', type=int, default=0, help='random seed (default %(default)s)')


def run(options: argparse.Namespace) -> int:
    """Run the soak; 0 if everything holds."""
    with optional_import(ROS):
        from experiments.reliability import soak
    return 0 if soak.run(options.minutes, options.out, options.seed) else 1
