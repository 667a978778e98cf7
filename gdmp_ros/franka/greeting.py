"""Asking a robot whether it answers, before anything is started for it."""
from __future__ import annotations

import socket
import struct
import time

from gdmp_ros.control.arm_driver import ArmStopped
from gdmp_ros.franka.settings import BETWEEN_CLIENTS_S, PORT

#: Version of the protocol that this package speaks.
VERSION = 10
#: Time to answer a connection [s].
ANSWER_S = 1.0
#: Connecting: header (command, its number, size), version and port for states; the answer: header,
#: status, version.
_GREETING, _ANSWER = struct.Struct('<IIIHH'), struct.Struct('<IIIBH')


def check_answers(host: str) -> None:
    """
    Find out whether a robot can be used; it is free for another client afterwards.

    libfranka alone would wait for minutes, and keep the interpreter.

    :raises ArmStopped: if nobody answers within `ANSWER_S`, or with another protocol
    """
    try:
        version = _greet(host)
    except OSError as error:
        raise ArmStopped(f'{host}: the robot does not answer: {error.strerror or error}', False
                         ) from None
    if version != VERSION:
        raise ArmStopped(
            f'{host}: the robot speaks version {version} of the protocol, this libfranka version '
            f'{VERSION}: ' + ('an older Panda needs libfranka 0.9, which this package does not '
                              'use' if version < VERSION else 'update pylibfranka'), False)
    time.sleep(BETWEEN_CLIENTS_S)


def _greet(host: str) -> int:
    """
    Ask who answers at the port of a robot, as a client that leaves at once.

    :returns: version of the protocol that it speaks
    :raises OSError: if nobody answers in time, or not as a robot does
    """
    with (socket.create_connection((host, PORT), timeout=ANSWER_S) as asked,
          socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as states):
        asked.settimeout(ANSWER_S)
        states.bind(('', 0))
        asked.sendall(_GREETING.pack(0, 1, _GREETING.size, VERSION, states.getsockname()[1]))
        answer = b''
        while len(answer) < _ANSWER.size:
            part = asked.recv(_ANSWER.size - len(answer))
            if not part:
                raise OSError('it does not speak the protocol of a Franka')
            answer += part
        command, number, size, _, version = _ANSWER.unpack(answer)
        if (command, number) != (0, 1) or size < _ANSWER.size:
            raise OSError('it does not speak the protocol of a Franka')
    return int(version)
