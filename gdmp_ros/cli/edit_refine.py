"""Correct a skill by pushing the arm while it moves, or undo a correction.

Record a run in which you push the tool to where its path should be. The path is moved there, with
smooth ways in and out, and stays elsewhere. Nothing is written unless you ask: look at the table
and the picture first.

examples:
  gdmp edit refine skill.json run --plot change.png
  gdmp edit refine skill.json run --keep
  gdmp edit refine skill.json run -o better.json
  gdmp edit refine skill.json --undo
"""
from __future__ import annotations

import argparse
from pathlib import Path

from gdmp_ros.cli.arguments import add_output, add_robot, check_output, number
from gdmp_ros.errors import DataError, ParameterError
from gdmp_ros.util.terminal import progress, table


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('skill', type=Path, metavar='SKILL')
    parser.add_argument('run', type=Path, nargs='?', metavar='BAG',
                        help='recorded run with references, states of the arm and of the server')
    parser.add_argument('--plot', type=Path, metavar='PNG', help='draw the path before and after')
    parser.add_argument('--keep', action='store_true',
                        help='replace the skill file; the version before is kept for --undo')
    add_output(parser, 'SKILL', 'write the corrected skill to another file', required=False)
    parser.add_argument('--undo', action='store_true',
                        help='bring back the version before the last --keep')
    parser.add_argument('--least', type=number(above=0.0), default=10.0, metavar='MM',
                        help='smallest deviation from the reference that counts as a push [mm] '
                             '(default %(default)g)')
    add_robot(parser)


def run(options: argparse.Namespace) -> None:
    """Show the correction, and keep it if asked."""
    from gdmp_ros.data import skills
    if options.undo:
        if options.run or options.keep or options.output or options.plot:
            raise ParameterError('--undo takes a skill only')
        skills.undo(options.skill)
        print(f'{options.skill}: the version before the last correction is back')
        return
    if options.run is None:
        raise ParameterError('expected a recorded run, or --undo')
    if options.keep and options.output:
        raise ParameterError('--keep replaces the skill file, -o writes another one: choose one')
    check_output(options.plot, '.png', '.pdf', '.svg')
    check_output(options.output, '.json')
    from gdmp_ros.data import runs
    from gdmp_ros.data.runs import followed_motion
    from gdmp_ros.dmp.skill import Skill
    from gdmp_ros.learning.correction import correction
    skill = Skill.load(options.skill)
    with progress('reading', 1):
        recorded = runs.read(options.run, options.namespace)
    try:
        result = correction(skill, followed_motion(recorded), least=1e-3 * options.least)
    except DataError as error:
        raise DataError(f'{options.run}: {error}') from None
    table(f'pushes in {options.run}',
          ['what', 'from s', 'to s', 'largest at s', 'moved by', 'way in and out [s]'],
          [[push.quantity, f'{push.begin:.2f}', f'{push.end:.2f}', f'{push.at:.2f}',
            f'{1e3 * push.largest:.1f} mm' if push.quantity == 'position'
            else f'{push.largest:.2f} rad', f'{push.way * skill.duration:.2f}']
           for push in result.pushes])
    if options.plot is not None:
        from gdmp_ros.view import plots
        from gdmp_ros.view.skill_plots import correction_figure
        plots.save(correction_figure(skill, result), options.plot)
        print(f'wrote {options.plot}')
    corrected = result.primitive
    if options.output is not None:
        corrected.save(options.output)
        print(f'wrote {options.output}')
    elif options.keep:
        skills.replace(options.skill, corrected)
        print(f'{options.skill}: corrected; gdmp edit refine {options.skill} --undo goes back')
    else:
        print('nothing was written: --keep replaces the skill, -o writes another file')
