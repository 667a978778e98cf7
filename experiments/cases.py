"""Arguments of a verb that tries named cases with random draws."""
from __future__ import annotations

import argparse
from collections.abc import Collection
from pathlib import Path

from gdmp_ros.cli.arguments import add_parallel, integer
from gdmp_ros.errors import DataError


def add_case_arguments(parser: argparse.ArgumentParser, draws: int, what: str) -> None:
    """
    Declare the arguments.

    :param draws: by default
    :param what: that is drawn
    """
    parser.add_argument('what', nargs='*', metavar='CASE', help='names; all by default')
    parser.add_argument('--draws', type=integer(1, 100_000), default=draws, metavar='N',
                        help=f'{what} (default %(default)s)')
    parser.add_argument('--json', type=Path, metavar='FILE', help='write the rows')
    add_parallel(parser)


def chosen(names: list[str], cases: Collection[str]) -> list[str]:
    """
    Names of the cases to be tried.

    :raises DataError: if one is unknown
    """
    for name in names:
        if name not in cases:
            raise DataError(f'case {name!r} is unknown, expected one of {", ".join(cases)}')
    return names or list(cases)
