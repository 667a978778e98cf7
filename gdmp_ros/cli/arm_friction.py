"""Measure the friction of an arm's joints and weight that its model lacks, as parameters.

Each joint of the running arm moves slowly by 0.15 rad to both sides, at three speeds. There must
be room for it, and nothing may stream references. It takes about two and a half minutes. Ctrl-C
ends it; the arm then holds. A payload that was not announced (~/set_payload) counts as weight of
the arm: begin with an empty hand.

With --arm sim, or --arm franka and --host, it starts the node itself, and moves to the home
posture first.

examples:
  gdmp arm friction -o friction.yaml
  panda_sim --ros-args --params-file friction.yaml
  gdmp arm friction --node left/panda_sim -o left.yaml
  gdmp arm friction --arm franka --host 172.16.0.2 -o friction.yaml
"""
from __future__ import annotations

import argparse
import math
import os

from gdmp_ros.choices import TORQUE_ARMS
from gdmp_ros.cli.arguments import (
    add_arm_node,
    add_franka,
    add_output,
    add_parameter_files,
    arm_choice,
)
from gdmp_ros.errors import DataError, ParameterError
from gdmp_ros.util.optional_imports import optional_import, ROS
from gdmp_ros.util.terminal import table


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_output(parser, 'YAML', 'parameters to write')
    add_arm_node(parser)
    parser.add_argument('--arm', choices=TORQUE_ARMS,
                        help='start this arm, instead of using a node')
    add_franka(parser)
    add_parameter_files(parser)
    parser.add_argument('--set', action='store_true', help='set them in the running node, too')


def run(options: argparse.Namespace) -> None:
    """Measure, write, set."""
    folder = options.output.absolute().parent
    if not (folder.is_dir() and os.access(folder, os.W_OK)):
        raise DataError(f'{options.output}: cannot be written: {folder} is no folder that may be '
                        'written to')
    with optional_import(ROS):
        from gdmp_ros.ros.clients.arm_client import identify, identify_alone
    if options.arm:
        result = identify_alone(arm_choice(options), options.output)
    elif options.host or options.protocol_server or options.friction:
        raise ParameterError('--host, --protocol-server and --friction need --arm')
    else:
        from gdmp_ros.util.dds_network import default_environment
        os.environ.update(default_environment())
        result = identify(options.node, options.output, options.set)
    moments = iter(result['weight_moments'])
    rows = zip(result['friction_viscous'], result['friction_dry'], zip(moments, moments, moments))
    table('friction, and weight that the model lacks',
          ['joint', 'viscous [Nm s/rad]', 'dry [Nm]', 'moment of weight [Nm]'],
          [[number, f'{viscous:.3f}', f'{dry:.3f}', f'{math.hypot(*moment):.3f}']
           for number, (viscous, dry, moment) in enumerate(rows, 1)])
    print(f'wrote {options.output}: --ros-args --params-file {options.output}'
          + ('; the node uses it now' if options.set else ''))
