"""A command with verbs: finds the verb and runs it. Only the module of this verb is imported."""
from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
import difflib
import importlib
import os
import sys
from types import ModuleType
from typing import Any, NoReturn
import warnings

from gdmp_ros import __version__
from gdmp_ros.errors import GdmpError, GdmpWarning
from gdmp_ros.util.processes import noted_interrupts


@dataclass(frozen=True)
class Program:
    """
    A command with verbs.

    :ivar name: as users type it
    :ivar package: with a module for each verb, which has ``add_arguments(parser)`` and
        ``run(options)``
    :ivar groups: verbs by purpose, with their help; a verb may have two words
    :ivar synonyms: other words for a verb, which a message knows
    """

    name: str
    package: str
    description: str
    groups: Mapping[str, Mapping[str, str]]
    examples: str = ''
    synonyms: Mapping[str, str] = field(default_factory=dict)

    @property
    def verbs(self) -> dict[str, str]:
        """All verbs with their help."""
        return {name: text for group in self.groups.values() for name, text in group.items()}

    def parser(self) -> argparse.ArgumentParser:
        """Build the parser of the command without a verb."""
        verbs = '\n'.join(f'{group}:\n' + '\n'.join(
            f'  {name:<17}{text}' for name, text in members.items())
            for group, members in self.groups.items())
        result = argparse.ArgumentParser(
            prog=self.name, usage=f'{self.name} VERB [arguments]',
            epilog=f'{verbs}\n\n{self.examples}', description=self.description,
            formatter_class=argparse.RawDescriptionHelpFormatter)
        result.add_argument('--version', action='version', version=f'gdmp {__version__}')
        return result

    def module_of(self, verb: str) -> ModuleType:
        """Import the module of a verb."""
        return importlib.import_module(f'{self.package}.{verb.replace(" ", "_")}')

    def parse(self, words: Sequence[str]) -> tuple[ModuleType, argparse.Namespace]:
        """
        Import a verb and parse its arguments.

        :param words: the verb, then its arguments
        :returns: its module, which has a function ``run(options)``, and the options
        :raises SystemExit: after help, or with code 2 if the usage is wrong
        """
        if words[0].startswith('-'):
            self.parser().parse_args(words)
        count = 2 if ' '.join(words[:2]) in self.verbs else 1
        name = ' '.join(words[:count])
        if name not in self.verbs:
            self._refuse(words)
        return self.module_of(name), self.verb_parser(name).parse_args(words[count:])

    def verb_parser(self, verb: str) -> argparse.ArgumentParser:
        """Build the parser of a verb; its help is the docstring of the module."""
        module = self.module_of(verb)
        first, _, rest = (module.__doc__ or '').partition('\n')
        result = argparse.ArgumentParser(prog=f'{self.name} {verb}', description=first,
                                         epilog=rest.strip() or None,
                                         formatter_class=argparse.RawDescriptionHelpFormatter)
        module.add_arguments(result)
        return result

    def _refuse(self, words: Sequence[str]) -> NoReturn:
        """:raises SystemExit: with the verbs that may have been meant"""
        members = [verb for verb in self.verbs if verb.split()[0] == words[0]]
        if members:
            self.parser().error(f"'{words[0]}' needs a second word: {', '.join(members)}")
        known = {**{verb: verb for verb in self.verbs}, **self.synonyms}
        near = difflib.get_close_matches(words[0], known, n=1, cutoff=0.5)
        question = (f"did you mean '{known[near[0]]}'?" if near else
                    f'see {self.name} --help')
        self.parser().error(f"'{words[0]}' is not a verb; {question}")

    def main(self, arguments: Sequence[str] | None = None) -> int:
        """
        Run a verb.

        :returns: exit code: 0 done, 1 refused with a message, 2 wrong usage, 130 interrupted
        """
        words = list(sys.argv[1:] if arguments is None else arguments)
        if not words:
            self.parser().print_help()
            return 0
        with noted_interrupts() as interrupted:
            try:
                return self._run(words)
            except Exception:
                if not interrupted.is_set():
                    raise
                return _interrupted()

    def _run(self, words: Sequence[str]) -> int:
        try:
            module, options = self.parse(words)
            # Numba is imported after the arguments have been checked: it takes half a second.
            from gdmp_ros.util.compile_progress import compilation_reported
            with compilation_reported(), _warnings_as_notes():
                return int(module.run(options) or 0)
        except GdmpError as error:
            print(f'error: {error}', file=sys.stderr)
            return 1
        except KeyboardInterrupt:
            return _interrupted()
        except BrokenPipeError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return 0
        except OSError as error:
            place = f'{error.filename}: ' if error.filename else ''
            print(f'error: {place}{error.strerror or error}', file=sys.stderr)
            return 1


@contextmanager
def _warnings_as_notes() -> Iterator[None]:
    """Print our warnings in one line, without the place in the code."""
    with warnings.catch_warnings():
        usual = warnings.showwarning

        def show(message: Any, category: Any, *rest: Any, **more: Any) -> None:
            if issubclass(category, GdmpWarning):
                print(f'note: {message}', file=sys.stderr)
            else:
                usual(message, category, *rest, **more)
        warnings.showwarning = show
        warnings.simplefilter('always', GdmpWarning)
        yield


def _interrupted() -> int:
    print('interrupted', file=sys.stderr)
    return 130
