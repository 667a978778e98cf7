"""Clients of an arm: move its joints, measure their friction, receive its description."""
from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
import sys
from tempfile import TemporaryDirectory
from typing import Any

from gdmp_msgs.action import IdentifyFriction, MoveJoints
import numpy as np
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter
from std_msgs.msg import String

from gdmp_ros.errors import GdmpError
from gdmp_ros.ros.arm_choice import ArmChoice
from gdmp_ros.ros.clients.server_client import Client, START_UP_S
from gdmp_ros.ros.clients.testbed import NodeTestbed
from gdmp_ros.util.dds_network import Domain
from gdmp_ros.util.files import write_text

#: Longest time for an answer [s].
ANSWER_S = 10.0
#: Time between two lines of progress [s].
SHOW_S = 2.0


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
    goal = MoveJoints.Goal(position=[*map(float, position)], speed=speed,
                           via=[] if via is None else via.reshape(-1).tolist())
    _make(client, MoveJoints, f'{arm}/move_joints', goal)


def _make(client: Client, kind: Any, name: str, goal: Any) -> Any:
    """
    Let an arm make motions of its joints; Ctrl-C stops them.

    :returns: result of the action
    :raises GdmpError: if the arm refuses, is gone, or does not arrive
    """
    feedback: list[Any] = []
    action = client.action(kind, name)
    sent = client.send(action, goal, ANSWER_S, feedback.append)
    reported = client.now()
    try:
        sent.accepted(START_UP_S)  # its node may still compile
        while not sent.done():
            client.spend(0.1)
            if client.now() - reported > SHOW_S:
                reported = client.now()
                if not action.server_is_ready():
                    raise GdmpError(f'{name}: its node has ended, or was cleaned up')
                print(f'{name}: {_described(feedback)}', file=sys.stderr, flush=True)
    except BaseException:  # rclpy turns a KeyboardInterrupt into other exceptions
        with suppress(GdmpError):  # the arm may be gone
            sent.cancel()
        raise
    result = sent.result(ANSWER_S)
    if not result.success:
        raise GdmpError(f'{name}: {result.message}')
    return result


def _described(feedback: list[Any]) -> str:
    """What an arm says of its motion."""
    if not feedback:
        return 'waiting for the arm to rest'
    what = getattr(feedback[-1], 'activity', 'moving')
    return f'{what}, {feedback[-1].remaining:.0f} s left'


def identify(arm: str, output: Path, use: bool) -> dict[str, list[float]]:
    """
    Let an arm measure friction and weight, and write parameters.

    :param arm: name of its node
    :param use: set them in the node too
    :returns: parameters, by name
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
    Start an arm, move it to its home posture, and let it measure friction and weight.

    :returns: parameters, by name
    :raises GdmpError: if the arm refuses, or the motions are ended
    """
    with (TemporaryDirectory() as name, Domain() as domain, arm.robot(Path(name)),
          NodeTestbed(Path(name), domain.environment(), arm) as bed):
        bed.start_arm()
        move_joints(bed.client, arm.node)
        result = _measure(bed.client, arm.node)
    _write(output, arm.node, result)
    return result


def with_friction(arm: ArmChoice, folder: Path) -> ArmChoice:
    """
    The same arm; one behind a server of the protocol is identified if no friction is given.

    :param folder: for ``friction.yaml``
    :raises GdmpError: as `identify_alone`
    """
    if not arm.protocol_server or arm.parameter_files:
        return arm
    print('identifying the friction of the robot, which takes three minutes: --friction YAML '
          'leaves it out', flush=True)
    friction = folder / 'friction.yaml'
    identify_alone(arm, friction)
    return replace(arm, parameter_files=(friction,))


def received_description(topic: str) -> str:
    """
    URDF that the driver of a robot publishes, with the calibration of its arm.

    :raises GdmpError: if none comes in time
    """
    client = Client('description_client')
    received: list[String] = []
    try:
        client.subscribe(String, topic, received.append, late=True)
        client.wait(f'a robot description on {topic}', lambda: bool(received), START_UP_S)
    finally:
        client.close()
    return str(received[-1].data)


def _write(output: Path, arm: str, result: dict[str, list[float]]) -> None:
    lines = '\n'.join(f'    {name}: {values}' for name, values in result.items())
    write_text(output, f'/**/{arm.rpartition("/")[2]}:\n  ros__parameters:\n{lines}\n')


def _measure(client: Client, arm: str) -> dict[str, list[float]]:
    """Parameters of an arm that it measures."""
    result = _make(client, IdentifyFriction, f'{arm}/identify_friction', IdentifyFriction.Goal())
    return {'friction_viscous': list(result.viscous), 'friction_dry': list(result.dry),
            'weight_moments': list(result.weight_moments)}


def _set(client: Client, arm: str, result: dict[str, list[float]]) -> None:
    changes: list[ParameterMessage] = [
        Parameter(name, value=values).to_parameter_msg() for name, values in result.items()]
    reply: Any = client.call(SetParametersAtomically, f'{arm}/set_parameters_atomically',
                             parameters=changes)
    if not reply.result.successful:
        raise GdmpError(f'{arm}: {reply.result.reason}')
