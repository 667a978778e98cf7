"""One real-time loop for several periodic tasks: one process for several robots."""
from __future__ import annotations

from collections.abc import Callable
import threading

from gdmp_ros.realtime.loop import Clock, periodic

Step = Callable[[int, int], None]


class Member:
    """
    A task in a shared loop; see `gdmp_ros.realtime.loop.RunningLoop`.

    :ivar step: called periodically
    :ivar failure: exception that ended the task, None while it runs; other tasks continue
    """

    def __init__(self, loop: _SharedLoop, step: Step):
        self.failure: BaseException | None = None
        self.step = step
        self._loop = loop

    @property
    def scheduler(self) -> str:
        """``fifo`` or ``other``."""
        return self._loop.running.scheduler

    def end(self) -> None:
        """End the task; it does not run any more after the return."""
        _leave(self._loop, self)


class _SharedLoop:
    def __init__(self, clock: Clock, period_ns: int, priority: int):
        self.members: tuple[Member, ...] = ()
        self.stepping = threading.Lock()
        self.running = clock.start(periodic(self._step, period_ns, clock), priority)

    def _step(self, deadline_ns: int, now_ns: int) -> None:
        with self.stepping:
            for member in self.members:
                if member.failure is None:
                    try:
                        member.step(deadline_ns, now_ns)
                    except BaseException as error:
                        member.failure = error


_loops: dict[tuple[Clock, int, int], _SharedLoop] = {}
_changing = threading.Lock()


def join(clock: Clock, period_ns: int, priority: int, step: Step) -> Member:
    """
    Call ``step(deadline_ns, now_ns)`` periodically; equal period and priority share a loop.

    :param priority: see `Clock.start`
    """
    key = clock, period_ns, priority
    with _changing:
        loop = _loops.get(key)
        if loop is None:
            loop = _loops[key] = _SharedLoop(*key)
        member = Member(loop, step)
        loop.members = (*loop.members, member)
        return member


def _leave(loop: _SharedLoop, member: Member) -> None:
    with _changing:
        with loop.stepping:
            loop.members = tuple(one for one in loop.members if one is not member)
        if loop.members:
            return
        for key in [key for key, one in _loops.items() if one is loop]:
            del _loops[key]
        loop.running.end()
