"""Roll a skill out and print the path as CSV.

The columns are time, phase and the numbers of the point (position, quaternion wxyz, matrices
row-major).

examples:
  gdmp rollout skill.json --dt 0.01 > path.csv
  gdmp rollout skill.json --context height=0.03 > path.csv
  gdmp rollout insert.json --object hole 0.5 0.1 0.2 0.92 0 0 0.38 > path.csv
  gdmp rollout skill.json --goal-position 0.5 0.1 0.4 --switch-at 2.0 -o path.csv
"""
from __future__ import annotations

import argparse
import csv
import io
from pathlib import Path
import sys
from typing import TextIO, TYPE_CHECKING

from gdmp_ros.cli.arguments import (
    add_context,
    add_objects,
    add_output,
    add_scale,
    among_objects,
    check_output,
    number,
)
from gdmp_ros.errors import ParameterError

if TYPE_CHECKING:
    import numpy as np

    from gdmp_ros.dmp.rollout import Rollout
    from gdmp_ros.dmp.skill import Skill
    from gdmp_ros.manifolds import Manifold


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('skill', type=Path, metavar='SKILL')
    add_output(parser, 'CSV', 'default: the terminal', required=False)
    parser.add_argument('--dt', type=number(above=0.0), default=0.01,
                        help='time step [s] (default %(default)s)')
    parser.add_argument('--duration', type=number(above=0.0), metavar='S',
                        help='duration [s]; default: as demonstrated')
    parser.add_argument('--cycles', type=number(above=0.0), default=3.0, metavar='N',
                        help='of a rhythmic skill (default %(default)g)')
    add_context(parser)
    add_objects(parser)
    add_scale(parser)
    parser.add_argument('--goal', type=float, nargs='+', metavar='NUMBER',
                        help='goal point, all its numbers')
    parser.add_argument('--goal-position', type=float, nargs=3, metavar=('X', 'Y', 'Z'),
                        help='goal of the position factor [m]')
    parser.add_argument('--switch-at', type=number(0.0), default=0.0, metavar='S',
                        help='time of the goal switch [s]; 0: from the start')


def run(options: argparse.Namespace) -> None:
    """Roll out until the motion is finished; a rhythmic one for some cycles."""
    check_output(options.output)
    from gdmp_ros.dmp.rollout import Rollout
    from gdmp_ros.dmp.skill import Skill
    skill = among_objects(Skill.load(options.skill).in_context(options.context),
                          options.objects, options.object_scale)
    goal = _goal(skill, options)
    from_the_start = options.switch_at <= 0.0
    rollout = Rollout(skill, goal=goal if from_the_start else None, duration=options.duration)
    later = None if from_the_start else goal
    if options.output is None:
        _write(rollout, later, options, sys.stdout)
        return
    from gdmp_ros.util.files import write_text
    out = io.StringIO(newline='')
    _write(rollout, later, options, out)
    options.output.absolute().parent.mkdir(parents=True, exist_ok=True)
    write_text(options.output, out.getvalue())
    print(f'wrote {options.output}')


def _goal(skill: Skill, options: argparse.Namespace) -> np.ndarray | None:
    import numpy as np

    from gdmp_ros.manifolds.euclidean import Euclidean
    from gdmp_ros.manifolds.product import Product
    if options.goal is not None:
        flat = np.array(options.goal)
        if flat.size != skill.goal.size:
            raise ParameterError(f'--goal has {flat.size} numbers, expected {skill.goal.size}')
        return skill.manifold.check_point(flat.reshape(skill.manifold.point_shape))
    if options.goal_position is None:
        return None
    manifold = skill.manifold
    if not (isinstance(manifold, Product) and manifold.factors[0] == Euclidean(3)):
        raise ParameterError(f'--goal-position needs a skill that begins with R³, '
                             f'this is {manifold!r}')
    return manifold.join(np.array(options.goal_position), *manifold.split(skill.goal)[1:])


def _columns(name: str, factor: Manifold) -> list[str]:
    """Names of the numbers of a factor, as tables are read."""
    from gdmp_ros.manifolds.euclidean import Euclidean
    from gdmp_ros.manifolds.quaternion import UnitQuaternion
    from gdmp_ros.manifolds.spd import SymmetricPositiveDefinite
    if isinstance(factor, SymmetricPositiveDefinite):
        size = range(1, factor.size + 1)
        return [f'{"" if name == "stiffness" else f"{name}_"}k{i}{j}' for i in size for j in size]
    axes = ('wxyz' if isinstance(factor, UnitQuaternion) else
            'xyz' if factor == Euclidean(3) else range(factor.point_size))
    return [f'{name}_{axis}' for axis in axes]


def _write(rollout: Rollout, goal: np.ndarray | None, options: argparse.Namespace,
           out: TextIO) -> None:
    writer = csv.writer(out)
    manifold = rollout.skill.manifold
    names = [column for name, factor in zip(manifold.names, manifold.factors)
             for column in _columns(name, factor)]
    writer.writerow(['time', 'phase', *names])
    state = rollout.state
    while True:
        writer.writerow([f'{state.time:.6f}', f'{state.phase:.9g}',
                         *(f'{number:.12g}' for number in state.point.reshape(-1))])
        cycled = rollout.skill.rhythmic and rollout.progress >= options.cycles
        if rollout.finished or cycled or 'held' in rollout.flags:
            break
        if goal is not None and state.time >= options.switch_at:
            rollout.retarget(goal)
            goal = None
        state = rollout.advance(options.dt)
    if goal is not None:
        print(f'note: the motion ended before the goal switch at {options.switch_at:g} s',
              file=sys.stderr)
    for flag in sorted(rollout.flags):
        print(f'note: {flag}', file=sys.stderr)
