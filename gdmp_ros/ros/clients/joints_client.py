"""Client of an arm that moves its joints to a posture."""
from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
import sys
from typing import Any

from gdmp_msgs.srv import MoveJoints
import numpy as np
from std_srvs.srv import Trigger

from gdmp_ros.errors import GdmpError
from gdmp_ros.ros.clients.client import Client

#: Longest time for a motion; a simulation may run slower than real time [s].
LONGEST_S = 300.0
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
    begun = shown = client.now()
    while not reply.done():
        client.spend(0.1)
        now = client.now()
        if now - begun > LONGEST_S:
            raise GdmpError(f'waited {LONGEST_S:g} s for the motion, without success')
        if now - shown > SHOW_S:
            shown = now
            if not service.service_is_ready():
                raise GdmpError(f'{arm} has ended, or was cleaned up, while its joints moved')
            print(f'{arm}: moving, {now - begun:.0f} s', file=sys.stderr, flush=True)
