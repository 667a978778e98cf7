"""Teach a simulated arm: lead it by hand, record takes, keep the good ones.

Starts the simulation with a weightless arm and a recorder of takes. A scripted hand leads the tool
along handwriting that people have shown (a different stroke in every take), or you do it yourself:
with --by-hand, dragging the tool with the mouse in the simulation's window (double-click the hand,
then Ctrl and the right button), or the marker in RViz (~/hand_pose).

examples:
  gdmp teach -o takes                         four takes of GShape by a scripted hand
  gdmp teach -o takes --letter Angle --takes 6
  gdmp teach -o takes --by-hand               your own
  gdmp takes takes --plot takes.png           compare them, drop the bad one
  gdmp learn takes -o skill.json              pose and stiffness from all
"""
from __future__ import annotations

import argparse
from pathlib import Path

from gdmp_ros.data import lasa
from gdmp_ros.data.bags import STORAGES
from gdmp_ros.errors import DataError
from gdmp_ros.util.optional_imports import optional_import, ROS

HELP = 'lead a simulated arm by hand and record takes'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('-o', '--output', type=Path, required=True, metavar='DIR',
                        help='folder for the takes; new ones are added to it')
    parser.add_argument('--by-hand', action='store_true', help='you lead the arm')
    parser.add_argument('--no-window', action='store_true',
                        help='with --by-hand: no window of the simulation, only ~/hand_pose')
    parser.add_argument('--letter', default='GShape', metavar='CLASS',
                        help='what the scripted hand writes, a class of the LASA data set '
                             '(default %(default)s)')
    parser.add_argument('--takes', type=int, default=4, metavar='N',
                        help='how many takes the scripted hand shows, 1 to 7 (default '
                             '%(default)s)')
    parser.add_argument('--storage', choices=sorted(STORAGES), default='mcap')
    parser.add_argument('--frame', default='panda_link0', help='frame_id of the poses')


def run(options: argparse.Namespace) -> None:
    """Start everything, teach, stop everything."""
    if not 1 <= options.takes <= 7:
        raise DataError(f'--takes is {options.takes}, expected 1 to 7: there are seven strokes')
    shown = [] if options.by_hand else lasa.robot_demonstrations(options.letter)[:options.takes]
    with optional_import(ROS):
        from gdmp_ros.ros.clients import teaching
    teaching.run(teaching.Setting(options.output, options.storage, options.frame,
                                  options.by_hand and not options.no_window), shown)
