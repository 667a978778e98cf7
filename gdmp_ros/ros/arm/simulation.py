"""One tick of the simulated arm: requests, references, the guiding hand, physics."""
from __future__ import annotations

from enum import Enum
from typing import Any

from geometry_msgs.msg import PoseStamped
import numpy as np

from gdmp_ros.control.arm_states import Request
from gdmp_ros.control.tick import Tick
from gdmp_ros.errors import GdmpError, ParameterError
from gdmp_ros.ros.arm.commands import ArmCommands
from gdmp_ros.ros.messages import checked_pose
from gdmp_ros.ros.middleware import deserialized, Subscription
from gdmp_ros.sim.closed_loop import ClosedLoop
from gdmp_ros.sim.teaching import Hand, HandSettings

#: Without a message for this time the hand releases the tool [s].
HAND_TIMEOUT_S = 0.3
#: The pose of the hand is polled once in this many ticks.
HAND_EVERY = 5
MAX_STEPS = 100_000


class Reset(Enum):
    """A request to a simulation alone."""

    RESET = '~/reset_world'


class Simulation(ArmCommands):
    """
    A closed loop that follows references from a topic; it can be paused, stepped and reset.

    One thread calls `advance`. Requests come from another thread; `advance` carries them out.

    :ivar steps_dropped: ticks of the last `request_steps` that `pause` prevented
    :ivar hand_problem: why a pose of the hand was refused; empty if it was not
    """

    def __init__(self, loop: ClosedLoop, frame: str, references: Subscription,
                 hand_poses: Subscription, hand_settings: HandSettings):
        """
        Prepare.

        :param frame: ``frame_id`` of references and hand poses
        :param references: without a callback
        :param hand_poses: without a callback
        """
        super().__init__(loop, frame, references)
        self.loop = loop
        self.hand_settings = hand_settings
        self.paused = False
        self.hand_problem = ''
        self._frame, self._hand_poses = frame, hand_poses
        self.steps_dropped = 0
        # Only `advance` counts ticks, and only the other thread sets the last one of a request.
        self._ticks = self._last_tick = 0
        self._hand_ticks = 0

    def pause(self, paused: bool) -> None:
        """Pause or continue; steps that are left are not made."""
        self.steps_dropped += self.steps_left
        self.paused = paused
        self._last_tick = self._ticks

    def _do(self, request: Any, argument: Any) -> None:
        if request is Reset.RESET:
            self.sequence = 0
            self.loop.reset(same_stream=True)
            return
        if request in (Request.GUIDE, Request.RELEASE):
            self._hand_poses.discard()
            self._hand_ticks = 0
            self._release()
        super()._do(request, argument)

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

    def advance(self, now_ns: int) -> Tick | None:
        """
        Make one tick; None while paused.

        :param now_ns: present time, of the clock of the references
        """
        self.carry_out()
        if self.paused and self.steps_left == 0:
            return None
        self.take_references(now_ns)
        self._poll_hand()
        tick = self.loop.tick()
        self._ticks += 1
        return tick

    def take_hand(self, data: bytes) -> None:
        """Hold the tool with a hand at the pose of a serialised message, or refuse the pose."""
        try:
            pose = checked_pose(deserialized(data, PoseStamped), self._frame)
        except GdmpError as error:
            self.hand_problem = f'hand_pose refused: {error}'
            return
        self.loop.hand = Hand(pose, self.hand_settings)
        self._hand_ticks = 0

    def _poll_hand(self) -> None:
        self._hand_ticks += 1
        if self._hand_ticks % HAND_EVERY:
            return
        received = self._hand_poses.newest()
        if received is not None:
            self.take_hand(received.data)
        elif (self.loop.hand is not None
              and self._hand_ticks * self.loop.arm.period > HAND_TIMEOUT_S):
            # Without a hand, the mouse in the viewer may apply a force: do not reset it here.
            self._release()

    def _release(self) -> None:
        self.loop.hand = None
        self.loop.arm.push(np.zeros(6))
