"""Teach, see, change and run a skill in a browser.

The page shows the arm, takes, the path of a skill with its stiffness and with where other takes
would be. Drag the goal, the start and via points, and see the path change; run it on a simulated
arm and switch the goal while it moves; guide the arm by hand, record takes, and learn. Several
skills are compared. A run of gdmp demo is played back.

examples:
  gdmp studio                       teach the simulated Panda
  gdmp studio skill.json            change a skill, run it
  gdmp studio skill.json takes      with the takes it was learned from
  gdmp studio a.json b.json         compare skills
  gdmp studio sequence.yaml         run a sequence
  gdmp studio out/demo/run          look at a run
  gdmp studio skill.json --ros      use running nodes: ros2 launch gdmp_ros arm.launch.py
"""
from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import TYPE_CHECKING

from gdmp_ros.cli.arguments import add_arm_node, add_import, import_settings, integer
from gdmp_ros.util.optional_imports import extra, optional_import, ROS
from gdmp_ros.util.terminal import progress

if TYPE_CHECKING:
    from gdmp_ros.studio.robot import Robot


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('sources', type=Path, nargs='*', metavar='FILE|BAG|FOLDER',
                        help='skill files, sequence files, scene files, takes (rosbag2), folders '
                        'of takes, or a recorded run')
    parser.add_argument('--ros', action='store_true',
                        help='show and use running nodes instead of a simulation in this process')
    parser.add_argument('--server', default='trajectory_server', metavar='NODE',
                        help='with --ros: trajectory server (default %(default)s)')
    add_arm_node(parser)
    parser.add_argument('--takes', type=Path, default=Path('takes'), metavar='DIR',
                        help='folder for takes that are recorded (default %(default)s)')
    parser.add_argument('--model', default='', metavar='MODEL',
                        help='another arm: MJCF file, menagerie:NAME, robot_descriptions:NAME')
    parser.add_argument('--address', default='127.0.0.1',
                        help='of the page (default %(default)s: this machine only); with '
                             'another one a token is asked for')
    parser.add_argument('--port', type=integer(0, 65535), default=0, metavar='N',
                        help='port of the page (default: the first free one from 8080 on)')
    parser.add_argument('--no-browser', action='store_true', help='do not open a browser')
    add_import(parser, has_model=True)


def run(options: argparse.Namespace) -> None:
    """Open everything, then show the page until Ctrl-C."""
    with optional_import(extra('studio')):
        from gdmp_ros.studio.serve import free_port, serve, StudioSettings
        from gdmp_ros.studio.workbench import opened
    free_port(options.address, options.port)
    with progress('opening', len(options.sources)) as step:
        bench = opened(options.sources, step, import_settings(options))
    serve(bench, StudioSettings(options.address, options.port, options.model, options.takes,
                                not options.no_browser), lambda: _robot(options))


def _robot(options: argparse.Namespace) -> Robot:
    if not options.ros:
        from gdmp_ros.studio.simulated_robot import SimulatedRobot
        return SimulatedRobot(options.model)
    from gdmp_ros.util.dds_network import default_environment
    os.environ.update(default_environment())
    with optional_import(ROS):
        from gdmp_ros.studio.nodes_robot import NodesRobot
    return NodesRobot(options.server, options.node)
