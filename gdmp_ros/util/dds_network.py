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
RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
#: With one of these the user has chosen who can reach the nodes, …
REACH = (RANGE, 'ROS_STATIC_PEERS', 'ROS_LOCALHOST_ONLY', 'ROS_DISCOVERY_SERVER')
#: … with one of these, over what; otherwise we do.
TRANSPORT = ('FASTRTPS_DEFAULT_PROFILES_FILE', 'FASTDDS_DEFAULT_PROFILES_FILE',
             'FASTDDS_BUILTIN_TRANSPORTS', 'CYCLONEDDS_URI')
CHOSEN = (*REACH, *TRANSPORT)
#: Sockets on 127.0.0.1 alone.
PROFILE = Path(__file__).with_name('this_machine.xml')


def network() -> dict[str, str]:
    """
    Environment that keeps nodes to this machine and to UDP, where the user has not chosen.

    In shared memory a process that is killed in the middle of a message can leave a lock behind
    that silences others, also those that are started in its place; and whoever publishes stands
    still for a third of a second now and then when somebody new is met.
    """
    reach = [name for name in REACH if os.environ.get(name)]
    if any(os.environ.get(name) for name in TRANSPORT):
        return {}
    # The older variable comes before the range, whatever that says.
    older = os.environ.get('ROS_LOCALHOST_ONLY') == '1'
    here = not reach or older or (reach == [RANGE] and os.environ[RANGE] == 'LOCALHOST')
    if 'fastrtps' not in os.environ.get('RMW_IMPLEMENTATION', 'rmw_fastrtps_cpp'):
        return {RANGE: 'LOCALHOST'} if here else {}
    if not here:
        return {'FASTDDS_BUILTIN_TRANSPORTS': 'UDPv4'}
    # With LOCALHOST rmw adds shared memory, whatever else is said.
    return {RANGE: 'SYSTEM_DEFAULT', 'FASTRTPS_DEFAULT_PROFILES_FILE': str(PROFILE),
            **({'ROS_LOCALHOST_ONLY': '0'} if older else {})}


def any_machine(environment: Mapping[str, str]) -> dict[str, str]:
    """Return an environment changed so that it reaches other machines too, over UDP."""
    kept = {name: value for name, value in environment.items() if name not in CHOSEN}
    return {**kept, RANGE: 'SUBNET',
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
