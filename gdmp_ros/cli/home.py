"""Move the joints of a running arm to its home posture, or to another one.

All joints move together, from rest to rest, in a straight line of joint space. It is refused if a
link would come too near to what the arm knows of its surroundings (docs/obstacles.md). No motion
may be executed meanwhile.

examples:
  gdmp home
  gdmp home --node franka_arm --joint-speed 0.2
  gdmp home 0 -0.785 0 -2.356 0 1.571 0.785
"""
from __future__ import annotations

import argparse
import os

from gdmp_ros.cli.arguments import add_arm_node, number
from gdmp_ros.util.optional_imports import optional_import, ROS


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('position', type=float, nargs='*', metavar='RAD',
                        help='posture, one number for each joint (default: home)')
    add_arm_node(parser)
    parser.add_argument('--joint-speed', type=number(above=0.0), default=0.5, metavar='RAD/S',
                        help='largest speed of a joint [rad/s] (default %(default)g)')


def run(options: argparse.Namespace) -> None:
    """Move."""
    from gdmp_ros.util.dds_network import default_environment
    os.environ.update(default_environment())
    with optional_import(ROS):
        from gdmp_ros.ros.clients.arm_client import move_joints
        from gdmp_ros.ros.clients.server_client import Client
    client = Client('joints_client')
    try:
        move_joints(client, options.node, options.position, options.joint_speed)
    finally:
        client.close()
    print(f'{options.node} has arrived')
