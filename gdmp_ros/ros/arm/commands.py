"""References and requests for an arm, carried out by the thread of its loop."""
from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any, NamedTuple

from gdmp_ros.control.arm_control import ArmControl
from gdmp_ros.control.arm_states import Request
from gdmp_ros.control.reference_check import Origin
from gdmp_ros.errors import DataError, GdmpError
from gdmp_ros.ros.messages import NS
from gdmp_ros.ros.middleware import Subscription
from gdmp_ros.ros.serialized import ReferenceReader

#: Largest number of references read in a tick.
MAX_REFERENCES = 20


class Answer:
    """
    What became of a request.

    :ivar done: whether it was carried out or refused
    :ivar refusal: why it was refused; empty if it was not
    """

    done, refusal = False, ''

    def give(self, refusal: str = '') -> None:
        """Answer; the first answer counts."""
        if not self.done:
            self.refusal = refusal
            self.done = True


class _Asked(NamedTuple):
    request: Request
    argument: Any
    answer: Answer


class ArmCommands:
    """
    What other nodes want of an arm.

    One thread calls `carry_out` and `take_references`. Requests come from another thread, each is
    checked when it is carried out, and answered.

    :ivar control: of the arm
    :ivar sequence: number of the reference that is followed, 0 before the first
    :ivar asked: requests that have not been carried out
    :ivar references: that have come
    :ivar reader: of them
    """

    def __init__(self, control: ArmControl, frame: str, references: Subscription):
        """
        Prepare.

        :param frame: ``frame_id`` of the references
        :param references: without a callback
        """
        self.control = control
        self.sequence = 0
        self.asked: deque[_Asked] = deque()
        self.references, self.reader = references, ReferenceReader(
            frame, len(control.joints.torque))
        #: Called after a request was added, to wake a compiled loop.
        self.called: Callable[[], None] = lambda: None

    def ask(self, request: Request, argument: Any = None) -> Answer:
        """
        Carry out a request at the next tick; the answer comes then.

        :param argument: see `gdmp_ros.control.arm_control.ArmControl.do`
        """
        answer = Answer()
        self.asked.append(_Asked(request, argument, answer))
        self.called()
        return answer

    def drop(self, reason: str) -> None:
        """Refuse the requests that have not been carried out; any thread may call it."""
        while self.asked:
            self.asked.popleft().answer.give(reason)

    def carry_out(self) -> None:
        """Carry out the requests."""
        while self.asked:
            asked = self.asked.popleft()
            try:
                if asked.request in (Request.GUIDE, Request.RESET):
                    self.sequence = 0
                self.control.do(asked.request, asked.argument)
                asked.answer.give()
            except GdmpError as error:
                self.control.states.last_refusal = f'{asked.request.value}: {error}'
                asked.answer.give(str(error))

    def know_stream(self, now_ns: int) -> None:
        """Remember a stream that runs when the control begins: it is not followed."""
        while (received := self.references.take()) is not None:
            read = self._read(received.data, now_ns)
            if read is not None:
                self.control.controller.guard.observe(*read)

    def take_references(self, now_ns: int) -> None:
        """Follow the references that have arrived until now."""
        # All in order: another publisher must not hide the one that is followed.
        for _ in range(MAX_REFERENCES):
            received = self.references.take()
            if received is None:
                break
            self.offer(received.data, now_ns)

    def offer(self, data: bytes, now_ns: int) -> None:
        """Follow a serialised reference, or refuse it."""
        read = self._read(data, now_ns)
        if read is not None and self.control.controller.guard.offer(*read):
            self.sequence = read[1].sequence

    def _read(self, data: bytes, now_ns: int) -> tuple[Any, Origin] | None:
        """Numbers and origin of a reference; None, and counted, if it is none."""
        try:
            item = self.reader.read(data)
        except DataError as error:
            self.control.controller.guard.refuse(str(error))
            return None
        return item.target, Origin(item.frame, (now_ns - item.stamp) / NS, item.sequence,
                                   item.mode, item.stamp / NS)
