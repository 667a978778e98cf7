"""A loop that makes one tick for each message on /clock, in a thread of its own."""
from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.impl.implementation_singleton import rclpy_implementation
from rosgraph_msgs.msg import Clock

from gdmp_ros.realtime.loop import RealtimeThread
from gdmp_ros.ros.polling import take

#: Longest wait for a message before the thread looks whether it is to end [ns].
WAIT_NS = 50_000_000


class ClockLoop:
    """Waits for messages of a polled subscription; an executor takes half a millisecond each."""

    def __init__(self, context: Any, subscription: Any, step: Callable[[Clock], None],
                 priority: int):
        """Begin; messages from before are discarded."""
        while take(subscription) is not None:
            pass
        self._context, self._subscription, self._step = context, subscription, step
        self._active = True
        self._thread = RealtimeThread(self._run, priority)
        self._thread.start()

    @property
    def failure(self) -> BaseException | None:
        """Exception that ended the loop, None while it runs."""
        return self._thread.failure

    @property
    def scheduler(self) -> str:
        """``fifo`` or ``other``."""
        return self._thread.scheduler

    def leave(self) -> None:
        """End the loop."""
        self._active = False
        self._thread.join()

    def _run(self) -> None:
        waiting = rclpy_implementation.WaitSet(1, 0, 0, 0, 0, 0, self._context.handle)
        while self._active:
            waiting.clear_entities()
            waiting.add_subscription(self._subscription.handle)
            waiting.wait(WAIT_NS)
            while self._active and (message := take(self._subscription)) is not None:
                self._step(message)
