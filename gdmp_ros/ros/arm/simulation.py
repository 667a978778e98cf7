"""One tick of the simulated arm: requests, references, the guiding hand, physics."""
from __future__ import annotations

from typing import Any

from gdmp_msgs.msg import Reference
from geometry_msgs.msg import PoseStamped
import numpy as np

from gdmp_ros.control.controller import Tick
from gdmp_ros.control.guard import Origin
from gdmp_ros.errors import GdmpError, ParameterError
from gdmp_ros.ros.messages import checked_pose, NS, reference_target
from gdmp_ros.ros.polling import take, take_latest
from gdmp_ros.sim.closed_loop import ClosedLoop
from gdmp_ros.sim.hand import Hand, HandSettings

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

    :ivar sequence: number of the reference that is followed, 0 before the first
    :ivar steps_dropped: ticks of the last `request_steps` that `pause` prevented
    :ivar hand_problem: why a pose of the hand was refused; empty if it was not
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
        self.hand_problem = ''
        self._frame, self._references, self._hand_poses = frame, references, hand_poses
        self._reset_requested = False
        self._hand_guide_requested: bool | None = None
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
        if self._reset_requested:
            self._reset_requested, self.sequence = False, 0
            self.loop.reset()
        if self._hand_guide_requested is not None:
            self._switch_hand_guiding(self._hand_guide_requested)
            self._hand_guide_requested = None
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
        tick = self.loop.tick()
        self._ticks += 1
        return tick

    def take_reference(self, message: Reference, now_ns: int) -> None:
        """Follow a reference, or refuse it."""
        guard = self.loop.controller.guard
        if self.loop.hand_guided:
            guard.refuse('the arm is guided by hand (~/teach)')
            return
        stamp = message.header.stamp.sec * NS + message.header.stamp.nanosec
        origin = Origin(message.header.frame_id, (now_ns - stamp) / NS, message.sequence)
        if guard.offer(reference_target(message), origin):
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
