"""Everything end to end on a simulated Panda: bags, learning, streaming, a goal switch, a report.

Runs the trajectory server and the arm as processes in their own DDS domain, executes the
skill, switches the goal (pose and stiffness) during the motion, records references and robot state
in an MCAP bag, and writes report.json and pictures.

With --arm franka the same on a Franka Research 3, which first moves to its home posture: there
must be room for it. It was tried over the protocol of the robot, not on hardware.

With --arm ur5e an arm that takes joint positions executes the same, with an admittance: a
simulated one, behind the topics of ros2_control. A hand shows the tasks to one with torques.

examples:
  gdmp demo --out out/demo
  gdmp demo --task pick --out out/pick
  gdmp demo --task clutter --out out/clutter
  gdmp demo --task joints --out out/joints
  gdmp demo --task objects --out out/objects
  gdmp demo --task wipe --out out/wipe
  gdmp demo --task tray --out out/tray
  gdmp demo --arm ur5e --out out/ur5e
  gdmp demo --arm ur5e --task wipe --out out/ur5e-wipe
  gdmp demo --arm franka --protocol-server --out out/franka
  gdmp demo --arm franka --protocol-server --task wipe --out out/franka-wipe
  gdmp demo --arm franka --host 172.16.0.2 --friction friction.yaml --out out/franka
"""
from __future__ import annotations

import argparse
from pathlib import Path

from gdmp_ros.choices import TASKS
from gdmp_ros.cli.arguments import add_arm, arm_choice
from gdmp_ros.util.optional_imports import extra, optional_import, ROS


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('-o', '--out', '--output', type=Path, default=Path('out/demo'),
                        metavar='DIR',
                        help='folder for report, bag and pictures (default %(default)s)')
    parser.add_argument('--class', dest='name', default='GShape', metavar='CLASS',
                        help='LASA class to demonstrate (default %(default)s)')
    parser.add_argument('--task', choices=TASKS, default=TASKS[0],
                        help='letter; pick: a cube, from a box to another, with the gripper; '
                             'clutter: the same through three objects, one of which is '
                             'pushed into the way; '
                             'joints: a skill of the joints, whose goal is switched by a pose; '
                             'objects: shown once, done where a camera sees box and hole, also '
                             'while the hole moves; '
                             'wipe: a table that is higher or lower than the one shown; '
                             'tray: two arms, coupled, carry a tray with a ball (without ROS) '
                             '(default %(default)s)')
    add_arm(parser)


def run(options: argparse.Namespace) -> int:
    """Run the demonstration; 0 if everything holds."""
    if options.task == 'tray':
        with optional_import(extra('sim')):
            from gdmp_ros.demo.tray import run_tray
        return run_tray(options.out)
    with optional_import(ROS):
        from gdmp_ros.demo.run import run_demo
        from gdmp_ros.demo.tasks import run_task
        arm = arm_choice(options)
    if options.task != TASKS[0]:
        return run_task(options.task, options.out, arm)
    return run_demo(options.out, options.name, arm)
