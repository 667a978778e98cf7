"""Watch a trajectory server and an arm: rate, lateness, progress, distance to the goal.

Without a terminal (a pipe, a file) it prints one line per second.

examples:
  gdmp watch
  gdmp watch --server left/trajectory_server --node left/panda_sim
  gdmp watch --seconds 10 > log
"""
from __future__ import annotations

import argparse
import os

from gdmp_ros.cli.arguments import add_arm_node, number
from gdmp_ros.util.optional_imports import optional_import, ROS


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('--server', default='trajectory_server', metavar='NODE',
                        help='trajectory server (default %(default)s)')
    add_arm_node(parser)
    parser.add_argument('--seconds', type=number(above=0.0), metavar='S',
                        help='duration [s]; default: until Ctrl-C')


def run(options: argparse.Namespace) -> None:
    """Watch."""
    from gdmp_ros.util.dds_network import default_environment
    os.environ.update(default_environment())
    with optional_import(ROS):
        from gdmp_ros.ros.clients import dashboard
    dashboard.show(options.server, options.node, options.seconds)
