"""Check this machine for streaming at 1 kHz, and say what to change.

Looks at Python, kernel, cores, clock, rights for SCHED_FIFO, ROS, DDS, buffers, disk and compiled
kernels, and measures a loop that only sleeps. Exit code 1 if something is bad.

examples:
  gdmp doctor
  gdmp doctor --seconds 30
  gdmp doctor --json
"""
from __future__ import annotations

import argparse
import json

from gdmp_ros.errors import DataError
from gdmp_ros.realtime import doctor
from gdmp_ros.util.terminal import table

HELP = 'check this machine and say what to change'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('--seconds', type=float, default=2.0, metavar='S',
                        help='how long to measure a sleeping loop (default %(default)g)')
    parser.add_argument('--json', action='store_true', help='print as JSON')


def run(options: argparse.Namespace) -> int:
    """Examine and tell; 1 if something is bad."""
    if not 0.1 <= options.seconds <= 3600.0:
        raise DataError(f'--seconds is {options.seconds:g}, expected 0.1 to 3600')
    findings = doctor.examine(options.seconds)
    if options.json:
        print(json.dumps([one._asdict() for one in findings], indent=1))
    else:
        table('this machine', ['', 'verdict', 'found'],
              [[one.subject, one.level, one.found] for one in findings])
        for one in findings:
            if one.advice:
                print(f'{one.subject}: {one.advice}')
    return int(any(one.level == doctor.BAD for one in findings))
