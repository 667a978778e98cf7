"""Put things in the way of skills and of an arm, in random scenes; MuJoCo says what touches.

random, head-on, trap: a skill is led around 1 to 8 volumes, a wall, a U of walls, and executed.
standing, coming, retreating: something is near elbow or wrist, or comes there. at-rest: something
is put inside the margin of an arm at rest. step: time of a step with eight volumes / without.

examples:
  python -m experiments obstacles
  python -m experiments obstacles coming --draws 20
  python -m experiments obstacles --draws 200 --jobs 2 --json obstacles.json

Exit code 1 if a row does not hold.
"""
from __future__ import annotations

import argparse

from experiments.cases import add_case_arguments, chosen
from gdmp_ros.util.files import write_json
from gdmp_ros.util.terminal import table


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_case_arguments(parser, 100, 'scenes')


def run(options: argparse.Namespace) -> int:
    """Try the cases; 0 if all hold."""
    from experiments.obstacles import CASES, rows
    from gdmp_ros.util.parallel import Journal, map_tasks, scheduler_address
    cases = chosen(options.what, CASES)
    tasks = {case: (case, options.draws) for case in cases}
    done = map_tasks('obstacles', rows, tasks, options.jobs, scheduler_address(options.backend),
                     Journal(options.resume, 'obstacles'))
    result = [row for case in cases for row in done[case]]
    if options.json:
        write_json(options.json, result)
    table('obstacles', ['case', 'asked', 'measured', 'holds'], [
        [row['case'], row['asked'], f'{row["measured"]:.3g}', 'yes' if row['holds'] else 'NO']
        for row in result])
    return 0 if all(row['holds'] for row in result) else 1
