"""Everything end to end on a simulated Panda: bags, learning, streaming, a goal switch, a report.

Runs the trajectory server and the simulation as processes in their own DDS domain, executes the
skill, switches the goal (pose and stiffness) during the motion, records references and robot state
in an MCAP bag, and writes report.json and pictures.

example:
  gdmp demo --out out/demo
"""
from __future__ import annotations

import argparse
from pathlib import Path

from gdmp_ros.util.optional_imports import optional_import, ROS


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('--out', type=Path, default=Path('out/demo'), metavar='DIR',
                        help='folder for report, bag and pictures (default %(default)s)')
    parser.add_argument('--class', dest='name', default='GShape', metavar='CLASS',
                        help='LASA class to demonstrate (default %(default)s)')


def run(options: argparse.Namespace) -> int:
    """Run the demonstration; 0 if everything holds."""
    with optional_import(ROS):
        from gdmp_ros.experiments.demo.run import run_demo
    return run_demo(options.out, options.name)
