"""Try learning where data are bad: each case with many motions that were not seen before.

Stamps in bursts, nearly equal stamps, few samples, wrong first and last samples, missing blocks,
two arms that begin far from their relation, cycles of a hand.

examples:
  python -m experiments edges
  python -m experiments edges bursts cycles --draws 50 --jobs 2
  python -m experiments edges --json edges.json

A row has the worst of all draws. Exit code 1 if a row does not hold.
"""
from __future__ import annotations

import argparse

from experiments.cases import add_case_arguments, chosen
from gdmp_ros.util.files import write_json
from gdmp_ros.util.terminal import table


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_case_arguments(parser, 200, 'motions of each case')


def run(options: argparse.Namespace) -> int:
    """Try the cases; 0 if all hold."""
    from experiments.edges import CASES, draw, rows
    from gdmp_ros.util.parallel import Journal, map_tasks, scheduler_address
    cases = chosen(options.what, CASES)
    result = []
    for case in cases:
        tasks = {f'{case} {seed}': (case, seed) for seed in range(options.draws)}
        done = map_tasks(case, draw, tasks, options.jobs, scheduler_address(options.backend),
                         Journal(options.resume, 'edges'))
        result += rows(case, [done[key] for key in tasks])
    if options.json:
        write_json(options.json, result)
    table('learning at its edges', ['case', 'asked', 'worst', 'median', 'hold'], [
        [row['case'], row['asked'], f'{row["measured"]:.3g}', f'{row["median"]:.3g}',
         f'{row["holding"]} of {row["draws"]}'] for row in result])
    return 0 if all(row['holds'] for row in result) else 1
