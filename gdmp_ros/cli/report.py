"""Make an HTML page about a bag: a run of the nodes, or a demonstration.

The page shows the path in space with stiffness ellipsoids; errors, stiffness, energy and lateness
over time; and the events. It is one file and needs no network.

examples:
  gdmp report out/demo/run -o run.html
  gdmp report takes/take_001 -o take.html
  gdmp report takes/take_001 -o take.html --skill skill.json
"""
from __future__ import annotations

import argparse
from pathlib import Path

from gdmp_ros.cli.arguments import add_robot, check_output
from gdmp_ros.util.optional_imports import extra, optional_import


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('bag', type=Path, metavar='BAG', help='rosbag2 folder')
    parser.add_argument('-o', '--output', type=Path, required=True, metavar='HTML')
    parser.add_argument('--skill', type=Path, metavar='SKILL',
                        help='skill of several takes: show where 95 %% of takes with this start '
                             'and goal would be')
    add_robot(parser)


def run(options: argparse.Namespace) -> None:
    """Write the page."""
    check_output(options.output, '.html')
    with optional_import(extra('report')):
        from gdmp_ros.view import pages
    what = pages.write_report(options.bag, options.output, options.robot, options.skill)
    print(f'wrote {options.output}, about {what}')
