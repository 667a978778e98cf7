"""Measure the friction of an arm's joints, and write it as parameters.

Each joint of the running arm moves slowly by 0.15 rad to both sides, at three speeds. There must
be room for it, and nothing may stream references. It takes about two and a half minutes. Ctrl-C
ends it; the arm then holds.

examples:
  gdmp identify-friction -o friction.yaml
  panda_sim --ros-args --params-file friction.yaml
  gdmp identify-friction --arm left/panda_sim -o left.yaml
"""
from __future__ import annotations

import argparse
import os
from pathlib import Path

from gdmp_ros.errors import DataError
from gdmp_ros.util.optional_imports import optional_import, ROS
from gdmp_ros.util.terminal import table


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('-o', '--output', type=Path, required=True, metavar='YAML',
                        help='parameters to write')
    parser.add_argument('--arm', default='panda_sim', metavar='NODE',
                        help='with its namespace (default %(default)s)')
    parser.add_argument('--set', action='store_true', help='set them in the running node, too')


def run(options: argparse.Namespace) -> None:
    """Measure, write, set."""
    folder = options.output.absolute().parent
    if not (folder.is_dir() and os.access(folder, os.W_OK)):
        raise DataError(f'{options.output}: cannot be written: {folder} is no folder that may be '
                        'written to')
    from gdmp_ros.util.dds_network import default_environment
    os.environ.update(default_environment())
    with optional_import(ROS):
        from gdmp_ros.ros.clients.friction_client import identify
    found = identify(options.arm, options.output, options.set)
    table('friction', ['joint', 'viscous [Nm s/rad]', 'dry [Nm]'],
          [[number, f'{viscous:.3f}', f'{dry:.3f}']
           for number, (viscous, dry) in enumerate(zip(found['viscous'], found['dry']), 1)])
    print(f'wrote {options.output}: --ros-args --params-file {options.output}'
          + ('; the node uses it now' if options.set else ''))
