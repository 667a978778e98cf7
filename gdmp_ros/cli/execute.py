"""Execute the skill of a running trajectory server, and switch its goal during the motion.

This is a client of the server's action and topics. Ctrl-C brings the motion to a smooth stop.

examples:
  gdmp execute
  gdmp execute --goal-position 0.5 -0.1 0.4 --after 1.5
  gdmp execute --load skill.json --speed 0.5 --server left/trajectory_server
  gdmp execute --load wipe.json --cycles 5
  gdmp execute --load skill.json --context height=0.03
  gdmp execute --sequence sequence.yaml --first-step 2
"""
from __future__ import annotations

import argparse
import os
from pathlib import Path

from gdmp_ros.cli.arguments import add_context, check_number
from gdmp_ros.util.optional_imports import optional_import, ROS


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('--server', default='trajectory_server', metavar='NODE',
                        help='with its namespace (default %(default)s)')
    parser.add_argument('--load', type=Path, metavar='SKILL', help='load this skill file first')
    parser.add_argument('--cycles', type=float, default=0.0, metavar='N',
                        help='of a rhythmic skill, which then ends at the centre of its cycle '
                             '(default: until its amplitude is set to 0, or Ctrl-C)')
    parser.add_argument('--sequence', type=Path, metavar='YAML',
                        help='execute a sequence file instead of a skill')
    parser.add_argument('--first-step', type=int, default=1, metavar='N',
                        help='begin with this step of the sequence (default %(default)s)')
    add_context(parser)
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
    for name, value in (('--after', options.after), ('--wait', options.wait),
                        ('--cycles', options.cycles), ('--first-step', options.first_step - 1)):
        check_number(name, value, 0.0)
    from gdmp_ros.util.dds_network import default_environment
    os.environ.update(default_environment())
    with optional_import(ROS):
        from gdmp_ros.ros.clients.execute_client import execute, ExecuteRequest
    return execute(ExecuteRequest(
        options.server, str(options.load.absolute()) if options.load else '',
        options.goal_position, options.after, options.speed, options.wait, options.cycles,
        str(options.sequence.absolute()) if options.sequence else '', options.first_step,
        options.context))
