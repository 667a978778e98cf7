"""
A server that speaks the network protocol of a Franka Research 3, with a simulated arm behind it.

It is the package franka-sim, which needs an environment of its own: ``.venv-franka-sim`` beside
the environment of this package (``make setup`` makes it), or the interpreter that
``GDMP_FRANKA_SIM`` names. It serves one robot, on the ports of the protocol.
"""
from __future__ import annotations

import argparse
from collections.abc import Callable
import hashlib
import os
from pathlib import Path
import socket
import struct
import sys
import tempfile
import time
import xml.etree.ElementTree as ElementTree

import numpy as np

from gdmp_ros.errors import DataError, GdmpError
from gdmp_ros.franka.settings import BETWEEN_CLIENTS_S, PORT
from gdmp_ros.util.files import write_text

VERSION = '1.1.7'
HOST = '127.0.0.1'
#: For the pose of a hand that guides the arm (`gdmp_ros.sim.contact_server`).
HAND_PORT = 1341
#: Dry friction of the joints in public models of the robot [Nm].
DRY_FRICTION = 1.137
_SIM = Path(__file__).parent.parent / 'sim'
_MODEL, _TOUCHED = _SIM / 'models' / 'fr3.xml', _SIM / 'contact_server.py'
_POSE = struct.Struct('<7d')


def interpreter() -> Path:
    """
    Interpreter of the environment of the server.

    :raises DataError: if there is none
    """
    given = os.environ.get('GDMP_FRANKA_SIM')
    path = Path(given) if given else Path(sys.prefix).parent / '.venv-franka-sim/bin/python'
    if not path.is_file():
        raise DataError(
            f'{path} is missing: python3 -m venv {path.parent.parent} && '
            f'{path.parent}/pip install franka-sim=={VERSION}, or name the interpreter of such an '
            'environment in GDMP_FRANKA_SIM')
    return path


def command(dry_friction: float, enforce: bool, object_width: float | None, gripper: bool,
            hand: bool = False, model: Path = _MODEL) -> tuple[list[str], dict[str, str]]:
    """
    Command line of the server, and what it needs in its environment.

    :param dry_friction: of each joint [Nm]
    :param enforce: stop motions that break the limits, or lose too many cycles, as the robot does
    :param object_width: of a virtual object between the fingers [m]
    :param hand: whether a hand may guide the arm (`move_hand`)
    :param model: MJCF file of the arm and of what is around it
    :raises DataError: if the server is not installed, or cannot use the model
    """
    touched = hand or model != _MODEL
    words = [str(interpreter()), *(['-P', str(_TOUCHED), str(HAND_PORT)] if touched else
                                   ['-m', 'franka_sim.run_server'])]
    if enforce:
        words += ['--enforce-comm-constraints', '--enforce-motion-limits']
    if not gripper:
        words.append('--no-gripper')
    elif object_width is not None:
        words += ['--gripper-object-width', str(object_width)]
    return words, {'FR3_MJCF': str(_plant(model, dry_friction))}


def _plant(model: Path, dry_friction: float) -> Path:
    """File of a model with dry friction; its name tells its content."""
    try:
        tree = ElementTree.parse(model)
    except (OSError, ElementTree.ParseError) as error:
        raise DataError(f'{model}: cannot be read: {error}') from None
    joint = tree.find('default/joint')
    if joint is None:
        raise DataError(f'{model}: no default of the joints')
    joint.set('frictionloss', str(dry_friction))
    for texture in tree.iter('texture'):
        texture.attrib.pop('colorspace', None)  # the MuJoCo of the server is an older one
    text = ElementTree.tostring(tree.getroot(), encoding='unicode')
    name = hashlib.sha256(text.encode()).hexdigest()[:12]
    path = Path(tempfile.gettempdir()) / f'gdmp_fr3_{name}.xml'
    if not path.exists():
        write_text(path, text)
    return path


def move_hand(pose: np.ndarray) -> None:
    """Let the hand of a server pull the tool to a pose (x, y, z, qw, qx, qy, qz)."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.sendto(_POSE.pack(*pose), (HOST, HAND_PORT))


def await_server(check: Callable[[], None], host: str = HOST, seconds: float = 30.0) -> None:
    """
    Wait until a server can be used.

    :param check: called again and again; raises if the server has ended
    :raises GdmpError: after ``seconds``
    """
    ends = time.monotonic() + seconds
    while True:
        check()
        with socket.socket() as probe:
            if probe.connect_ex((host, PORT)) == 0:
                break
        if time.monotonic() > ends:
            raise GdmpError(f'waited {seconds:g} s for the server of the protocol')
        time.sleep(0.1)
    time.sleep(BETWEEN_CLIENTS_S)


def check_port() -> None:
    """:raises GdmpError: if another server runs"""
    with socket.socket() as probe:
        probe.settimeout(0.5)
        if probe.connect_ex((HOST, PORT)) == 0:
            raise GdmpError(f'port {PORT} is in use: another server of the protocol runs')


def main(arguments: list[str] | None = None) -> int:
    """Become the server."""
    parser = argparse.ArgumentParser(prog='python -m gdmp_ros.franka.protocol_server',
                                     description=__doc__)
    parser.add_argument('--dry-friction', type=float, default=DRY_FRICTION, metavar='NM',
                        help='of each joint (default %(default)s)')
    parser.add_argument('--tolerant', action='store_true',
                        help='do not stop motions that break limits')
    parser.add_argument('--gripper', action='store_true', help='serve a gripper too')
    parser.add_argument('--hand', action='store_true',
                        help='a hand may guide the arm, by datagrams (gdmp record)')
    parser.add_argument('--object-width', type=float, metavar='M',
                        help='virtual object between the fingers')
    parser.add_argument('--model', type=Path, default=_MODEL, metavar='FILE',
                        help='MJCF of the arm and of what is around it, which the external '
                             'torques tell of (default: the arm alone)')
    options = parser.parse_args(arguments)
    try:
        check_port()
        words, environment = command(options.dry_friction, not options.tolerant,
                                     options.object_width, options.gripper, options.hand,
                                     options.model)
    except GdmpError as error:
        print(f'error: {error}', file=sys.stderr)
        return 2
    return os.execve(words[0], words, {**os.environ, **environment})


if __name__ == '__main__':
    raise SystemExit(main())
