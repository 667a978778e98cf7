"""Watch a trajectory server and an arm live: rate, lateness, progress, distance to the goal.

Where nobody looks (a pipe, a file) it prints one line a second.

examples:
  gdmp watch
  gdmp watch --server left/trajectory_server --arm left/panda_sim
  gdmp watch --seconds 10 > log
"""
from __future__ import annotations

import argparse
import os

from gdmp_ros.errors import DataError
from gdmp_ros.util.optional_imports import optional_import, ROS

HELP = 'watch server and arm live in the terminal'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('--server', default='trajectory_server', metavar='NODE',
                        help='trajectory server (default %(default)s)')
    parser.add_argument('--arm', default='panda_sim', metavar='NODE',
                        help='arm (default %(default)s)')
    parser.add_argument('--seconds', type=float, metavar='S', help='how long (until Ctrl-C)')


def run(options: argparse.Namespace) -> None:
    """Watch."""
    if options.seconds is not None and not options.seconds > 0.0:
        raise DataError(f'--seconds is {options.seconds:g}, expected more than 0')
    from gdmp_ros.util.dds_network import default_environment
    os.environ.update(default_environment())
    with optional_import(ROS):
        from gdmp_ros.ros.clients import dashboard as watching
    watching.watch(options.server, options.arm, options.seconds)
