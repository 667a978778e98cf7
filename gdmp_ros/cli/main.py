"""``gdmp VERB``: what it can do is named by `VERBS`."""
from __future__ import annotations

import argparse
from collections.abc import Sequence
import importlib
import os
import sys

from gdmp_ros.errors import GdmpError

VERBS = ('record', 'teach', 'takes', 'tune', 'learn', 'convert', 'inspect', 'plot', 'rollout',
         'film', 'gallery', 'describe', 'execute', 'watch', 'report', 'doctor', 'bench', 'paper',
         'demo', 'faults', 'soak')
_EPILOG = """\
a first skill, from handwriting to a motion:
  gdmp record lasa GShape -o demos          write 7 demonstrations as rosbag2
  gdmp inspect demos/GShape_1               look at one
  gdmp learn demos/GShape_* -o skill.json   learn pose and stiffness from all
  gdmp plot skill.json -o skill.png         see it
  gdmp rollout skill.json --goal-position 0.5 0.1 0.4

a skill of your own, in simulation:
  gdmp teach -o takes                       lead the arm by hand, a few takes
  gdmp takes takes                          compare them, drop the bad one
  gdmp tune takes                           how to learn from them
  gdmp learn takes -o skill.json
  gdmp execute --load skill.json            on running nodes (panda_sim, trajectory_server)

all of it on a simulated robot:
  gdmp demo

the experiments of the paper:
  gdmp paper all

what can go wrong on a robot, tried:
  gdmp faults
  gdmp soak --minutes 30
"""


def parser() -> argparse.ArgumentParser:
    """Build the parser of all verbs."""
    result = argparse.ArgumentParser(
        prog='gdmp', description='Learn robot skills from demonstrations and roll them out.',
        epilog=_EPILOG, formatter_class=argparse.RawDescriptionHelpFormatter)
    verbs = result.add_subparsers(dest='verb', metavar='VERB', required=True)
    for name in VERBS:
        module = importlib.import_module(f'gdmp_ros.cli.{name}')
        first, _, rest = (module.__doc__ or '').partition('\n')
        sub = verbs.add_parser(name, help=module.HELP, description=first,
                               epilog=rest.strip() or None,
                               formatter_class=argparse.RawDescriptionHelpFormatter)
        module.add_arguments(sub)
        sub.set_defaults(run=module.run)
    return result


def main(arguments: Sequence[str] | None = None) -> int:
    """
    Run a verb.

    :returns: exit code: 0 done, 1 refused with a message, 2 wrong usage, 130 interrupted
    """
    options = parser().parse_args(arguments)
    try:
        code = options.run(options)
        return int(code or 0)
    except GdmpError as error:
        print(f'error: {error}', file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print('interrupted', file=sys.stderr)
        return 130
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0


if __name__ == '__main__':
    sys.exit(main())
