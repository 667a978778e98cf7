"""Clients of an arm: move its joints to a posture, measure the friction of its joints."""
from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
import json
from pathlib import Path
import sys
from tempfile import TemporaryDirectory
from typing import Any

from gdmp_msgs.srv import MoveJoints
import numpy as np
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter
from std_srvs.srv import SetBool, Trigger

from gdmp_ros.control.identification import FrictionIdentification
from gdmp_ros.errors import GdmpError
from gdmp_ros.ros.arm_choice import ArmChoice
from gdmp_ros.ros.clients.server_client import Client
from gdmp_ros.ros.clients.testbed import NodeTestbed
from gdmp_ros.sim.arm import Arm
from gdmp_ros.util.dds_network import Domain
from gdmp_ros.util.files import write_text
from gdmp_ros.util.terminal import progress

#: Longest time for a motion; a simulation may run slower than real time [s].
LONGEST_MOTION_S = 300.0
#: Time between two lines of progress [s].
SHOW_S = 2.0
#: Longest time for the motions; a simulation may run slower than real time [s].
LONGEST_IDENTIFICATION_S = 1800.0


def move_joints(client: Client, arm: str, position: Sequence[float] = (), speed: float = 0.0,
                via: np.ndarray | None = None) -> None:
    """
    Move the joints of an arm to a posture, and wait until they are there; Ctrl-C stops them.

    :param arm: name of its node
    :param position: [rad]; empty: its home posture
    :param speed: largest speed of a joint [rad/s]; 0: the default of the arm
    :param via: postures on the way [rad], shape ``(T, n)``; by default straight
    :raises GdmpError: if the arm refuses, or does not arrive
    """
    service = client.service(MoveJoints, f'{arm}/move_joints')
    reply = service.call_async(MoveJoints.Request(
        position=[*map(float, position)], speed=speed,
        via=[] if via is None else via.reshape(-1).tolist()))
    try:
        _wait(client, arm, service, reply)
    except (KeyboardInterrupt, GdmpError):
        with suppress(GdmpError):  # the arm may be gone
            client.call(Trigger, f'{arm}/stop')
        raise
    result = reply.result()
    if not result.success:
        raise GdmpError(f'{arm}: {result.message}')


def _wait(client: Client, arm: str, service: Any, reply: Any) -> None:
    """:raises GdmpError: if the arm is gone, or takes too long"""
    begun = reported = client.now()
    while not reply.done():
        client.spend(0.1)
        now = client.now()
        if now - begun > LONGEST_MOTION_S:
            raise GdmpError(f'waited {LONGEST_MOTION_S:g} s for the motion, without success')
        if now - reported > SHOW_S:
            reported = now
            if not service.service_is_ready():
                raise GdmpError(f'{arm} has ended, or was cleaned up, while its joints moved')
            print(f'{arm}: moving, {now - begun:.0f} s', file=sys.stderr, flush=True)


def identify(arm: str, output: Path, use: bool) -> dict[str, list[float]]:
    """
    Let an arm measure its friction, and write parameters.

    :param arm: name of its node
    :param use: set them in the node too
    :returns: numbers of each joint, by name
    :raises GdmpError: if the arm refuses, or the motions are ended
    """
    client = Client('friction_client')
    try:
        result = _measure(client, arm)
        _write(output, arm, result)
        if use:
            _set(client, arm, result)
    finally:
        client.close()
    return result


def identify_alone(arm: ArmChoice, output: Path) -> dict[str, list[float]]:
    """
    Start an arm, move it to its home posture, and let it measure its friction.

    :returns: numbers of each joint, by name
    :raises GdmpError: if the arm refuses, or the motions are ended
    """
    with (TemporaryDirectory() as name, Domain() as domain, arm.robot(Path(name)),
          NodeTestbed(Path(name), domain.environment(), arm) as bed):
        bed.start_arm()
        move_joints(bed.client, arm.node)
        result = _measure(bed.client, arm.node)
    _write(output, arm.node, result)
    return result


def _write(output: Path, arm: str, result: dict[str, list[float]]) -> None:
    name = arm.rpartition('/')[2]
    lines = '\n'.join(f'    friction_{key}: {values}' for key, values in result.items())
    write_text(output, f'/**/{name}:\n  ros__parameters:\n{lines}\n')


def _measure(client: Client, arm: str) -> dict[str, list[float]]:
    service = client.service(SetBool, f'{arm}/identify_friction')
    reply = service.call_async(SetBool.Request(data=True))
    model = Arm()
    plan = FrictionIdentification(model.limits)
    plan.begin(model.measure().position)
    expected = round(plan.seconds)
    begun = reported = client.now()
    try:
        with progress('moving each joint slowly', expected) as step:
            while not reply.done():
                client.spend(0.2)
                if client.now() - reported >= 1.0 and reported - begun < expected:
                    reported += 1.0
                    step()
                if client.now() - begun > LONGEST_IDENTIFICATION_S:
                    raise GdmpError(f'waited {LONGEST_IDENTIFICATION_S:g} s for the motions, '
                                    'without success')
    except BaseException:
        service.call_async(SetBool.Request(data=False))
        client.spend(0.5)
        raise
    result = reply.result()
    if not result.success:
        raise GdmpError(f'{arm}: {result.message}')
    friction: dict[str, list[float]] = json.loads(result.message)
    return friction


def _set(client: Client, arm: str, result: dict[str, list[float]]) -> None:
    changes: list[ParameterMessage] = [
        Parameter(f'friction_{key}', value=values).to_parameter_msg()
        for key, values in result.items()]
    reply: Any = client.call(SetParametersAtomically, f'{arm}/set_parameters_atomically',
                             parameters=changes)
    if not reply.result.successful:
        raise GdmpError(f'{arm}: {reply.result.reason}')
