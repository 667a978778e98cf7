"""Check this machine for streaming at 1 kHz, and say what to change.

Checks Python, kernel, cores, clock, permission for SCHED_FIFO, ROS, DDS, buffers, disk and
compiled kernels, and measures a loop that only sleeps. Exit code 1 if a finding is bad.

examples:
  gdmp doctor
  gdmp doctor --seconds 30
  gdmp doctor --json
  gdmp doctor --franka 172.16.0.2        # also the connection to a Franka, which does not move
"""
from __future__ import annotations

import argparse
import json

from gdmp_ros.cli.arguments import check_number
from gdmp_ros.util.optional_imports import extra, optional_import
from gdmp_ros.util.terminal import table

#: Shortest time in which the cycles of a Franka are watched [s].
LEAST_FRANKA_S = 10.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('--seconds', type=float, default=2.0, metavar='S',
                        help='duration of the measurement with a sleeping loop [s] '
                             '(default %(default)g)')
    parser.add_argument('--franka', metavar='HOST', help='check the connection to a Franka too')
    parser.add_argument('--json', action='store_true', help='print as JSON')


def run(options: argparse.Namespace) -> int:
    """Run all checks and print the findings; 1 if one is bad."""
    check_number('--seconds', options.seconds, 0.1, 3600.0)
    from gdmp_ros.realtime import doctor
    findings = doctor.examine(options.seconds)
    if options.franka:
        with optional_import(extra('franka')):
            from gdmp_ros.franka import doctor as franka_doctor
        findings += franka_doctor.examine(options.franka, max(options.seconds, LEAST_FRANKA_S))
    if options.json:
        print(json.dumps([finding._asdict() for finding in findings], indent=1))
    else:
        table('this machine', ['', 'verdict', 'found'],
              [[finding.subject, finding.level, finding.found] for finding in findings])
        for finding in findings:
            if finding.advice:
                print(f'{finding.subject}: {finding.advice}')
    return int(any(finding.level == doctor.BAD for finding in findings))
