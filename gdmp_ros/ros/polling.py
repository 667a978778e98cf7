"""
Subscriptions that are read in a loop instead of by the executor.

With polling a flood of messages costs little; an executor would wake up for each of them.
"""
from __future__ import annotations

import time
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
    latest = _take_latest(subscription)
    return None if latest is None else latest[0]


def take_latest_with_age(subscription: Any) -> tuple[Any, float] | None:
    """Newest message of a polled subscription, and how long ago it arrived [s]."""
    latest = _take_latest(subscription)
    if latest is None:
        return None
    message, received = latest[0], latest[1]['received_timestamp']
    # Not every middleware gives the time.
    return message, max(0.0, (time.time_ns() - received) * 1e-9) if received else 0.0


def _take_latest(subscription: Any) -> tuple[Any, dict[str, int]] | None:
    """Newest message, and what the middleware tells of it."""
    latest = None
    with subscription.handle:
        while (taken := subscription.handle.take_message(subscription.msg_type,
                                                         subscription.raw)) is not None:
            latest = taken
    return latest
