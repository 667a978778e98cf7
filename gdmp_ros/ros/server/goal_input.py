"""Topics with goals for a server."""
from __future__ import annotations

from collections.abc import Callable

from gdmp_ros.errors import GdmpError
from gdmp_ros.realtime.loop import Clock, NS
from gdmp_ros.ros.frame_tree import FrameError
from gdmp_ros.ros.middleware import Subscription


class GoalInput:
    """
    A topic of which the newest goal counts; one in a frame that is not known yet waits for it.

    :ivar topic: its name, for messages
    """

    def __init__(self, clock: Clock, subscription: Subscription, topic: str,
                 use: Callable[[bytes, float], None], refuse: Callable[[str], None]):
        """
        Prepare.

        :param subscription: without a callback
        :param use: called with a message and the time since it arrived [s]; raises a `GdmpError`
            to refuse it
        :param refuse: called with the reason
        """
        self.topic = topic
        self._clock, self._subscription = clock, subscription
        self._use, self._refuse = use, refuse
        self._waiting: tuple[bytes, float] | None = None

    def discard(self) -> None:
        """Discard the goals that have come."""
        self._waiting = None
        self._subscription.discard()

    def poll(self, timeout: float) -> None:
        """
        Use the newest goal.

        :param timeout: for its frame [s]
        """
        received, now = self._subscription.newest(), self._clock.now() / NS
        if received is not None:
            self._waiting = received.data, now - self._subscription.age(received)
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
