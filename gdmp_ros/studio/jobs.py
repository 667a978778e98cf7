"""Work that the callbacks of a page leave to one thread."""
from __future__ import annotations

from collections.abc import Callable, Hashable
import threading
from typing import TypeAlias

Work: TypeAlias = Callable[[], None]


class Jobs:
    """
    Work in its order; of the same kind only the newest waits.

    A mouse that drags something makes more events than can be computed.
    """

    def __init__(self) -> None:
        self._waiting: dict[Hashable, Work] = {}
        self._changing = threading.Lock()

    def put(self, work: Work, kind: Hashable = None) -> None:
        """
        Add work; any thread may call it.

        :param kind: replaces waiting work of the same kind; None replaces nothing
        """
        with self._changing:
            kind = object() if kind is None else kind
            # What comes later is done later.
            self._waiting.pop(kind, None)
            self._waiting[kind] = work

    def take(self) -> Work | None:
        """Next work; None without one."""
        with self._changing:
            for kind in self._waiting:
                return self._waiting.pop(kind)
            return None
