"""Make a model of an arm from its URDF: a file that all nodes and commands take as a model.

Kinematics, inertia, limits of position, speed and torque are those of the URDF; meshes are not
needed. What it does not say is assumed, and printed. Give a home posture of your work: the arm
begins there in the simulation, and its null space rests there.

examples:
  xacro ur.urdf.xacro ur_type:=ur5e name:=ur > robot.urdf
  gdmp arm model robot.urdf --tip tool0 --home 0 -1.57 1.57 -1.57 -1.57 0 -o robot.xml
  panda_sim --ros-args -p model:=robot.xml -p frame_id:=base_link
  gdmp arm model --topic /robot_description --tip tool0 --home 0 -1.57 1.57 -1.57 -1.57 0 -o ur.xml

With --topic the URDF is the one that the running driver of a robot publishes, with the calibration
of this arm. It is written beside the model, as ur.urdf.
"""
from __future__ import annotations

import argparse
import os
from pathlib import Path

from gdmp_ros.cli.arguments import add_output, check_output
from gdmp_ros.errors import ParameterError
from gdmp_ros.util.optional_imports import extra, optional_import, ROS
from gdmp_ros.util.terminal import table

#: A Jacobian with a smaller singular value is that of a posture near a singular one.
NEAR_SINGULAR = 0.05


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('urdf', type=Path, nargs='?', metavar='URDF',
                        help='description of the arm')
    parser.add_argument('--topic', metavar='TOPIC',
                        help='take the description that a driver publishes there instead')
    parser.add_argument('--tip', required=True, metavar='LINK', help='link that carries the tool')
    parser.add_argument('--home', required=True, type=float, nargs='+', metavar='RAD',
                        help='home posture, a number for each joint between base and tip')
    add_output(parser, 'MJCF', 'model to write')


def run(options: argparse.Namespace) -> None:
    """Read, complete, check, write."""
    check_output(options.output)
    if (options.urdf is None) == (options.topic is None):
        raise ParameterError('expected either a URDF or --topic, such as /robot_description')
    with optional_import(extra('sim')):
        import numpy as np

        from gdmp_ros.sim.arm import Arm
        from gdmp_ros.sim.urdf_model import model_of
    from gdmp_ros.util.files import write_text
    urdf = options.urdf or _received(options.topic, options.output.with_suffix('.urdf'))
    made = model_of(urdf, options.tip, np.array(options.home))
    arm = Arm(made.spec)
    limits, measured = arm.limits, arm.measure()
    lower, upper, speed = np.rad2deg([limits.lower, limits.upper, limits.fastest(np.inf)])
    table('joints', ['', 'from [°]', 'to [°]', 'speed [°/s]', 'torque [Nm]'], [
        [name, *(f'{value:.0f}' for value in values)]
        for name, *values in zip(arm.names, lower, upper, speed, limits.torque)])
    print(f'frame of the base: {made.root}; at home the tool is at '
          f'{" ".join(f"{value:.3f}" for value in measured.pose[:3])} m')
    for one in made.assumed:
        print(f'assumed: {one}')
    smallest = float(np.linalg.svd(measured.jacobian, compute_uv=False).min())
    if smallest < NEAR_SINGULAR:
        print(f'warning: the home posture is nearly singular (the smallest singular value of its '
              f'Jacobian is {smallest:.3f}): choose one of your work')
    write_text(options.output, made.spec.to_xml())
    print(f'wrote {options.output}')


def _received(topic: str, path: Path) -> Path:
    """File with the description that a driver publishes."""
    with optional_import(ROS):
        from gdmp_ros.ros.clients.arm_client import received_description
    from gdmp_ros.util.dds_network import default_environment
    from gdmp_ros.util.files import write_text
    check_output(path)
    os.environ.update(default_environment())
    write_text(path, received_description(topic))
    print(f'wrote {path}')
    return path
