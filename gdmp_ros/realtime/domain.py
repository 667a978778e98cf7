"""A DDS domain of one's own, claimed by a file lock: runs side by side do not meet."""
from __future__ import annotations

import fcntl
import os
from pathlib import Path
import tempfile
from typing import IO

from gdmp_ros.errors import GdmpError

#: Ids whose ports do not collide with ephemeral ones on Linux.
IDS = range(1, 102)


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
        """Environment of processes in this domain: this machine only, unless the user chose."""
        result = dict(os.environ, ROS_DOMAIN_ID=str(self.id))
        result.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
        return result

    def release(self) -> None:
        """Give the id back."""
        self._handle.close()
