"""Several nodes in one process; they share one interpreter."""
from __future__ import annotations

import argparse
from collections.abc import Callable

from gdmp_ros.ros.adapter import Adapter
from gdmp_ros.ros.arm import simulated_arm
from gdmp_ros.ros.lifecycle import ManagedNode
from gdmp_ros.ros.recorder.node import TakeRecorder
from gdmp_ros.ros.running import own_arguments, run
from gdmp_ros.ros.server.node import TrajectoryServer
from gdmp_ros.ros.visualizer.node import Visualizer


def _franka_arm() -> ManagedNode:
    # libfranka is an extra.
    from gdmp_ros.ros.arm import franka_arm
    return franka_arm.node()


NODES: dict[str, Callable[[], ManagedNode]] = {
    'trajectory_server': TrajectoryServer, 'panda_sim': simulated_arm.node,
    'visualizer': Visualizer, 'franka_arm': _franka_arm, 'take_recorder': TakeRecorder,
    'adapter': Adapter}


def main(arguments: list[str] | None = None) -> int:
    """Run the named nodes."""
    parser = argparse.ArgumentParser(
        prog='composed', description=__doc__,
        epilog='Parameters follow --ros-args, each after the name of its node: '
               '-p trajectory_server:skill:=skill.json. The server has the smallest lateness in '
               'its own process.')
    parser.add_argument('nodes', nargs='+', choices=NODES, metavar='NODE',
                        help=f'one of {", ".join(NODES)}; each once')
    names = parser.parse_args(own_arguments(arguments)).nodes
    if len(set(names)) < len(names):
        parser.error(f'every node must occur once, got {" ".join(names)}')
    if 'franka_arm' in names and len(names) > 1:
        parser.error('franka_arm needs a process of its own: libfranka keeps the interpreter '
                     'while it waits for the robot, and all other nodes would wait too')
    return run([NODES[name] for name in names], arguments)


if __name__ == '__main__':
    raise SystemExit(main())
