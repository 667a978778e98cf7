"""References and requests for an arm, carried out by the thread of its loop."""
from __future__ import annotations

from collections import deque
from collections.abc import Callable
from functools import partial

import numpy as np

from gdmp_ros.control.arm_control import ArmControl
from gdmp_ros.control.joint_motion import JointMotion
from gdmp_ros.control.modes import ArmMode
from gdmp_ros.control.reference_check import Origin
from gdmp_ros.errors import DataError, GdmpError, ParameterError
from gdmp_ros.ros.messages import NS
from gdmp_ros.ros.middleware import Subscription
from gdmp_ros.ros.serialized import ReferenceReader
from gdmp_ros.sim.frames import ToolTransform
from gdmp_ros.sim.payload import Payload

#: Largest number of references read in a tick.
MAX_REFERENCES = 20


class ArmCommands:
    """
    What other nodes want of an arm.

    One thread calls `carry_out` and `take_references`. Requests come from another thread.

    :ivar control: of the arm
    :ivar requests: called by the next `carry_out`
    :ivar sequence: number of the reference that is followed, 0 before the first
    """

    def __init__(self, control: ArmControl, frame: str, references: Subscription):
        """
        Prepare.

        :param frame: ``frame_id`` of the references
        :param references: without a callback
        """
        self.control = control
        self.sequence = 0
        self.requests: deque[Callable[[], None]] = deque()
        self._references, self._reader = references, ReferenceReader(frame)
        self._motion_requested = False

    def carry_out(self) -> None:
        """Carry out the requests."""
        while self.requests:
            self.requests.popleft()()

    def take_references(self, now_ns: int) -> None:
        """Follow the references that have arrived until now."""
        # All in order: another publisher must not hide the one that is followed.
        for _ in range(MAX_REFERENCES):
            received = self._references.take()
            if received is None:
                break
            self.take_reference(received.data, now_ns)

    def take_reference(self, data: bytes, now_ns: int) -> None:
        """Follow a serialised reference, or refuse it."""
        guard = self.control.controller.guard
        try:
            item = self._reader.read(data)
        except DataError as error:
            guard.refuse(str(error))
            return
        origin = Origin(item.frame, (now_ns - item.stamp) / NS, item.sequence, item.mode)
        if guard.offer(item.target, origin):
            self.sequence = item.sequence

    def position(self) -> np.ndarray:
        """Present positions of the joints [rad]."""
        raise NotImplementedError

    def put_tool(self, tool: ToolTransform) -> None:
        """
        Control another point of the tool's body, from now on.

        :raises ParameterError: while references are followed
        """
        raise NotImplementedError

    def announce(self, payload: Payload) -> None:
        """
        Tell the model of the arm what it carries; any thread may call it.

        :raises ParameterError: if that is not possible now
        """
        raise NotImplementedError

    def recover(self) -> None:
        """
        End a fault; called by `carry_out`.

        :raises GdmpError: if the arm does not recover
        """
        self.control.controller.guard.recover()

    def request_recovery(self) -> list[str]:
        """End a fault at the next tick; returns as `request_tool`."""
        return self._request(self.recover)

    def request_hand_guiding(self, guided: bool) -> None:
        """Begin or end hand guiding at the next tick."""
        self.requests.append(lambda: self.switch_hand_guiding(guided))

    def switch_hand_guiding(self, guided: bool) -> None:
        """Begin or end hand guiding now."""
        if guided:
            self.control.end_joint_motion('the arm is guided by hand')
        self.control.hand_guided = guided
        self.sequence = 0

    def request_joint_motion(self, make: Callable[[], JointMotion]) -> None:
        """
        Begin motions of the joints at the next tick.

        :param make: called by `carry_out`
        :raises ParameterError: if a reference is followed, the arm is guided by hand, or the
            joints move already
        """
        self._check_joint_motion()
        if self.moves_joints:
            raise ParameterError('the joints move already')
        control = self.control
        control.joint_motion, control.joint_motion_problem = None, ''
        self._motion_requested = True

        def begin() -> None:
            try:
                self._check_joint_motion()
                control.joint_motion = make()
            except GdmpError as error:
                control.joint_motion_problem = str(error)
            self._motion_requested = False
        self.requests.append(begin)

    def _check_joint_motion(self) -> None:
        guard = self.control.controller.guard
        if guard.mode is ArmMode.FAULT:
            raise ParameterError(f'the arm is in a fault ({guard.reason}): call ~/recover first')
        if self.control.hand_guided:
            raise ParameterError('the arm is guided by hand: end it first (~/teach)')
        if guard.follows_motion:
            raise ParameterError('the arm follows a motion: stop it first (~/stop of its server, '
                                 'or of the arm)')

    def request_end_of_joint_motion(self, reason: str) -> None:
        """End motions of the joints at the next tick, if there are any."""
        self.requests.append(partial(self.control.end_joint_motion, reason))

    @property
    def moves_joints(self) -> bool:
        """Whether the joints move, or will."""
        return self._motion_requested or self.control.moves_joints

    def request_tool(self, tool: ToolTransform) -> list[str]:
        """
        Put the tool to another place at the next tick.

        :returns: empty until then; contains the reason of a refusal afterwards, or an empty string
        """
        return self._request(lambda: self.put_tool(tool))

    def _request(self, action: Callable[[], None]) -> list[str]:
        done: list[str] = []

        def carry_out() -> None:
            try:
                action()
                done.append('')
            except GdmpError as error:
                done.append(str(error))
        self.requests.append(carry_out)
        return done
