"""Start an arm, a trajectory server and a recorder of takes, until Ctrl-C.

The nodes are in your own DDS domain, so that every other command and program finds them. With an
installation of ROS, ros2 launch gdmp_ros arm.launch.py does the same and more.

examples:
  gdmp up skill.json
  gdmp up skill.json --gripper --window
  gdmp up skill.json --scene scene.yaml
  gdmp up skill.json --arm franka --host 172.16.0.2 --friction friction.yaml
  then, in another terminal:
  gdmp run --goal-position 0.5 0 0.4
  gdmp studio skill.json --ros
"""
from __future__ import annotations

import argparse
from pathlib import Path

from gdmp_ros.cli.arguments import add_arm, arm_choice
from gdmp_ros.errors import DataError, ParameterError
from gdmp_ros.util.optional_imports import optional_import, ROS


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('skill', type=Path, nargs='?', metavar='SKILL',
                        help='skill file that the server loads')
    add_arm(parser)
    parser.add_argument('--takes', type=Path, default=Path('takes'), metavar='DIR',
                        help='folder of the recorder (default %(default)s)')
    parser.add_argument('--model', default='', metavar='MODEL',
                        help='another simulated arm: MJCF file, menagerie:NAME, '
                             'robot_descriptions:NAME')
    parser.add_argument('--gripper', action='store_true', help='the arm has a gripper')
    parser.add_argument('--window', action='store_true', help='show the window of the simulation')
    parser.add_argument('--scene', type=Path, metavar='FILE',
                        help='what stands around the arm (docs/obstacles.md)')
    parser.add_argument('--logs', type=Path, metavar='DIR',
                        help="folder for the nodes' output (default: a temporary one)")


def run(options: argparse.Namespace) -> None:
    """Check the skill, start the nodes, wait."""
    if options.skill is not None and not options.skill.is_file():
        raise DataError(f'{options.skill}: there is no such skill file')
    if options.arm != 'sim' and (options.model or options.window):
        raise ParameterError('--model and --window are for the simulated arm')
    if options.scene is not None:
        from gdmp_ros.scene import read_scene
        read_scene(options.scene)
    arm = arm_choice(options)
    with optional_import(ROS):
        from gdmp_ros.ros.clients.testbed import Bringup, up
    up(Bringup(options.skill, options.takes, arm, options.model, options.gripper,
               options.window, options.logs, options.scene))
