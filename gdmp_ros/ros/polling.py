"""
Subscriptions that are read in a loop instead of by the executor.

With polling a flood of messages costs little; an executor would wake up for each of them.
"""
from __future__ import annotations

from typing import Any

from rclpy.callback_groups import CallbackGroup


class PolledGroup(CallbackGroup):
    """Callback group for subscriptions that the executor ignores."""

    def can_execute(self, entity: Any) -> bool:
        """Never by the executor."""
        return False

    def beginning_execution(self, entity: Any) -> bool:
        """Never by the executor."""
        return False

    def ending_execution(self, entity: Any) -> None:
        """Nothing to do."""


def take(subscription: Any) -> Any | None:
    """Next message of a polled subscription (bytes if raw); None if there is none."""
    with subscription.handle:
        taken = subscription.handle.take_message(subscription.msg_type, subscription.raw)
    return None if taken is None else taken[0]


def take_latest(subscription: Any) -> Any | None:
    """Newest message of a polled subscription; None if there is none."""
    latest = None
    while (message := take(subscription)) is not None:
        latest = message
    return latest
