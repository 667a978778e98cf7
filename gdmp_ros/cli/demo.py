"""Everything end to end on a simulated Panda: bags, learning, streaming, a goal switch, a report.

Runs the trajectory server and the simulation as processes on a DDS domain of their own, executes
the skill, switches the goal (pose and stiffness) in mid-motion, records references and robot state
to an MCAP bag, and writes report.json and pictures.

example:
  gdmp demo --out out/demo
"""
from __future__ import annotations

import argparse
from pathlib import Path

HELP = 'everything end to end on a simulated Panda'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('--out', type=Path, default=Path('out/demo'), metavar='DIR',
                        help='where report, bag and pictures go (default %(default)s)')
    parser.add_argument('--class', dest='name', default='GShape', metavar='CLASS',
                        help='LASA class to demonstrate (default %(default)s)')


def run(options: argparse.Namespace) -> int:
    """Run the demonstration; 0 where it ended well."""
    from gdmp_ros.experiments.demo.run import run_demo  # needs ROS, unlike the other verbs
    return run_demo(options.out, options.name)
