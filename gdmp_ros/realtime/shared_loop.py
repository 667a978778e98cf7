"""One real-time thread for several periodic tasks: one process for several robots."""
from __future__ import annotations

from collections.abc import Callable
import threading

from gdmp_ros.realtime.loop import MonotonicClock, RealtimeThread, run_periodic

Step = Callable[[int, int], None]


class Member:
    """
    A task in a shared loop.

    :ivar step: called periodically
    :ivar failure: exception that ended the task, None while it runs; other tasks continue
    """

    def __init__(self, loop: _Loop, step: Step):
        self.failure: BaseException | None = None
        self.step = step
        self._loop = loop

    @property
    def scheduler(self) -> str:
        """``fifo`` or ``other``."""
        return self._loop.thread.scheduler

    def leave(self) -> None:
        """End the task; it does not run any more after the return."""
        _leave(self._loop, self)


class _Loop:
    def __init__(self, period_ns: int, priority: int):
        self.members: tuple[Member, ...] = ()
        self.stepping = threading.Lock()
        self.thread = RealtimeThread(
            lambda: _ignore(run_periodic(self._step, period_ns, MonotonicClock(),
                                         lambda: not self.members)), priority)

    def _step(self, deadline_ns: int, now_ns: int) -> None:
        with self.stepping:
            for member in self.members:
                if member.failure is None:
                    try:
                        member.step(deadline_ns, now_ns)
                    except BaseException as error:
                        member.failure = error


_loops: dict[tuple[int, int], _Loop] = {}
_changing = threading.Lock()


def join(period_ns: int, priority: int, step: Step) -> Member:
    """
    Call ``step(deadline_ns, now_ns)`` periodically; equal period and priority share a thread.

    :param priority: see `RealtimeThread`
    """
    with _changing:
        loop = _loops.get((period_ns, priority))
        new = loop is None
        if loop is None:
            loop = _loops[period_ns, priority] = _Loop(period_ns, priority)
        member = Member(loop, step)
        loop.members = (*loop.members, member)
        if new:
            loop.thread.start()
        return member


def _leave(loop: _Loop, member: Member) -> None:
    with _changing:
        with loop.stepping:
            loop.members = tuple(one for one in loop.members if one is not member)
        if loop.members:
            return
        for key in [key for key, one in _loops.items() if one is loop]:
            del _loops[key]
        loop.thread.join()


def _ignore(missed: int) -> None:
    """Drop the result: each task counts its missed deadlines itself."""
