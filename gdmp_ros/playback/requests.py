"""Status of a player, and the queue of requests that its next tick carries out."""
from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from enum import StrEnum
from typing import NamedTuple

from gdmp_ros.errors import GdmpError, ParameterError
from gdmp_ros.playback.refusals import Refusals

#: Requests that may wait for the next tick.
MAX_WAITING = 1000
UNCHANGED: dict[Status, Status] = {}


class Status(StrEnum):
    """
    What a player does.

    ``holding``: the goal of a finished motion, a pose, or the place where a motion was stopped.
    """

    IDLE = 'idle'
    MOVING = 'moving'
    PAUSED = 'paused'
    STOPPING = 'stopping'
    HOLDING = 'holding'


#: Status after a request by the status before it; without an entry it does not change.
AFTER_START = dict.fromkeys(Status, Status.MOVING)
AFTER_HOLD = dict.fromkeys(Status, Status.HOLDING)
AFTER_STOP = dict.fromkeys((Status.MOVING, Status.PAUSED, Status.HOLDING), Status.STOPPING)
AFTER_PAUSE, AFTER_RESUME = {Status.MOVING: Status.PAUSED}, {Status.PAUSED: Status.MOVING}


class _Request(NamedTuple):
    carry_out: Callable[[], None]
    after: Mapping[Status, Status]


class Requests:
    """
    Requests from any thread, carried out in order by one thread.

    :ivar waiting: requests that have not been carried out
    """

    def __init__(self, refusals: Refusals):
        """:param refusals: counts requests that turn out to be impossible"""
        self._refusals = refusals
        self.waiting: deque[_Request] = deque()

    def add(self, carry_out: Callable[[], None], after: Mapping[Status, Status]) -> None:
        """
        Add a request.

        :param after: status after it by the status before it
        :raises ParameterError: if too many requests wait, because no tick carries them out
        """
        if len(self.waiting) >= MAX_WAITING:
            raise ParameterError(f'{MAX_WAITING} requests are waiting: no tick carries them out')
        self.waiting.append(_Request(carry_out, after))

    def status_after(self, status: Status) -> Status:
        """Status when the waiting requests will have been carried out."""
        for request in tuple(self.waiting):
            status = request.after.get(status, status)
        return status

    def carry_out(self) -> None:
        """Carry out all requests."""
        while self.waiting:
            # Removed afterwards: until then `status_after` still counts it.
            try:
                self.waiting[0].carry_out()
            except GdmpError as error:
                self._refusals.add(str(error))
            self.waiting.popleft()
