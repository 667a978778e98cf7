"""Completion of verbs and options by the shell, with argcomplete."""
from __future__ import annotations

import argparse
import os

import argcomplete

from gdmp_ros.cli.main import PROGRAM


def complete() -> None:
    """Answer a shell that completes a line, and end the process."""
    words = os.environ.get('COMP_LINE', '').split()
    top = PROGRAM.parser()
    verbs = top.add_subparsers()
    nested: dict[str, argparse._SubParsersAction[argparse.ArgumentParser]] = {}
    for name, text in PROGRAM.verbs.items():
        first, _, second = name.partition(' ')
        if second and first not in nested:
            nested[first] = verbs.add_parser(first, add_help=False).add_subparsers()
        verb = nested[first].add_parser(second) if second else verbs.add_parser(first, help=text)
        if name == ' '.join(words[1:3 if second else 2]):  # only this module is imported
            PROGRAM.module_of(name).add_arguments(verb)
    argcomplete.autocomplete(top)
