"""Try faults on the nodes, as processes, and judge each by what was recorded.

Server killed, stopped, restarted, started twice; simulation killed; the arm discovered late; skill
file, bag and disk damaged during operation; clocks that jump or are mixed; floods of goals and of
invalid messages; two hosts with a lossy, slow and cut network; a stiffness profile that adds
energy.

examples:
  python -m experiments faults --out out/faults
  python -m experiments faults --list
  python -m experiments faults server-killed network-cut --quick --out out/faults

Writes faults.json, faults.md (the table), and for each fault a folder with logs and the recorded
bag. Exit code 1 if one does not hold. A full disk and two hosts need the rights of root; without
them these are marked as not tried.
"""
from __future__ import annotations

import argparse
from pathlib import Path

from gdmp_ros.errors import DataError
from gdmp_ros.util.optional_imports import optional_import, ROS


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('what', nargs='*', metavar='FAULT', help='names; all by default')
    parser.add_argument('--out', type=Path, default=Path('out/faults'), metavar='DIR',
                        help='folder for table, logs and bags (default %(default)s)')
    parser.add_argument('--quick', action='store_true', help='fewer repetitions, shorter waits')
    parser.add_argument('--list', action='store_true', help='print the names and do nothing')


def run(options: argparse.Namespace) -> int:
    """Try the faults; 0 if all that could be tried hold."""
    with optional_import(ROS):
        from experiments.reliability import report
        from experiments.reliability.faults import FAULTS
        if options.list:
            print(report.known())
            return 0
    for name in options.what:
        if name not in FAULTS:
            raise DataError(f'fault {name!r} is unknown, expected one of {", ".join(FAULTS)}')
    return 0 if report.run(options.what or list(FAULTS), options.out, options.quick) else 1
