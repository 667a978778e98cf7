"""Weigh the tool of an arm that takes joint positions: mass, centre, and bias of its sensor.

The recording has the arm at rest, for at least a second each, in five or more postures that turn
the tool: down, to the sides, forwards, up. Nothing may touch it. The result is a parameter file of
position_arm.

examples:
  ros2 bag record -o weighing /joint_states /force_torque_sensor_broadcaster/wrench
  gdmp arm tool weighing -o tool.yaml
  position_arm --ros-args --params-file tool.yaml
"""
from __future__ import annotations

import argparse
from pathlib import Path

from gdmp_ros.cli.arguments import add_output, check_output
from gdmp_ros.util.optional_imports import extra, optional_import
from gdmp_ros.util.terminal import table


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('bag', type=Path, metavar='BAG', help='recording of joints and wrench')
    add_output(parser, 'YAML', 'parameters to write')
    parser.add_argument('--model', default='ur5e', metavar='MODEL',
                        help='of the arm, as for position_arm (default %(default)s)')
    parser.add_argument('--tool-site', default='tcp', metavar='NAME',
                        help='site that is controlled (default %(default)s)')
    parser.add_argument('--sensor-site', default='flange', metavar='NAME',
                        help='site with the frame of the sensor (default %(default)s)')
    parser.add_argument('--joints-topic', default='/joint_states', metavar='TOPIC',
                        help='JointState (default %(default)s)')
    parser.add_argument('--wrench-topic', default='/force_torque_sensor_broadcaster/wrench',
                        metavar='TOPIC', help='WrenchStamped (default %(default)s)')


def run(options: argparse.Namespace) -> None:
    """Read, solve, write."""
    check_output(options.output)
    with optional_import(extra('sim')):
        from gdmp_ros.sim.arm import Arm
        from gdmp_ros.sim.tool_weight import weigh
    from gdmp_ros.util.files import write_text
    arm = Arm(options.model, options.tool_site)
    found = weigh(options.bag, arm, Arm(options.model, options.sensor_site).end_pose,
                  options.joints_topic, options.wrench_topic)
    center, bias = found.center.round(5).tolist(), found.bias.round(4).tolist()
    write_text(options.output, '/**/position_arm:\n  ros__parameters:\n'
               f'    payload_mass: {found.mass:.5f}\n    payload_center: {center}\n'
               f'    sensor_bias: {bias}\n')
    table(f'what hangs at the sensor, from {found.postures} postures', ['', 'value'], [
        ['mass [kg]', f'{found.mass:.3f}'], ['centre from the tool [m]', str(center)],
        ['bias of the sensor [N, Nm]', str(bias)],
        ['left unexplained [N], [Nm]', f'{found.force:.2f}, {found.torque:.3f}']])
    print(f'wrote {options.output}: position_arm --ros-args --params-file {options.output}')
