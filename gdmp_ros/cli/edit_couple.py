"""Make one skill of two arms from two skills, which keep a relation while they move.

Both are executed in one motion with one phase. With kind pose the second tool keeps its pose in
the first one, as when both hold a tray: the relation is that at the goals of the skills, unless
--relation gives another one. The second arm begins and ends where the relation asks for.
Poses of both skills must be in one frame.

examples:
  gdmp edit couple left.json right.json -o both.json
  gdmp edit couple left.json right.json -o both.json --leads
  gdmp edit couple left.json right.json -o both.json --kind distance
  gdmp edit couple left.json right.json -o both.json --relation 0 -0.56 0 1 0 0 0
"""
from __future__ import annotations

import argparse
from pathlib import Path

from gdmp_ros.choices import COUPLINGS
from gdmp_ros.cli.arguments import add_output, check_output
from gdmp_ros.errors import DataError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('first', type=Path, metavar='FIRST', help='skill file of the first arm')
    parser.add_argument('second', type=Path, metavar='SECOND', help='skill file of the second arm')
    add_output(parser, 'SKILL', 'skill file of both')
    parser.add_argument('--kind', choices=COUPLINGS, default='pose',
                        help='pose: of the second tool in the first one; relative: difference of '
                             'the first factors, such as positions; distance: between them '
                             '(default %(default)s)')
    parser.add_argument('--relation', type=float, nargs='+', metavar='NUMBER',
                        help='pose (x y z qw qx qy qz) [m], difference or distance to keep '
                             '(default: that at the goals)')
    parser.add_argument('--leads', action='store_true',
                        help='the first arm leads: it does not give way to the second one')
    parser.add_argument('--names', nargs=2, default=['left', 'right'], metavar='NAME',
                        help='names of the arms (default left right)')


def run(options: argparse.Namespace) -> None:
    """Join and couple."""
    check_output(options.output, '.json')
    import numpy as np

    from gdmp_ros.dmp.coupling import Coupling
    from gdmp_ros.dmp.skill import Skill
    parts = [Skill.load(path) for path in (options.first, options.second)]
    both = Skill.joined(parts[0], parts[1], options.names)
    count = 2 if options.kind == 'pose' else 1
    half = len(parts[0].manifold.names)
    names = both.manifold.names
    if half != len(names) - half or half < count:
        raise DataError(f'{options.first} is on {parts[0].manifold!r}, {options.second} on '
                        f'{parts[1].manifold!r}: expected the same, with '
                        f'{"position and orientation" if count == 2 else "one factor or more"}')
    sides = names[:count], names[half:half + count]
    if options.relation is None:
        coupling = Coupling.at(options.kind, *sides, both.manifold, both.goal, leads=options.leads)
    else:
        coupling = Coupling(options.kind, *sides, tuple(options.relation), options.leads)
    skill = both.coupled(coupling)
    skill.save(options.output)
    relation = ', '.join(f'{number:.4g}' for number in coupling.relation)
    path = skill.reproduce(0.01).points
    worst = np.max([coupling.deviation(skill.manifold, point) for point in path], axis=0)
    print(f'{options.output}: {skill.duration:.3g} s, {options.kind} ({relation}) of '
          f'{", ".join(coupling.second)} to {", ".join(coupling.first)}')
    print('largest deviation on the way: '
          + ', '.join(f'{number:.2g}' for number in worst) + ' (m, rad)')
