"""Try the control of an arm at its limits, on its model and on a robot that is not its model.

Joints at their limits and walls, targets near and far, streams that claim what is not so, settings
that change at rest, speeds. The mechanical stops of the joints are taken away.

examples:
  python -m experiments limits
  python -m experiments limits targets streams --plant clean --draws 20
  python -m experiments limits --draws 500 --jobs 2 --json limits.json

Exit code 1 if a row does not hold.
"""
from __future__ import annotations

import argparse
from pathlib import Path

from gdmp_ros.cli.arguments import add_parallel, integer
from gdmp_ros.errors import DataError
from gdmp_ros.util.files import write_json
from gdmp_ros.util.terminal import table


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('what', nargs='*', metavar='CASE', help='names; all by default')
    parser.add_argument('--plant', choices=('clean', 'real'), help='both by default')
    parser.add_argument('--draws', type=integer(1, 100_000), default=20, metavar='N',
                        help='targets and streams (default %(default)s)')
    parser.add_argument('--json', type=Path, metavar='FILE', help='write the rows')
    add_parallel(parser)


def run(options: argparse.Namespace) -> int:
    """Try the cases; 0 if all hold."""
    from experiments.control_limits import CASES, PLANTS, rows
    from gdmp_ros.util.parallel import Journal, map_tasks, scheduler_address
    for name in options.what:
        if name not in CASES:
            raise DataError(f'case {name!r} is unknown, expected one of {", ".join(CASES)}')
    plants = [options.plant] if options.plant else list(PLANTS)
    tasks = {f'{case} {plant}': (case, plant, options.draws)
             for case in options.what or CASES for plant in plants}
    done = map_tasks('limits', rows, tasks, options.jobs, scheduler_address(options.backend),
                     Journal(options.resume, 'limits'))
    result = [row for key in tasks for row in done[key]]
    if options.json:
        write_json(options.json, result)
    table('control at its limits', ['case', 'plant', 'asked', 'measured', 'holds'], [
        [row['case'], row['plant'], row['asked'], f'{row["measured"]:.3g}',
         'yes' if row['holds'] else 'NO'] for row in result])
    return 0 if all(row['holds'] for row in result) else 1
