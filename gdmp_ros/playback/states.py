"""What a player does, and what every request does then: the table of its states."""
from __future__ import annotations

from enum import Enum, StrEnum


class Status(StrEnum):
    """
    What a player does, as the server reports it.

    ``holding``: the goal of a finished motion, a pose, or the place where a motion was stopped.
    """

    IDLE = 'idle'
    MOVING = 'moving'
    PAUSED = 'paused'
    STOPPING = 'stopping'
    HOLDING = 'holding'


class State(Enum):
    """States of a player; the value says what it does."""

    IDLE = 'nothing is streamed'
    RESTING = 'a place is held; there is no motion'
    APPROACHING = 'the reference goes to the robot, where a motion will begin'
    RESTARTING = 'the reference comes to rest, before it goes to the robot for another motion'
    WAITING = 'paused before a motion has begun'
    MOVING = 'a motion is executed'
    PAUSED = 'a motion comes to rest on its path, or rests there'
    STOPPING = 'the reference comes to rest; the motion ends there'
    FINISHED = 'the goal of a finished motion is held, and followed'

    @property
    def status(self) -> Status:
        """As the server reports it."""
        return _STATUS[self]

    @property
    def at_rest(self) -> bool:
        """Whether nothing is executed and nothing comes to rest."""
        return self.status in (Status.IDLE, Status.HOLDING)


_STATUS = {State.IDLE: Status.IDLE, State.RESTING: Status.HOLDING,
           State.APPROACHING: Status.MOVING, State.RESTARTING: Status.MOVING,
           State.WAITING: Status.PAUSED, State.MOVING: Status.MOVING, State.PAUSED: Status.PAUSED,
           State.STOPPING: Status.STOPPING, State.FINISHED: Status.HOLDING}


class Request(Enum):
    """Requests to a player; the value is their name."""

    HOLD = 'hold'
    START = 'start'
    GOAL = 'goal'
    AMPLITUDE = 'amplitude, frequency'
    SPEED = 'speed'
    PAUSE = 'pause'
    RESUME = 'resume'
    STOP = 'stop'


#: Why a request is refused.
NOTHING_EXECUTED = 'no skill is being executed; start one first'
ENDED, STOPS = 'the motion has ended', 'the motion is being stopped'

_IDLE, _REST, _APPR, _BACK, _WAIT, _MOVE, _HALT, _STOP, _DONE = State
_NONE = NOTHING_EXECUTED
_ROWS: dict[State, tuple[State | str, ...]] = {
    # hold, start, goal, amplitude, speed, pause, resume, stop
    _IDLE: (_REST, _MOVE, _NONE, _NONE, _IDLE, _NONE, _NONE, _NONE),
    _REST: (_REST, _MOVE, _NONE, _NONE, _REST, _NONE, _NONE, _NONE),
    _APPR: (_REST, _MOVE, _APPR, _APPR, _APPR, _WAIT, _APPR, _STOP),
    _BACK: (_REST, _BACK, _BACK, _BACK, _BACK, _WAIT, _BACK, _STOP),
    _WAIT: (_REST, _MOVE, _WAIT, _WAIT, _WAIT, _WAIT, _BACK, _STOP),
    _MOVE: (_REST, _MOVE, _MOVE, _MOVE, _MOVE, _HALT, _MOVE, _STOP),
    _HALT: (_REST, _MOVE, _HALT, _HALT, _HALT, _HALT, _MOVE, _STOP),
    _STOP: (_REST, _MOVE, _STOP, _STOP, _STOP, STOPS, STOPS, _STOP),
    _DONE: (_REST, _MOVE, _DONE, _DONE, _DONE, ENDED, ENDED, _STOP)}
#: Next state by state and request; a text is the reason why it is refused. A start begins a motion
#: at once (moving), unless the robot is far from a reference that rests (approaching), or from one
#: that is coming to rest (restarting).
TABLE: dict[State, dict[Request, State | str]] = {
    state: dict(zip(Request, row)) for state, row in _ROWS.items()}


def after(state: State, request: Request) -> State:
    """State after a request, the same if it is refused."""
    result = TABLE[state][request]
    return state if isinstance(result, str) else result
