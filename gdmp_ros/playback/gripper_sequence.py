"""The commands for a gripper on the way of a motion; the motion waits until each is done."""
from __future__ import annotations

import math
from typing import Protocol

from gdmp_ros.control.gripper import GripperCommand, GripperState
from gdmp_ros.playback.player import Player
from gdmp_ros.playback.states import State

#: States in which commands are carried out; in others, what has been begun is awaited.
_EXECUTED = (State.MOVING, State.FINISHED)
#: Without an answer for this time the gripper has failed [s].
TIMEOUT_S = 10.0


class GripperLink(Protocol):
    """A gripper elsewhere."""

    def send(self, command: GripperCommand) -> None:
        """Let it begin a command."""

    def state(self) -> GripperState | None:
        """Its newest state; None if nothing is known of it."""


class GripperCommands:
    """One command after the other, each until the gripper has carried it out."""

    def __init__(self, link: GripperLink):
        self._link = link
        self._sent = GripperCommand(0.0)
        self._before, self._waited = 0, 0.0

    def is_known(self) -> bool:
        """Whether there is a state of the gripper."""
        return self._link.state() is not None

    def begin(self, command: GripperCommand) -> None:
        """Let the gripper begin a command."""
        state = self._link.state()
        self._before, self._waited = 0 if state is None else state.commands, 0.0
        self._sent = command
        self._link.send(command)

    def outcome(self, dt: float) -> str | None:
        """
        Let ``dt`` seconds pass.

        :returns: why the command failed; empty if it is done, None while it is carried out
        """
        self._waited += dt
        state = self._link.state()
        if state is not None and state.commands < self._before:
            return 'it was restarted, and does not know the command'
        if state is None or state.commands == self._before or state.moving:
            if self._waited < TIMEOUT_S:
                return None
            return ('no state of it is known' if state is None else
                    f'not done within {TIMEOUT_S:g} s')
        if self._sent.force and not state.holding:
            return state.problem or 'there is nothing between the fingers'
        return state.problem


class GripperSequence:
    """Carries out the events of the skill that is played; one thread calls `advance`."""

    def __init__(self, commands: GripperCommands):
        self._commands = commands
        self._problem = ''
        self._motion = self._next = 0
        self._waits = False

    def problem(self, motion: int) -> str:
        """Why the gripper of a motion failed; empty if it did not, or the motion is another."""
        return self._problem if motion == self._motion else ''

    def waits_for_more(self, player: Player) -> bool:
        """Whether commands of the skill that moves have not been carried out."""
        events = player.playing.skill.events
        return player.rollout is not None and bool(events) and (
            player.motion != self._motion or self._next < len(events))

    def due(self, player: Player) -> float:
        """
        Progress of the motion after which it needs `advance`, as long as it only goes on.

        Infinite if it never does; minus infinity: after the next tick.
        """
        rollout, events = player.rollout, player.playing.skill.events
        if rollout is None or not events:
            return math.inf
        if player.motion != self._motion or self._waits:
            return -math.inf
        if self._next == len(events) or player.state not in _EXECUTED:
            return math.inf
        at = float(events[self._next].progress)
        return -math.inf if rollout.progress >= at or rollout.finished else at

    def advance(self, player: Player, dt: float) -> None:
        """Let ``dt`` seconds pass, after the tick of the player."""
        if player.motion != self._motion:
            self._motion, self._next, self._waits, self._problem = player.motion, 0, False, ''
        rollout, events = player.rollout, player.playing.skill.events
        if rollout is None or self._next == len(events):
            return
        event = events[self._next]
        if not self._waits:
            # The motion ends a little before or after a progress of 1.
            if player.state not in _EXECUTED or not (
                    rollout.progress >= event.progress or rollout.finished):
                return
            self._waits = True
            player.wait(True)
            self._commands.begin(GripperCommand(event.width, event.force, event.speed))
            return
        problem = self._commands.outcome(dt)
        if problem is None:
            return
        self._waits, self._next = False, self._next + 1
        player.wait(False)
        if problem:
            self._problem = f'gripper: {problem}'
            player.end()
