"""Record takes of a motion: guide an arm by hand, keep the good ones.

Without more, it starts the simulated arm and a recorder of takes, and a scripted hand guides the
tool along handwriting of people (a different stroke in every take). With --arm franka
--protocol-server it guides the arm behind the protocol of a Franka.

With --by-hand, --host or --node you guide the arm yourself, and say with keys what happens
(a foot switch that sends these keys does as well):

  Enter  start a take; stop and keep it          f  free the arm to be guided; hold it
  p      pause the take; go on with it           h  move the joints to the home posture
  d      discard the take, or else the last one  o  open the gripper
  r      recover the arm from a fault            c  close the gripper
  q      end the session; the arm holds

The simulated arm is dragged with the mouse in its window (double-click the hand, then Ctrl and the
right button), or with the marker in RViz (~/hand_pose).

examples:
  gdmp record -o takes                        four takes of GShape by a scripted hand
  gdmp record -o takes --letter Angle --count 6
  gdmp record -o takes --by-hand              your own takes
  gdmp record -o takes --arm franka --host 172.16.0.2 --friction friction.yaml --gripper
  gdmp record -o takes --node left/my_arm     on an arm that runs already
  gdmp record -o takes --by-hand --transforms between objects that /tf knows
  gdmp takes takes --plot takes.png           compare them, drop outliers
  gdmp learn takes -o skill.json              pose and stiffness from all
"""
from __future__ import annotations

import argparse
import os

from gdmp_ros.cli.arguments import add_arm, add_bag_output, add_output, arm_choice, integer
from gdmp_ros.errors import DataError, ParameterError
from gdmp_ros.util.optional_imports import optional_import, ROS


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_output(parser, 'DIR', 'folder for the takes; new ones are added to it')
    add_arm(parser)
    parser.add_argument('--node', default='', metavar='NAME',
                        help='an arm that runs already, with its namespace, instead of --arm')
    parser.add_argument('--model', default='', metavar='MODEL',
                        help='another simulated arm: ur5e, xarm7, MJCF file, menagerie:NAME, '
                             'robot_descriptions:NAME')
    parser.add_argument('--by-hand', action='store_true',
                        help='you guide the simulated arm; a robot is always guided by you')
    parser.add_argument('--no-window', action='store_true',
                        help='with --by-hand: no window of the simulation, only ~/hand_pose')
    parser.add_argument('--gripper', action='store_true',
                        help='you guide an arm with a gripper; its commands become part of the '
                             'skill')
    parser.add_argument('--transforms', action='store_true',
                        help='record /tf and /tf_static, too: where objects are (gdmp learn '
                             '--frames)')
    parser.add_argument('--letter', default='GShape', metavar='CLASS',
                        help='class of the LASA data set that the scripted hand writes '
                             '(default %(default)s)')
    parser.add_argument('--count', type=integer(1, 7), default=4, metavar='N',
                        help='number of takes of the scripted hand, 1 to 7 (default %(default)s)')
    add_bag_output(parser)


def run(options: argparse.Namespace) -> None:
    """Start everything, teach, stop everything."""
    if options.node and (options.arm != 'sim' or options.host or options.protocol_server
                         or options.friction):
        raise ParameterError('--node is an arm that runs already: leave --arm, --host, '
                             '--protocol-server and --friction out')
    arm = arm_choice(options)
    if options.model and (options.node or arm.kind != 'sim'):
        raise ParameterError('--model is a simulated arm: leave --node and --arm out')
    by_hand = options.by_hand or bool(options.node or arm.host)
    window = by_hand and arm.kind == 'sim' and not (options.node or options.no_window)
    if window and not (os.environ.get('DISPLAY') or os.environ.get('WAYLAND_DISPLAY')):
        raise DataError('there is no display for the window of the simulation: with --no-window '
                        'the arm follows ~/hand_pose, as of the marker in RViz')
    from gdmp_ros.data import lasa
    demos = [] if by_hand else lasa.robot_demonstrations(options.letter)[:options.count]
    with optional_import(ROS):
        from gdmp_ros.ros.clients.teaching import teach, TeachingSettings
    teach(TeachingSettings(options.output, options.storage, options.frame, arm, options.node,
                           window, by_hand and options.gripper, options.transforms,
                           options.model), demos)
