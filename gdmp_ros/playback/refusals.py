"""Counts what was refused, and keeps the reasons until they are reported."""
from __future__ import annotations

from collections import deque


class Refusals:
    """
    Requests and messages that were refused; any thread may add one.

    :ivar count: since the beginning
    :ivar last: newest reason, empty before the first
    """

    def __init__(self) -> None:
        self.count = 0
        self.last = ''
        self._new: deque[str] = deque(maxlen=10)

    def add(self, reason: str) -> None:
        """Count a refusal."""
        self.count += 1
        self.last = reason
        self._new.append(reason)

    def take_new(self) -> list[str]:
        """Reasons since the last call, at most the newest ten."""
        reasons = []
        while self._new:
            reasons.append(self._new.popleft())
        return reasons
