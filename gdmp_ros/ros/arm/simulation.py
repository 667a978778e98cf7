"""One tick of the simulated arm: requests, references, the guiding hand, physics."""
from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any

from gdmp_msgs.msg import Reference
from geometry_msgs.msg import PoseStamped
import numpy as np

from gdmp_ros.control.tick import Tick
from gdmp_ros.errors import DataError, GdmpError, ParameterError
from gdmp_ros.ros.messages import checked_pose, NS, origin_of, reference_target
from gdmp_ros.ros.polling import take, take_latest
from gdmp_ros.sim.closed_loop import ClosedLoop
from gdmp_ros.sim.hand import Hand, HandSettings
from gdmp_ros.sim.tool import ToolTransform

#: Largest number of references read in a tick.
MAX_REFERENCES = 20
#: Without a message for this time the hand releases the tool [s].
HAND_TIMEOUT_S = 0.3
#: The pose of the hand is polled once in this many ticks.
HAND_EVERY = 5
MAX_STEPS = 100_000


class Simulation:
    """
    A closed loop that follows references from a topic; it can be paused, stepped and reset.

    One thread calls `advance`. Requests come from another thread; `advance` carries them out.

    :ivar requests: called by the next `advance`
    :ivar sequence: number of the reference that is followed, 0 before the first
    :ivar steps_dropped: ticks of the last `request_steps` that `pause` prevented
    :ivar hand_problem: why a pose of the hand was refused; empty if it was not
    :ivar identification_problem: why the friction could not be identified; empty if it was not
    """

    def __init__(self, loop: ClosedLoop, frame: str, references: Any, hand_poses: Any,
                 hand_settings: HandSettings):
        """
        Prepare.

        :param frame: ``frame_id`` of hand poses
        :param references: polled subscription (`gdmp_ros.ros.polling`)
        :param hand_poses: polled subscription
        """
        self.loop = loop
        self.hand_settings = hand_settings
        self.paused = False
        self.sequence = 0
        self.hand_problem = self.identification_problem = ''
        self._frame, self._references, self._hand_poses = frame, references, hand_poses
        self.requests: deque[Callable[[], None]] = deque()
        self._reset_requested = False
        self._hand_guide_requested: bool | None = None
        self._identification_requested: bool | None = None
        self.steps_dropped = 0
        # Only `advance` counts ticks, and only the other thread sets the last one of a request.
        self._ticks = self._last_tick = 0
        self._hand_ticks = 0

    def pause(self, paused: bool) -> None:
        """Pause or continue; steps that are left are not made."""
        self.steps_dropped += self.steps_left
        self.paused = paused
        self._last_tick = self._ticks

    def request_reset(self) -> None:
        """Put the arm to its first keyframe at the next tick."""
        self._reset_requested = True

    def request_hand_guiding(self, wanted: bool) -> None:
        """Begin or end hand guiding at the next tick."""
        self._hand_guide_requested = wanted
        self._identification_requested = False if wanted else self._identification_requested

    def request_identification(self, wanted: bool) -> None:
        """
        Begin or end the motions that show the friction of the joints, at the next tick.

        :raises ParameterError: if a reference is followed, or the arm is guided by hand
        """
        loop = self.loop
        if wanted and loop.hand_guided:
            raise ParameterError('the arm is guided by hand: end it first (~/teach)')
        if wanted and loop.controller.guard.following:
            raise ParameterError('the arm follows references: stop their publisher first')
        if wanted and self.identifies:
            raise ParameterError('friction is being identified already')
        self.identification_problem = ''
        self._identification_requested = wanted

    @property
    def identifies(self) -> bool:
        """Whether such motions are made, or will be."""
        identification = self.loop.identification
        return bool(self._identification_requested) or (
            identification is not None and not identification.done)

    def request_tool(self, tool: ToolTransform) -> list[str]:
        """
        Put the tool to another place at the next tick.

        :returns: empty until then; contains the reason of a refusal afterwards, or an empty string
        """
        done: list[str] = []

        def put() -> None:
            try:
                self.loop.put_tool(tool)
                done.append('')
            except ParameterError as error:
                done.append(str(error))
        self.requests.append(put)
        return done

    def request_steps(self, steps: int) -> None:
        """
        Advance the paused simulation by a number of ticks.

        :raises ParameterError: if it is not paused, or is advancing already
        """
        if not self.paused:
            raise ParameterError('the simulation is not paused: call ~/set_pause first')
        if not 1 <= steps <= MAX_STEPS:
            raise ParameterError(f'steps is {steps}, expected 1 to {MAX_STEPS}')
        if self.steps_left:
            raise ParameterError(f'{self.steps_left} steps are left of another request')
        self.steps_dropped = 0
        self._last_tick = self._ticks + steps

    @property
    def steps_left(self) -> int:
        """Ticks that are left of `request_steps`."""
        return max(0, self._last_tick - self._ticks)

    def advance(self, stamp_ns: int) -> Tick | None:
        """
        Make one tick; None while paused.

        :param stamp_ns: present time
        """
        while self.requests:
            self.requests.popleft()()
        if self._reset_requested:
            self._reset_requested, self.sequence = False, 0
            self.loop.reset()
        if self._hand_guide_requested is not None:
            self._switch_hand_guiding(self._hand_guide_requested)
            self._hand_guide_requested = None
        if self._identification_requested is not None:
            wanted, self._identification_requested = self._identification_requested, None
            self.loop.identification = None
            if wanted:
                self.loop.identify_friction()
        if self.paused and self.steps_left == 0:
            return None
        # All in order: another publisher must not hide the one that is followed.
        for _ in range(MAX_REFERENCES):
            message = take(self._references)
            if message is None:
                break
            self.take_reference(message, stamp_ns)
        if self.loop.hand_guided:
            self._poll_hand()
        try:
            tick = self.loop.tick()
        except DataError as error:
            if not self.identifies:
                raise
            # The arm holds where it is.
            self.identification_problem, self.loop.identification = str(error), None
            tick = self.loop.tick()
        self._ticks += 1
        return tick

    def take_reference(self, message: Reference, now_ns: int) -> None:
        """Follow a reference, or refuse it."""
        guard = self.loop.controller.guard
        if message.joints:
            guard.refuse('references of the joints are not followed')
            return
        stamp = message.header.stamp.sec * NS + message.header.stamp.nanosec
        if guard.offer(reference_target(message), origin_of(message, (now_ns - stamp) / NS)):
            self.sequence = message.sequence

    def take_hand(self, message: PoseStamped) -> None:
        """Hold the tool with a hand at a pose, or refuse the pose."""
        try:
            pose = checked_pose(message, self._frame)
        except GdmpError as error:
            self.hand_problem = f'hand_pose refused: {error}'
            return
        self.loop.hand = Hand(pose, self.hand_settings)
        self._hand_ticks = 0

    def _switch_hand_guiding(self, wanted: bool) -> None:
        self.loop.hand_guided = wanted
        take_latest(self._hand_poses)  # discard poses received before
        self._hand_ticks = self.sequence = 0
        self._release()

    def _poll_hand(self) -> None:
        self._hand_ticks += 1
        if self._hand_ticks % HAND_EVERY:
            return
        message = take_latest(self._hand_poses)
        if message is not None:
            self.take_hand(message)
        elif (self.loop.hand is not None
              and self._hand_ticks * self.loop.arm.period > HAND_TIMEOUT_S):
            # Without a hand, the mouse in the viewer may apply a force: do not reset it here.
            self._release()

    def _release(self) -> None:
        self.loop.hand = None
        self.loop.arm.push(np.zeros(6))
