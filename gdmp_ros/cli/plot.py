"""Draw a skill: path with stiffness ellipsoids, and every factor over time.

examples:
  gdmp plot skill.json -o skill.png
  gdmp plot skill.json -o skill.png --demonstrations demos
"""
from __future__ import annotations

import argparse
from pathlib import Path

from gdmp_ros.cli.arguments import check_output


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('skill', type=Path, metavar='SKILL')
    parser.add_argument('-o', '--output', type=Path, required=True, metavar='PNG')
    parser.add_argument('--demonstrations', type=Path, nargs='+', default=[], metavar='BAG',
                        help='draw demonstrations of a tool below it')


def run(options: argparse.Namespace) -> None:
    """Roll the skill out and draw it."""
    check_output(options.output, '.png', '.pdf', '.svg')
    from gdmp_ros.data import recordings, takes
    from gdmp_ros.dmp.skill import Skill
    from gdmp_ros.view import plots, skill_plots
    skill = Skill.load(options.skill)
    shown = [recordings.read(bag).demonstration for source in options.demonstrations
             for bag in takes.bags_in(source)]
    plots.save(skill_plots.skill_figure(skill, shown), options.output)
    print(f'wrote {options.output}')
