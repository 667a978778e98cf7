"""Record takes of a motion: guide a simulated arm by hand, keep the good ones.

Starts the simulation with a gravity-compensated arm and a recorder of takes. A scripted hand
guides the tool along handwriting of people (a different stroke in every take). With --by-hand you
guide it: drag the tool with the mouse in the window of the simulation (double-click the hand, then
Ctrl and the right button), or move the marker in RViz (~/hand_pose).

examples:
  gdmp record -o takes                        four takes of GShape by a scripted hand
  gdmp record -o takes --letter Angle --count 6
  gdmp record -o takes --by-hand              your own takes
  gdmp takes takes --plot takes.png           compare them, drop outliers
  gdmp learn takes -o skill.json              pose and stiffness from all
"""
from __future__ import annotations

import argparse
import os

from gdmp_ros.cli.arguments import add_bag_output, add_output, integer
from gdmp_ros.errors import DataError
from gdmp_ros.util.optional_imports import optional_import, ROS


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_output(parser, 'DIR', 'folder for the takes; new ones are added to it')
    parser.add_argument('--by-hand', action='store_true', help='you guide the arm')
    parser.add_argument('--no-window', action='store_true',
                        help='with --by-hand: no window of the simulation, only ~/hand_pose')
    parser.add_argument('--gripper', action='store_true',
                        help='with --by-hand: the arm has a gripper; its commands become part of '
                             'the skill')
    parser.add_argument('--letter', default='GShape', metavar='CLASS',
                        help='class of the LASA data set that the scripted hand writes '
                             '(default %(default)s)')
    parser.add_argument('--count', type=integer(1, 7), default=4, metavar='N',
                        help='number of takes of the scripted hand, 1 to 7 (default %(default)s)')
    add_bag_output(parser)


def run(options: argparse.Namespace) -> None:
    """Start everything, teach, stop everything."""
    window = options.by_hand and not options.no_window
    if window and not (os.environ.get('DISPLAY') or os.environ.get('WAYLAND_DISPLAY')):
        raise DataError('there is no display for the window of the simulation: with --no-window '
                        'the arm follows ~/hand_pose, as of the marker in RViz')
    from gdmp_ros.data import lasa
    demos = [] if options.by_hand else lasa.robot_demonstrations(options.letter)[:options.count]
    with optional_import(ROS):
        from gdmp_ros.ros.clients.teaching import teach, TeachingSettings
    teach(TeachingSettings(options.output, options.storage, options.frame,
                           window,
                           options.by_hand and options.gripper), demos)
