"""Completion of verbs and options by the shell, with argcomplete."""
from __future__ import annotations

import os

import argcomplete

from gdmp_ros.cli.main import PROGRAM


def complete() -> None:
    """Answer a shell that completes a line, and end the process."""
    words = os.environ.get('COMP_LINE', '').split()
    top = PROGRAM.parser()
    verbs = top.add_subparsers()
    for name, text in PROGRAM.verbs.items():
        verb = verbs.add_parser(name, help=text)
        if name in words[1:2]:  # only the module of this verb is imported
            PROGRAM.module_of(name).add_arguments(verb)
    argcomplete.autocomplete(top)
