"""Contexts of takes in a table: a CSV file with the name of each take and its numbers."""
from __future__ import annotations

from collections.abc import Sequence
import csv
import io
import math
from pathlib import Path

from gdmp_ros.errors import DataError
from gdmp_ros.util.small_file import read_text

#: Heading of the column with the names of the bags.
TAKE = 'take'
#: Larger files are refused [bytes].
MAX_BYTES = 10_000_000


def read_contexts(path: Path, takes: Sequence[str]) -> dict[str, list[float]]:
    """
    Read the numbers of takes.

    The first line has the headings: ``take`` and the name of each number.

    :param takes: names of the bags
    :returns: for each name the numbers, in the order of ``takes``
    :raises DataError: if a take is missing or occurs twice, or an entry is no number
    """
    try:
        rows = csv.reader(io.StringIO(read_text(path, 'table of contexts', MAX_BYTES)))
        lines = [(rows.line_num, [entry.strip() for entry in row]) for row in rows if any(row)]
    except (csv.Error, UnicodeDecodeError) as error:
        raise DataError(f'{path}: not a CSV file: {error}') from None
    heads = lines[0][1] if lines else []
    if TAKE not in heads or len(heads) < 2 or len(set(heads)) < len(heads) or not all(heads):
        raise DataError(f'{path}: the first line is {",".join(heads)!r}, expected {TAKE!r} and '
                        'different names of numbers')
    at, found = heads.index(TAKE), {}
    for number, row in lines[1:]:
        where = f'{path}, line {number}'
        if len(row) != len(heads):
            raise DataError(f'{where}: {len(row)} entries, expected {len(heads)}')
        if row[at] in found:
            raise DataError(f'{where}: {row[at]!r} occurs twice')
        found[row[at]] = [_number(entry, f'{where}, {head}')
                          for head, entry in zip(heads, row) if head != TAKE]
    missing = [take for take in takes if take not in found]
    if missing:
        raise DataError(f'{path}: no line for {", ".join(missing)}')
    names = [head for head in heads if head != TAKE]
    return {name: [found[take][i] for take in takes] for i, name in enumerate(names)}


def _number(entry: str, where: str) -> float:
    try:
        value = float(entry)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise DataError(f'{where}: {entry!r} is not a finite number')
    return value
