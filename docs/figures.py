"""
Compares figures in the pages with the files that were measured: ``python docs/figures.py``.

`docs/figures.yaml` names, for a page, a sentence or a row of a table with ``{}`` in the place of
each figure, the file in `docs/figures` that has it, and where: keys, a factor, and a format. The
files are written by the commands that the pages name, with ``--json``.
"""
from __future__ import annotations

import json
from pathlib import Path
import sys
from typing import Any

import yaml

FOLDER = Path(__file__).parent


def value_of(document: Any, keys: list[Any]) -> float:
    """A number in a document."""
    for key in keys:
        document = document[key]
    return float(document)


def problems(folder: Path = FOLDER) -> list[str]:
    """What does not agree; empty if all does."""
    found = []
    for entry in yaml.safe_load((folder / 'figures.yaml').read_text()):
        document = json.loads((folder / 'figures' / entry['file']).read_text())
        page = ' '.join((folder / entry['page']).read_text().split())
        for text, figures in entry['text'].items():
            values = [format(value_of(document, keys) * factor, form)
                      for *keys, factor, form in figures]
            expected = ' '.join(text.format(*values).split())
            if expected not in page:
                found.append(f'{entry["page"]}: expected "{expected}", from {entry["file"]}')
    return found


if __name__ == '__main__':
    wrong = problems()
    print('\n'.join(wrong) or 'all figures agree with their files')
    sys.exit(bool(wrong))
