"""Topics with goals for a server."""
from __future__ import annotations

from collections.abc import Callable
import time
from typing import Any

from gdmp_ros.errors import GdmpError
from gdmp_ros.ros.frame_tree import FrameError
from gdmp_ros.ros.polling import take_latest, take_latest_with_age


class GoalInput:
    """
    A topic of which the newest goal counts; one in a frame that is not known yet waits for it.

    :ivar topic: its name, for messages
    """

    def __init__(self, subscription: Any, topic: str, use: Callable[[bytes, float], None],
                 refuse: Callable[[str], None]):
        """
        Prepare.

        :param subscription: polled, of serialised messages
        :param use: called with a message and the time since it arrived [s]; raises a `GdmpError`
            to refuse it
        :param refuse: called with the reason
        """
        self.topic = topic
        self._subscription, self._use, self._refuse = subscription, use, refuse
        self._waiting: tuple[bytes, float] | None = None

    def discard(self) -> None:
        """Discard the goals that have come."""
        self._waiting = None
        take_latest(self._subscription)

    def poll(self, timeout: float) -> None:
        """
        Use the newest goal.

        :param timeout: for its frame [s]
        """
        taken = take_latest_with_age(self._subscription)
        now = time.monotonic()
        if taken is not None:
            self._waiting = taken[0], now - taken[1]
        if self._waiting is None:
            return
        data, arrived = self._waiting
        try:
            self._use(data, now - arrived)
        except GdmpError as error:
            if isinstance(error, FrameError) and now - arrived < timeout:
                return
            self._refuse(f'{self.topic}: {error}')
        self._waiting = None

    def use_or_refuse(self, data: bytes) -> None:
        """Use a goal, or refuse it at once."""
        try:
            self._use(data, 0.0)
        except GdmpError as error:
            self._refuse(f'{self.topic}: {error}')
