"""Execute the skill of a running trajectory server, and switch its goal on the way.

The server does the work; this only asks for it, as any client of its action and topics does.
Ctrl-C brings the motion to a smooth stop.

examples:
  gdmp execute
  gdmp execute --goal-position 0.5 -0.1 0.4 --after 1.5
  gdmp execute --load skill.json --speed 0.5 --server left/trajectory_server
"""
from __future__ import annotations

import argparse
import math
import os
from pathlib import Path

from gdmp_ros.errors import ParameterError
from gdmp_ros.util.optional_imports import optional_import, ROS

HELP = "execute a running server's skill, switch its goal"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('--server', default='trajectory_server', metavar='NODE',
                        help='with its namespace (default %(default)s)')
    parser.add_argument('--load', type=Path, metavar='SKILL', help='load this skill file first')
    parser.add_argument('--goal-position', type=float, nargs=3, metavar=('X', 'Y', 'Z'),
                        help='switch the goal of the position to here [m]')
    parser.add_argument('--after', type=float, default=1.0, metavar='S',
                        help='when the goal is switched, after the start (default %(default)g)')
    parser.add_argument('--speed', type=float, metavar='X', help='tempo, 0 to 2; 1 is as shown; '
                        'it stays for motions to come')
    parser.add_argument('--wait', type=float, default=120.0, metavar='S',
                        help='for the server, and then for its robot, at most '
                             '(default %(default)g)')


def run(options: argparse.Namespace) -> int:
    """Execute; 0 if the goal was reached."""
    for name, value in (('--after', options.after), ('--wait', options.wait)):
        if not (math.isfinite(value) and value >= 0.0):
            raise ParameterError(f'{name} is {value:g} s, expected 0 or more')
    from gdmp_ros.util.dds_network import default_environment
    os.environ.update(default_environment())
    with optional_import(ROS):
        from gdmp_ros.ros.clients import execute_client as executing
    wish = executing.Wish(options.server,
                          str(options.load.absolute()) if options.load else '',
                          options.goal_position, options.after, options.speed, options.wait)
    return executing.execute(wish)
