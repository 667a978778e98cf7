"""Try random sequences of requests, beside a model of what the documentation says.

To a server: start, stop, pause, goals, tempo, amplitude, other skills, a robot that is far or
lost, a gripper that jams; during every state. The reference stays within its bounds in every
tick, no request is lost without a reason, and at the end the reference is where the last one says.

To an arm: every service, streams that begin, rest, end or are lost, pushes, failures, deactivation
and activation. The arm moves only in states that move, within its limits, without a step of the
torque, and the state that is reported is the one that acts.

examples:
  python -m experiments requests
  python -m experiments requests --sequences 200 --json requests.json

Exit code 1 if a sequence does not hold; the shortest one that was found is printed.
"""
from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
import sys
import traceback

from gdmp_ros.cli.arguments import integer
from gdmp_ros.util.files import write_json
from gdmp_ros.util.optional_imports import optional_import
from gdmp_ros.util.terminal import progress


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('--sequences', type=integer(1, 100_000), default=2000, metavar='N',
                        help='sequences that are tried (default %(default)s)')
    parser.add_argument('--steps', type=integer(1, 1000), default=25, metavar='N',
                        help='most requests of a sequence (default %(default)s)')
    parser.add_argument('--json', type=Path, metavar='FILE', help='write the result')


def run(options: argparse.Namespace) -> int:
    """Try the sequences; 0 if all hold."""
    with optional_import(': pip install hypothesis'):
        from experiments.arm_requests import run as of_arm
        from experiments.requests import run as of_server
    results = []
    for case, try_sequences in (('requests to a server', of_server),
                                ('requests to an arm', of_arm)):
        problem = _tried(case, try_sequences, options)
        results.append({'case': case, 'asked': options.sequences,
                        'measured': problem or 'all hold', 'holds': not problem})
        print(f'{case}: {options.sequences} sequences: ' + (problem or 'all hold'))
    if options.json:
        write_json(options.json, results)
    return 0 if all(result['holds'] for result in results) else 1


def _tried(case: str, try_sequences: Callable[..., None], options: argparse.Namespace) -> str:
    """What does not hold; empty if all sequences do."""
    try:
        with progress(f'sequences of {case}', options.sequences) as step:
            # Hypothesis tries some more.
            left = iter(range(options.sequences))
            try_sequences(options.sequences, steps=options.steps,
                          tried=lambda: None if next(left, None) is None else step())
    except (AssertionError, ExceptionGroup) as error:
        traceback.print_exception(error, file=sys.stderr)
        return str(error) or type(error).__name__
    return ''
