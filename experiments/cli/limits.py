"""Try the control of an arm at its limits, on its model and on a robot that is not its model.

Joints at their limits and walls, targets near and far, streams with wrong twists, settings that
change at rest, speeds, the energy of plain work, the own body, hand guiding with a wrong payload,
an arm that takes joint positions: free, on a hard table, and where it cannot be.
The mechanical stops of the joints are taken away.

examples:
  python -m experiments limits
  python -m experiments limits targets streams --plant clean --draws 20
  python -m experiments limits --draws 500 --jobs 2 --json limits.json

Exit code 1 if a row does not hold.
"""
from __future__ import annotations

import argparse

from experiments.cases import add_case_arguments, chosen
from gdmp_ros.util.files import write_json
from gdmp_ros.util.terminal import table


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_case_arguments(parser, 20, 'targets and streams')
    parser.add_argument('--plant', choices=('clean', 'real'), help='both by default')


def run(options: argparse.Namespace) -> int:
    """Try the cases; 0 if all hold."""
    from experiments.control_limits import CASES, PLANTS, rows
    from gdmp_ros.util.parallel import Journal, map_tasks, scheduler_address
    cases = chosen(options.what, CASES)
    plants = [options.plant] if options.plant else list(PLANTS)
    tasks = {f'{case} {plant}': (case, plant, options.draws)
             for case in cases for plant in plants}
    done = map_tasks('limits', rows, tasks, options.jobs, scheduler_address(options.backend),
                     Journal(options.resume, 'limits'))
    result = [row for key in tasks for row in done[key]]
    if options.json:
        write_json(options.json, result)
    table('control at its limits', ['case', 'plant', 'asked', 'measured', 'holds'], [
        [row['case'], row['plant'], row['asked'], f'{row["measured"]:.3g}',
         'yes' if row['holds'] else 'NO'] for row in result])
    return 0 if all(row['holds'] for row in result) else 1
