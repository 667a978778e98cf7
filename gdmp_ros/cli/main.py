"""``gdmp VERB``: finds the verb and runs it. Only the module of this verb is imported."""
from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
import difflib
import importlib
import os
import sys
from types import ModuleType
from typing import Any
import warnings

from gdmp_ros import __version__
from gdmp_ros.errors import GdmpError, GdmpWarning
from gdmp_ros.util.signals import noted_interrupts

#: Verbs by purpose, with their help; the module of a verb has its name.
GROUPS = {
    'demonstrations': {
        'record': 'write demonstrations from a data set: rosbag2, or on a manifold',
        'teach': 'guide a simulated arm by hand and record takes',
        'takes': 'list and compare takes of a demonstration, drop outliers',
        'convert': 'convert demonstrations and skills from and to other formats',
    },
    'skills': {
        'learn': 'learn a skill from rosbag2 demonstrations',
        'tune': 'suggest basis functions, gains, stiffness and limits',
        'couple': 'make one skill of two arms from two skills',
        'improve': 'improve a skill by trying, from the cost of roll-outs',
        'refine': 'correct a skill where the arm was pushed, or undo that',
        'inspect': 'show the contents of a bag or a skill file',
        'plot': 'draw a skill',
        'check': 'check whether an arm can follow a skill',
        'rollout': 'roll a skill out, to another goal if asked, as CSV',
        'studio': 'teach, see, change and run a skill in a browser',
        'gallery': 'make a gallery of skills with pictures',
    },
    'robot': {
        'up': 'start a simulated arm, server and recorder until Ctrl-C',
        'execute': 'execute the skill of a running server, switch its goal',
        'replay': 'send recorded references to an arm again',
        'watch': 'watch server and arm in the terminal',
        'report': 'make an HTML page about a bag',
        'film': 'make a film of a run, or of a skill',
        'describe': 'write the URDF of an arm',
        'home': 'move the joints of an arm to a posture',
        'identify-friction': "measure the friction of an arm's joints",
        'doctor': 'check this machine and say what to change',
        'warm-up': 'compile the kernels now, not at the first start',
    },
    'experiments': {
        'demo': 'everything end to end on a simulated Panda',
        'bench': 'measure speed, accuracy and smoothness, compared with other libraries',
        'paper': 'reproduce the experiments of the paper',
        'faults': 'try faults on the nodes',
        'soak': 'operate the nodes for a long time and watch them',
    },
}
VERBS = {name: text for group in GROUPS.values() for name, text in group.items()}
_EXAMPLES = """\
a first skill, from handwriting to a motion:
  gdmp record lasa GShape -o demos          write 7 demonstrations as rosbag2
  gdmp inspect demos/GShape_1               look at one
  gdmp learn demos/GShape_* -o skill.json   learn pose and stiffness from all
  gdmp plot skill.json -o skill.png         see it
  gdmp rollout skill.json --goal-position 0.5 0.1 0.4

your own skill, in simulation:
  gdmp teach -o takes                       guide the arm by hand, a few takes
  gdmp takes takes                          compare them, drop outliers
  gdmp tune takes                           how to learn from them
  gdmp learn takes -o skill.json
  gdmp execute --load skill.json            on running nodes (panda_sim, trajectory_server)

everything on a simulated robot:
  gdmp demo

gdmp VERB --help describes a verb, with examples. Completion in bash or zsh:
  eval "$(register-python-argcomplete gdmp)"
"""


def parser() -> argparse.ArgumentParser:
    """Build the parser of ``gdmp`` without a verb."""
    verbs = '\n'.join(f'{group}:\n' + '\n'.join(
        f'  {name:<10}{text}' for name, text in found.items()) for group, found in GROUPS.items())
    result = argparse.ArgumentParser(
        prog='gdmp', usage='gdmp VERB [arguments]', epilog=f'{verbs}\n\n{_EXAMPLES}',
        description='Learn robot skills from demonstrations and roll them out.',
        formatter_class=argparse.RawDescriptionHelpFormatter)
    result.add_argument('--version', action='version', version=f'gdmp {__version__}')
    return result


def module_of(verb: str) -> ModuleType:
    """Import the module of a verb: it has ``add_arguments(parser)`` and ``run(options)``."""
    return importlib.import_module(f'gdmp_ros.cli.{verb.replace("-", "_")}')


def parse(words: Sequence[str]) -> tuple[ModuleType, argparse.Namespace]:
    """
    Import a verb and parse its arguments.

    :param words: the verb, then its arguments
    :returns: its module, which has a function ``run(options)``, and the options
    :raises SystemExit: after help, or with code 2 if the usage is wrong
    """
    name = words[0]
    if name.startswith('-'):
        parser().parse_args(words)
    if name not in VERBS:
        near = difflib.get_close_matches(name, VERBS, n=1, cutoff=0.5)
        question = f"did you mean '{near[0]}'?" if near else 'see gdmp --help'
        parser().error(f"'{name}' is not a verb; {question}")
    module = module_of(name)
    first, _, rest = (module.__doc__ or '').partition('\n')
    verb = argparse.ArgumentParser(prog=f'gdmp {name}', description=first,
                                   epilog=rest.strip() or None,
                                   formatter_class=argparse.RawDescriptionHelpFormatter)
    module.add_arguments(verb)
    return module, verb.parse_args(words[1:])


def main(arguments: Sequence[str] | None = None) -> int:
    """
    Run a verb.

    :returns: exit code: 0 done, 1 refused with a message, 2 wrong usage, 130 interrupted
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    if not words:
        parser().print_help()
        return 0
    with noted_interrupts() as interrupted:
        try:
            return _run(words)
        except Exception:
            if not interrupted.is_set():
                raise
            return _interrupted()


def _run(words: Sequence[str]) -> int:
    try:
        module, options = parse(words)
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
