"""Write ``docs/cli.md``, the reference of the command line, from its parsers."""
from __future__ import annotations

import argparse
import os
from pathlib import Path
import sys

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
PAGE = Path(__file__).with_name('cli.md')
#: Width of the help texts.
COLUMNS = '99'


def page() -> str:
    """The page."""
    os.environ['COLUMNS'] = COLUMNS
    from gdmp_ros.cli.main import PROGRAM
    lines = ['# The command line', '', 'Every verb of `gdmp`, as `gdmp VERB --help` describes it. '
             'Written by `python docs/cli_page.py`.', '']
    for group, verbs in PROGRAM.groups.items():
        lines += [f'## {group.capitalize()}', '', '| verb | |', '|---|---|',
                  *(f'| [`gdmp {verb}`](#gdmp-{verb.replace(" ", "-")}) | {text} |'
                    for verb, text in verbs.items()), '']
        for verb in verbs:
            parser: argparse.ArgumentParser = PROGRAM.verb_parser(verb)
            lines += [f'### gdmp {verb}', '', '```text', parser.format_help().rstrip(), '```', '']
    return '\n'.join(lines)


if __name__ == '__main__':
    PAGE.write_text(page())
