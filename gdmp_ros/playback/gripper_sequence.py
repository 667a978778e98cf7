"""The commands for a gripper on the way of a motion; the motion waits until each is done."""
from __future__ import annotations

from typing import Protocol

from gdmp_ros.control.gripper import GripperCommand, GripperState
from gdmp_ros.playback.player import Player
from gdmp_ros.playback.requests import Status

#: Without an answer for this time the gripper has failed [s].
TIMEOUT_S = 10.0


class GripperLink(Protocol):
    """A gripper elsewhere."""

    def send(self, command: GripperCommand) -> None:
        """Let it begin a command."""

    def state(self) -> GripperState | None:
        """Its newest state; None if nothing is known of it."""


class GripperSequence:
    """
    Carries out the events of the skill that is played; one thread calls `advance`.

    :ivar problem: why the gripper of this motion failed; empty if it did not
    """

    def __init__(self, link: GripperLink):
        self._link = link
        self.problem = ''
        self._motion = self._next = 0
        self._sent: GripperCommand | None = None
        self._before, self._waited = 0, 0.0

    def advance(self, player: Player, dt: float) -> None:
        """Let ``dt`` seconds pass, after the tick of the player."""
        if player.motion != self._motion:
            self._motion, self._next, self._sent, self.problem = player.motion, 0, None, ''
        rollout, events = player.rollout, player.playing.skill.events
        if rollout is None or self._next == len(events) or player.status is not Status.MOVING:
            return
        event = events[self._next]
        if self._sent is None:
            if rollout.progress < event.progress:
                return
            state = self._link.state()
            self._before, self._waited = 0 if state is None else state.commands, 0.0
            self._sent = GripperCommand(event.width, event.force, event.speed)
            player.wait(True)
            self._link.send(self._sent)
            return
        self._waited += dt
        problem = self._outcome(self._sent)
        if problem is None:
            return
        self._sent, self._next = None, self._next + 1
        player.wait(False)
        if problem:
            self.problem = f'gripper: {problem}'
            player.stop()

    def _outcome(self, sent: GripperCommand) -> str | None:
        """Why the command failed; empty if it is done, None while it is carried out."""
        state = self._link.state()
        if state is None or state.commands == self._before or state.moving:
            if self._waited < TIMEOUT_S:
                return None
            return ('no state of it is known' if state is None else
                    f'not done within {TIMEOUT_S:g} s')
        if sent.force and not state.holding:
            return state.problem or 'there is nothing between the fingers'
        return state.problem
