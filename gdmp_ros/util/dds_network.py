"""Environment of DDS: which machines nodes reach, by which transport, in which domain."""
from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
import fcntl
import os
from pathlib import Path
import tempfile
from typing import IO

from gdmp_ros.errors import GdmpError

#: Domain ids whose ports do not collide with ephemeral ports of Linux.
DOMAIN_IDS = range(1, 102)
RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
#: With one of these variables the user chooses which machines are reached.
REACH = (RANGE, 'ROS_STATIC_PEERS', 'ROS_LOCALHOST_ONLY', 'ROS_DISCOVERY_SERVER')
#: With one of these variables the user chooses the transport.
TRANSPORT = ('FASTRTPS_DEFAULT_PROFILES_FILE', 'FASTDDS_DEFAULT_PROFILES_FILE',
             'FASTDDS_BUILTIN_TRANSPORTS', 'CYCLONEDDS_URI')
#: Profile of Fast DDS: UDP sockets bound to 127.0.0.1 only.
PROFILE = Path(__file__).with_name('this_machine.xml')


def default_environment() -> dict[str, str]:
    """
    Variables that restrict nodes to this machine and to UDP, where the user has not chosen.

    Shared memory is not used for two reasons. A process that is killed while it writes a message
    can leave a lock behind, and other processes, also new ones, then receive nothing. And a
    publisher can block for a third of a second when a new participant is discovered.
    """
    reach = [name for name in REACH if os.environ.get(name)]
    if any(os.environ.get(name) for name in TRANSPORT):
        return {}
    # ROS_LOCALHOST_ONLY has priority over the range.
    localhost_only = os.environ.get('ROS_LOCALHOST_ONLY') == '1'
    here = not reach or localhost_only or (reach == [RANGE] and os.environ[RANGE] == 'LOCALHOST')
    if 'fastrtps' not in os.environ.get('RMW_IMPLEMENTATION', 'rmw_fastrtps_cpp'):
        return {RANGE: 'LOCALHOST'} if here else {}
    if not here:
        return {'FASTDDS_BUILTIN_TRANSPORTS': 'UDPv4'}
    # With LOCALHOST rmw adds shared memory, whatever the profile says.
    return {RANGE: 'SYSTEM_DEFAULT', 'FASTRTPS_DEFAULT_PROFILES_FILE': str(PROFILE),
            **({'ROS_LOCALHOST_ONLY': '0'} if localhost_only else {})}


def unasked_restriction() -> str:
    """Say how to reach other machines, if only `default_environment` prevents it; else empty."""
    if RANGE not in default_environment() or any(os.environ.get(name) for name in REACH):
        return ''
    return (f'only nodes of this machine are reached: set {RANGE}=SUBNET to reach others, RViz '
            'on another machine, too')


def reaching_other_machines(environment: Mapping[str, str]) -> dict[str, str]:
    """The environment, changed so that nodes reach other machines too, over UDP."""
    kept = {name: value for name, value in environment.items() if name not in (*REACH, *TRANSPORT)}
    return {**kept, RANGE: 'SUBNET', 'FASTDDS_BUILTIN_TRANSPORTS': 'UDPv4'}


def locked(name: str) -> IO[str] | None:
    """
    Lock a name on this machine, until the returned file is closed or the process ends.

    :returns: None if another process of this user has it
    :raises PermissionError: if the name belongs to another user
    """
    folder = Path(tempfile.gettempdir()) / 'gdmp_ros-domains'
    folder.mkdir(exist_ok=True)
    handle = (folder / f'{name}.lock').open('a')
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        handle.close()
        return None
    return handle


class Domain:
    """A domain id claimed by a file lock, until `release` or the end of the process."""

    def __init__(self) -> None:
        """:raises GdmpError: if all ids are taken"""
        for number in DOMAIN_IDS:
            with suppress(PermissionError):  # the lock of another user
                handle = locked(str(number))
                if handle is not None:
                    self.id, self._handle = number, handle
                    return
        raise GdmpError(f'no DDS domain is free: all ids from {DOMAIN_IDS[0]} to '
                        f'{DOMAIN_IDS[-1]} are claimed')

    _handle: IO[str]

    def __enter__(self) -> Domain:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()

    def environment(self) -> dict[str, str]:
        """Environment of processes in this domain."""
        return {**os.environ, **default_environment(), 'ROS_DOMAIN_ID': str(self.id)}

    def release(self) -> None:
        """Release the id."""
        self._handle.close()
