"""Names of the files that were opened last on this computer."""
from __future__ import annotations

import json
import os
from pathlib import Path

from gdmp_ros.errors import DataError
from gdmp_ros.util.files import read_text, write_json

#: Files that are remembered.
MOST = 12
#: Largest size of the list [bytes].
_MAX_BYTES = 100_000


class RecentFiles:
    """The list of the user, in ``XDG_STATE_HOME``; a list that is damaged or missing is empty."""

    def __init__(self, file: Path | None = None):
        """:param file: that keeps the list; by default that of the user"""
        state = os.environ.get('XDG_STATE_HOME') or os.path.expanduser('~/.local/state')
        self._file = file or Path(state) / 'gdmp_ros' / 'recent.json'

    def paths(self) -> list[Path]:
        """Files and folders that are still there, the newest first."""
        try:
            names = json.loads(read_text(self._file, 'list', _MAX_BYTES))
        except (DataError, ValueError):
            return []
        known = names if isinstance(names, list) else []
        return [Path(name) for name in known if isinstance(name, str) and os.path.exists(name)]

    def add(self, path: Path) -> None:
        """Remember that a file was opened; nothing happens where the list cannot be written."""
        path = path.absolute()
        names = [str(path), *(str(known) for known in self.paths() if known != path)][:MOST]
        try:
            self._file.parent.mkdir(parents=True, exist_ok=True)
            write_json(self._file, names)
        except OSError:
            pass
