"""Simulation, server and recorder as processes, with somebody to operate them."""
from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
import os
from pathlib import Path
from typing import Any

from gdmp_ros.data.runs import REFERENCE_TOPIC, STATE_TOPIC
from gdmp_ros.util.processes import ChildProcesses


@contextmanager
def session(folder: Path, environment: Mapping[str, str], sim: Mapping[str, object],
            server: Mapping[str, object]) -> Iterator[tuple[Any, ChildProcesses]]:
    """
    Start both nodes and record ``folder/run`` until the block ends.

    :param environment: of a `gdmp_ros.util.dds_network.Domain`
    :param sim: parameters of ``panda_sim``
    :param server: parameters of ``trajectory_server``
    :returns: the operator and the processes
    :raises GdmpError: if something ends early or does not happen in time
    """
    os.environ.update(environment)  # before rclpy is loaded: this process joins the same domain
    from gdmp_ros.ros.clients.server_client import Operator
    print(f'starting simulation and server on DDS domain {environment["ROS_DOMAIN_ID"]}')
    with ChildProcesses(environment, folder / 'logs') as children:
        children.start_node('panda_sim', 'gdmp_ros.ros.arm.node', sim)
        children.start_node('trajectory_server', 'gdmp_ros.ros.server.node', {
            'measured_pose_topic': '/panda_sim/measured_pose', **server})
        operator = Operator(check=children.check)
        try:
            operator.wait_status('holding', 120.0)
            children.start('recorder', 'gdmp_ros.ros.recorder.record', [
                str(folder / 'run'), f'{REFERENCE_TOPIC}=gdmp_msgs/msg/Reference',
                f'{STATE_TOPIC}=gdmp_msgs/msg/RobotState'])
            log = children.log('recorder')
            operator.wait('the recorder', lambda: log.read_text().endswith('recording\n'), 30.0)
            yield operator, children
        finally:
            operator.close()
        children.stop('recorder', timeout=30.0)
