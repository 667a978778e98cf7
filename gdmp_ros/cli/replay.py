"""Send the references of a recorded run to an arm again, in the recorded rhythm, with new stamps.

The arm keeps its rule: it follows only if the recorded motion begins near the robot. Bring it
there first (gdmp home, ~/reset_world, or hand guiding), or call the service ~/arm of the arm: it
then moves to the beginning with 0.25 m/s. The trajectory server must not publish meanwhile.
Ctrl-C stops the arm smoothly.

examples:
  gdmp replay out/demo/run
  gdmp replay run --arm franka_arm
  gdmp replay run --topic /left/trajectory_server/reference --arm left/panda_sim
"""
from __future__ import annotations

import argparse
import os
from pathlib import Path

from gdmp_ros.cli.arguments import add_arm_node, check_number
from gdmp_ros.util.optional_imports import optional_import, ROS


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('bag', type=Path, metavar='BAG', help='rosbag2 folder')
    parser.add_argument('--topic', default='', metavar='TOPIC',
                        help='of the references in the bag (default: the only one)')
    parser.add_argument('--to', default='', metavar='TOPIC',
                        help='on which they are sent (default: as recorded)')
    add_arm_node(parser)
    parser.add_argument('--wait', type=float, default=30.0, metavar='S',
                        help='timeout for the arm [s] (default %(default)g)')


def run(options: argparse.Namespace) -> None:
    """Replay."""
    check_number('--wait', options.wait, 0.0)
    from gdmp_ros.data.runs import read_references
    from gdmp_ros.util.dds_network import default_environment
    references = read_references(options.bag, options.topic)
    os.environ.update(default_environment())
    with optional_import(ROS):
        from gdmp_ros.ros.clients.replay import replay, ReplayRequest
    replay(references, ReplayRequest(options.to or references.topic, options.arm, options.wait))
    print(f'replayed {len(references.times)} references in {references.times[-1]:.1f} s')
