"""
Compares figures in the pages with the files that were measured: ``python docs/figures.py``.

With ``--write`` the pages get the figures of the files.

`docs/figures.yaml` names, for a page, a sentence or a row of a table with ``{}`` in the place of
each figure, the file in `docs/figures` that has it, and where: keys (with ``/`` between those of
two numbers: their quotient), a factor, and a format. The files are written by the commands that
the pages name, with ``--json``; long lists are left out.
"""
from __future__ import annotations

from collections.abc import Iterator
import json
from pathlib import Path
import re
import sys
from typing import Any

import yaml

FOLDER = Path(__file__).parent


def value_of(document: Any, keys: list[Any]) -> float:
    """A number in a document, or the quotient of two."""
    if '/' in keys:
        at = keys.index('/')
        return value_of(document, keys[:at]) / value_of(document, keys[at + 1:])
    for key in keys:
        document = document[key]
    return float(document)


def texts(folder: Path) -> Iterator[tuple[str, str, str, list[str]]]:
    """Page, file, text with ``{}``, and what the file has in their places."""
    for entry in yaml.safe_load((folder / 'figures.yaml').read_text()):
        document = json.loads((folder / 'figures' / entry['file']).read_text())
        for text, figures in entry['text'].items():
            yield entry['page'], entry['file'], text, [
                format(value_of(document, keys) * factor, form)
                for *keys, factor, form in figures]


def problems(folder: Path = FOLDER) -> list[str]:
    """What does not agree; empty if all does."""
    found = []
    for page, file, text, values in texts(folder):
        expected = ' '.join(text.format(*values).split())
        if expected not in ' '.join((folder / page).read_text().split()):
            found.append(f'{page}: expected "{expected}", from {file}')
    return found


def write(folder: Path = FOLDER) -> None:
    """Write the figures of the files into the pages."""
    for page, _, text, values in texts(folder):
        parts = [r'\s+'.join(map(re.escape, part.split(' '))) for part in text.split('{}')]
        known = re.compile(r'([^\s|,;]+)'.join(parts))
        path = folder / page
        before = path.read_text()
        match = known.search(before)
        if match is None:
            continue
        changed = match.group()
        for number in range(len(values), 0, -1):  # from behind: places before it stay
            begin, end = (place - match.start() for place in match.span(number))
            changed = changed[:begin] + values[number - 1] + changed[end:]
        path.write_text(before[:match.start()] + changed + before[match.end():])


if __name__ == '__main__':
    if '--write' in sys.argv[1:]:
        write()
    wrong = problems()
    print('\n'.join(wrong) or 'all figures agree with their files')
    sys.exit(bool(wrong))
