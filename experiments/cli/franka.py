"""Identify a Franka, and let it follow a letter again and again, over its protocol.

The robot is the server of its protocol, which stops motions as the robot does. A run takes half a
minute. Nothing else should use the machine.

examples:
  python -m experiments franka
  python -m experiments franka --runs 5 --json franka.json

Exit code 1 if a row does not hold.
"""
from __future__ import annotations

import argparse
from pathlib import Path

from gdmp_ros.errors import ParameterError
from gdmp_ros.util.files import write_json
from gdmp_ros.util.terminal import table


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('--runs', type=int, default=20, metavar='N',
                        help='letters (default %(default)s)')
    parser.add_argument('--json', type=Path, metavar='FILE', help='write everything there')


def run(options: argparse.Namespace) -> int:
    """Measure; 0 if all rows hold."""
    if options.runs < 1:
        raise ParameterError(f'--runs is {options.runs}, expected at least 1')
    from experiments.franka_letters import measure
    from gdmp_ros.ros.arm_choice import ArmChoice
    ArmChoice('franka', protocol_server=True).check()
    document = measure(options.runs)
    if options.json:
        write_json(options.json, document)
    table('a Franka over its protocol', ['case', 'asked', 'measured', 'holds'], [
        [row['case'], row['asked'], f'{row["measured"]:.4g}', 'yes' if row['holds'] else 'NO']
        for row in document['rows']])
    return 0 if all(row['holds'] for row in document['rows']) else 1
