"""Draw a skill or a sequence: path with stiffness ellipsoids, and every factor over time.

A step of a sequence that waits for a signal gets it after two cycles or seconds.

examples:
  gdmp plot skill.json -o skill.png
  gdmp plot skill.json -o skill.png --demonstrations demos
  gdmp plot sequence.yaml -o sequence.png
"""
from __future__ import annotations

import argparse
from pathlib import Path

from gdmp_ros.cli.arguments import check_output


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('skill', type=Path, metavar='SKILL|SEQUENCE')
    parser.add_argument('-o', '--output', type=Path, required=True, metavar='PNG')
    parser.add_argument('--demonstrations', type=Path, nargs='+', default=[], metavar='BAG',
                        help='draw demonstrations of a tool below it')


def run(options: argparse.Namespace) -> None:
    """Roll the skill or the sequence out and draw it."""
    check_output(options.output, '.png', '.pdf', '.svg')
    from gdmp_ros.data import recordings, takes
    from gdmp_ros.dmp.skill import Skill
    from gdmp_ros.view import plots, skill_plots
    if options.skill.suffix in ('.yaml', '.yml'):
        from gdmp_ros.data.sequences import read_sequence
        from gdmp_ros.view.skill_plots import sequence_figure
        plots.save(sequence_figure(read_sequence(options.skill)), options.output)
        print(f'wrote {options.output}')
        return
    skill = Skill.load(options.skill)
    demos = [recordings.read(bag).demonstration for source in options.demonstrations
             for bag in takes.bags_in(source)]
    plots.save(skill_plots.skill_figure(skill, demos), options.output)
    print(f'wrote {options.output}')
