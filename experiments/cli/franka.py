"""Use a Franka over its protocol: letters again and again, the first day, other tasks.

The robot is the server of its protocol, which stops motions as the robot does. A letter takes half
a minute, the page of the first day eight minutes. Nothing else should use the machine.

  letters  identification, then the letter with its goal switch
  burden   five letters while a thread of the arm's node keeps the interpreter busy
  tasks    pick with the gripper, the letter in joints, objects that a camera sees, wiping
  page     the commands of docs/franka_first_skill.md; a scripted hand guides the arm

examples:
  python -m experiments franka
  python -m experiments franka --runs 5 --json franka.json
  python -m experiments franka --only page

Exit code 1 if a row does not hold.
"""
from __future__ import annotations

import argparse
from pathlib import Path

from gdmp_ros.errors import ParameterError
from gdmp_ros.util.files import write_json
from gdmp_ros.util.terminal import table

PARTS = ('letters', 'burden', 'tasks', 'page')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('--runs', type=int, default=20, metavar='N',
                        help='letters (default %(default)s)')
    parser.add_argument('--only', choices=PARTS, action='append', metavar='PART',
                        help=f'one of {", ".join(PARTS)}; may be repeated (default: all)')
    parser.add_argument('--json', type=Path, metavar='FILE', help='write everything there')


def run(options: argparse.Namespace) -> int:
    """Measure; 0 if all rows hold."""
    if options.runs < 1:
        raise ParameterError(f'--runs is {options.runs}, expected at least 1')
    from experiments.franka import measure
    from gdmp_ros.ros.arm_choice import ArmChoice
    ArmChoice('franka', protocol_server=True).check()
    document = measure(options.runs, options.only or PARTS)
    if options.json:
        write_json(options.json, document)
    table('a Franka over its protocol', ['case', 'asked', 'measured', 'holds'], [
        [row['case'], row['asked'], f'{row["measured"]:.4g}', 'yes' if row['holds'] else 'NO']
        for row in document['rows']])
    return 0 if all(row['holds'] for row in document['rows']) else 1
