"""Who meets whom over DDS: domains of one's own, and how far nodes reach by default."""
from __future__ import annotations

from collections.abc import Mapping
import fcntl
import os
from pathlib import Path
import tempfile
from typing import IO

from gdmp_ros.errors import GdmpError

#: Ids whose ports do not collide with ephemeral ones on Linux.
IDS = range(1, 102)
#: With one of these the user has chosen who can reach the nodes, or how; otherwise we do.
CHOSEN = ('ROS_AUTOMATIC_DISCOVERY_RANGE', 'ROS_STATIC_PEERS', 'ROS_LOCALHOST_ONLY',
          'ROS_DISCOVERY_SERVER', 'FASTRTPS_DEFAULT_PROFILES_FILE',
          'FASTDDS_DEFAULT_PROFILES_FILE', 'FASTDDS_BUILTIN_TRANSPORTS', 'CYCLONEDDS_URI')
#: Sockets on 127.0.0.1 alone.
PROFILE = Path(__file__).with_name('this_machine.xml')


def network() -> dict[str, str]:
    """
    Environment that keeps nodes to this machine and to UDP, where the user has not chosen.

    In shared memory a process that is killed in the middle of a message can leave a lock behind
    that silences others, also those that are started in its place.
    """
    if any(os.environ.get(name) for name in CHOSEN):
        return {}
    if 'fastrtps' in os.environ.get('RMW_IMPLEMENTATION', 'rmw_fastrtps_cpp'):
        return {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SYSTEM_DEFAULT',
                'FASTRTPS_DEFAULT_PROFILES_FILE': str(PROFILE)}
    return {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}


def any_machine(environment: Mapping[str, str]) -> dict[str, str]:
    """Return an environment changed so that it reaches other machines too, over UDP."""
    kept = {name: value for name, value in environment.items() if name not in CHOSEN}
    return {**kept, 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET',
            'FASTDDS_BUILTIN_TRANSPORTS': 'UDPv4'}


class Domain:
    """A claimed domain id; released by `release` or the end of the process."""

    def __init__(self) -> None:
        """:raises GdmpError: if all ids are taken"""
        folder = Path(tempfile.gettempdir()) / 'gdmp_ros-domains'
        folder.mkdir(exist_ok=True)
        for number in IDS:
            try:
                handle = (folder / f'{number}.lock').open('a')
            except PermissionError:  # another user's
                continue
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                handle.close()
                continue
            self.id, self._handle = number, handle
            return
        raise GdmpError(f'no DDS domain is free: all of {IDS[0]} to {IDS[-1]} are claimed')

    _handle: IO[str]

    def environment(self) -> dict[str, str]:
        """Environment of processes in this domain."""
        return {**os.environ, **network(), 'ROS_DOMAIN_ID': str(self.id)}

    def release(self) -> None:
        """Give the id back."""
        self._handle.close()
