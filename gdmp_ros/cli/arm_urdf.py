"""Write the URDF of an arm, for robot_state_publisher, RViz and other tools that do not read MJCF.

Frames, inertial parameters, limits and simple shapes are those of the model; a mesh becomes its
bounding box. A running panda_sim publishes the same on robot_description.

examples:
  gdmp arm urdf -o panda.urdf
  gdmp arm urdf menagerie:franka_fr3 --frame fr3_link0 -o fr3.urdf
"""
from __future__ import annotations

import argparse

from gdmp_ros.cli.arguments import add_output, check_output
from gdmp_ros.util.optional_imports import extra, optional_import


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('model', nargs='?', default='', metavar='MODEL',
                        help='MJCF file, menagerie:NAME or robot_descriptions:NAME; the built-in '
                             'Panda by default')
    add_output(parser, 'URDF', 'default: the terminal', required=False)
    parser.add_argument('--frame', default='panda_link0', metavar='NAME',
                        help='name of the base link (default %(default)s)')
    parser.add_argument('--tool-site', default='tcp', metavar='NAME',
                        help='site that is controlled (default %(default)s)')


def run(options: argparse.Namespace) -> None:
    """Load the model and write it."""
    check_output(options.output)
    with optional_import(extra('sim')):
        from gdmp_ros.sim.arm import Arm
        from gdmp_ros.sim.urdf import urdf
    text = urdf(Arm(options.model, options.tool_site), options.frame)
    if options.output is None:
        print(text, end='')
        return
    from gdmp_ros.util.files import write_text
    write_text(options.output, text)
    print(f'wrote {options.output}')
