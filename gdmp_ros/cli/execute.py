"""Execute the skill of a running trajectory server, and switch its goal during the motion.

This is a client of the server's action and topics. Ctrl-C brings the motion to a smooth stop.

examples:
  gdmp execute
  gdmp execute --goal-position 0.5 -0.1 0.4 --after 1.5
  gdmp execute --load skill.json --speed 0.5 --server left/trajectory_server
"""
from __future__ import annotations

import argparse
import os
from pathlib import Path

from gdmp_ros.cli.arguments import check_number
from gdmp_ros.util.optional_imports import optional_import, ROS


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('--server', default='trajectory_server', metavar='NODE',
                        help='with its namespace (default %(default)s)')
    parser.add_argument('--load', type=Path, metavar='SKILL', help='load this skill file first')
    parser.add_argument('--goal-position', type=float, nargs=3, metavar=('X', 'Y', 'Z'),
                        help='switch the goal of the position to this [m]')
    parser.add_argument('--after', type=float, default=1.0, metavar='S',
                        help='time of the goal switch after the start [s] (default %(default)g)')
    parser.add_argument('--speed', type=float, metavar='X',
                        help='tempo, 0 to 2; 1 is as demonstrated. It is kept for later motions')
    parser.add_argument('--wait', type=float, default=120.0, metavar='S',
                        help='timeout for the server, and then for its robot [s] '
                             '(default %(default)g)')


def run(options: argparse.Namespace) -> int:
    """Execute; 0 if the goal was reached."""
    for name, value in (('--after', options.after), ('--wait', options.wait)):
        check_number(name, value, 0.0)
    from gdmp_ros.util.dds_network import default_environment
    os.environ.update(default_environment())
    with optional_import(ROS):
        from gdmp_ros.ros.clients.execute_client import execute, ExecuteRequest
    return execute(ExecuteRequest(
        options.server, str(options.load.absolute()) if options.load else '',
        options.goal_position, options.after, options.speed, options.wait))
