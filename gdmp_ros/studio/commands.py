"""Work that the threads of a page leave to one thread: commands, jobs, changes of a skill."""
from __future__ import annotations

from collections.abc import Callable, Hashable
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass, field, replace
import queue
import threading
from typing import Any, TypeAlias, TypeVar

import numpy as np

from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import GdmpError
from gdmp_ros.realtime.loop import Clock, NS

#: Time between two looks for a result [ns].
LOOK_NS = 2_000_000
Work: TypeAlias = Callable[[], None]


@dataclass(eq=False)
class Changes:
    """
    What the user has changed in a skill.

    :ivar start: pose (x, y, z, qw, qx, qy, qz), or posture of a skill of the joints [rad]; None
        for that of the skill
    :ivar goal: the same
    :ivar via: positions [m], or postures [rad], by progress, 0 to 1
    :ivar objects: poses of task frames by name, of those that have been moved
    :ivar duration: [s]; None for that of the skill
    :ivar corrections: the skill with corrections by hand, before the other changes; newest last
    """

    start: np.ndarray | None = None
    goal: np.ndarray | None = None
    via: dict[float, np.ndarray] = field(default_factory=dict)
    objects: dict[str, np.ndarray] = field(default_factory=dict)
    duration: float | None = None
    corrections: tuple[Skill, ...] = ()

    def copy(self) -> Changes:
        """The same changes, which stay as they are."""
        return replace(self, via=dict(self.via), objects=dict(self.objects))

    def __eq__(self, other: object) -> bool:
        return (isinstance(other, Changes) and repr(self) == repr(other)
                and self.corrections == other.corrections)

    def __bool__(self) -> bool:
        return bool(self.via or self.objects or self.corrections) or any(
            item is not None for item in (self.start, self.goal, self.duration))


T = TypeVar('T')


class Commands:
    """A queue of commands; nobody or one waits for each."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._waiting: queue.SimpleQueue[tuple[Callable[[], None], Future[Any] | None]] = (
            queue.SimpleQueue())

    def put(self, work: Callable[[], None]) -> None:
        """Give a command; any thread may call it."""
        self._waiting.put((work, None))

    def ask(self, work: Callable[[], T], longest: float) -> T:
        """
        Give a command and wait for its result; one that has not begun in time is not carried out.

        :param longest: [s]
        :raises GdmpError: that of the command, or after ``longest`` seconds
        """
        future: Future[T] = Future()

        def carry_out() -> None:
            try:
                future.set_result(work())
            except GdmpError as error:
                future.set_exception(error)
        self._waiting.put((carry_out, future))
        clock = self._clock
        ends = clock.now() + round(longest * NS)
        while not future.done() and clock.now() < ends:
            clock.sleep_until(clock.now() + LOOK_NS)
        if future.cancel() or not future.done():
            raise GdmpError(f'waited {longest:g} s for the nodes, without success')
        return future.result()

    def drop(self) -> None:
        """Forget what has not been carried out."""
        with suppress(queue.Empty):
            while True:
                _, future = self._waiting.get_nowait()
                if future is not None:
                    future.cancel()

    def carry_out(self) -> None:
        """Carry out all commands; one thread calls it."""
        while not self._waiting.empty():
            work, future = self._waiting.get()
            if future is None or future.set_running_or_notify_cancel():
                work()


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
