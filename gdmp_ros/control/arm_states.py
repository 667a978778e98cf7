"""What an arm does, and what every request and every event does then: the table of its states."""
from __future__ import annotations

from collections.abc import Callable
from enum import Enum
from typing import NamedTuple

from gdmp_ros.control.modes import ArmMode
from gdmp_ros.errors import ParameterError


class State(Enum):
    """States of an arm; the value says what it does."""

    INACTIVE = 'nothing is measured and nothing is sent: the node is not active'
    HOLDING = 'the pose is held; a motion that begins near the robot, or `~/arm`, is followed'
    RESTING = 'a stream of references that rests is followed'
    FOLLOWING = 'a motion is followed'
    STOPPING = 'the arm comes to rest'
    GUIDED = 'a hand guides the arm: only gravity is compensated, and the joints are damped'
    COMPLIANT = 'the arm gives way: only gravity is compensated, and the joints are damped'
    MOVING = 'the joints move to a posture'
    IDENTIFYING = 'each joint moves slowly, to measure its friction'
    FAULT = 'the pose is held, and nothing is followed'

    #: Looked up in every tick; that of `Enum` is slow.
    __hash__ = object.__hash__

    @property
    def mode(self) -> ArmMode:
        """As ``~/state`` and ``~/status`` report it."""
        return _MODE[self]

    @property
    def moves(self) -> bool:
        """Whether the arm moves because of a request, or comes to rest."""
        return self in (State.FOLLOWING, State.STOPPING, State.MOVING, State.IDENTIFYING)

    @property
    def follows(self) -> bool:
        """Whether references are followed."""
        return self in (State.RESTING, State.FOLLOWING)


_MODE = {State.INACTIVE: ArmMode.UNKNOWN, State.HOLDING: ArmMode.HOLD,
         State.RESTING: ArmMode.FOLLOW, State.FOLLOWING: ArmMode.FOLLOW,
         State.STOPPING: ArmMode.STOP, State.GUIDED: ArmMode.GUIDED,
         State.COMPLIANT: ArmMode.COMPLIANT, State.MOVING: ArmMode.MOVE,
         State.IDENTIFYING: ArmMode.IDENTIFY, State.FAULT: ArmMode.FAULT}


class Request(Enum):
    """Requests of users and events; the value is their name."""

    ACTIVATE = 'activate'
    DEACTIVATE = 'deactivate'
    ARM = '~/arm'
    STOP = '~/stop'
    COMPLY = '~/comply'
    GUIDE = '~/teach true'
    RELEASE = '~/teach false'
    MOVE = '~/move_joints'
    IDENTIFY = '~/identify_friction'
    RECOVER = '~/recover'
    TOOL = '~/set_tool'
    PAYLOAD = '~/set_payload'
    REFILL = '~/refill_tank'
    POSTURE = '~/posture'
    RESET = '~/reset_world'
    MOTION = 'reference of a motion'
    REST = 'reference at rest'
    LOST = 'the stream ends, or is lost'
    COLLISION = 'collision'
    ARRIVED = 'at rest, or arrived'
    FAILURE = 'failure'

    __hash__ = object.__hash__


class Stop(NamedTuple):
    """The arm comes to rest first; then it goes on with another state."""

    then: State


#: Why a request is refused.
_INACTIVE = 'the node is not active'
_FAULT = 'the arm is in a fault ({}): call ~/recover first'
_GUIDED = 'the arm is guided by hand: end it first (~/teach with false, or ~/stop)'
_JOINTS = 'the joints move: wait, or call ~/stop first'
_MOTION = 'the arm follows a motion: stop it first (~/stop of its server, or of the arm)'
_STOPS = 'the arm comes to rest: ask again when it has'
_NO_FAULT = 'the arm is not in a fault'

_OFF, _HOLD, _REST, _FOLL, _STOP, _HAND, _GIVE, _MOVE, _IDEN, _FAIL = State
_Entry = State | Stop | str
_ROWS: dict[State, tuple[_Entry, ...]] = {
    # activate, deactivate, arm, stop, comply, guide, release, move, identify, recover,
    # tool, payload, refill, posture, reset, motion, rest, lost, collision, arrived, failure
    _OFF: (_HOLD, _OFF, *[_INACTIVE] * 13, '', '', _OFF, _OFF, _OFF, _OFF),
    _HOLD: (_HOLD, _OFF, _HOLD, _HOLD, _GIVE, _HAND, _HOLD, _MOVE, _IDEN, _NO_FAULT,
            _HOLD, _HOLD, _HOLD, _HOLD, _HOLD, _FOLL, _REST, _HOLD, _HOLD, _HOLD, _FAIL),
    _REST: (_HOLD, Stop(_OFF), _REST, Stop(_HOLD), _GIVE, Stop(_HAND), _REST, _MOVE, _IDEN,
            _NO_FAULT, _HOLD, _REST, _REST, _REST, _HOLD, _FOLL, _REST, Stop(_HOLD), _REST, _REST,
            _FAIL),
    _FOLL: (_HOLD, Stop(_OFF), _FOLL, Stop(_HOLD), _GIVE, Stop(_HAND), _FOLL, _MOTION,
            _MOTION, _NO_FAULT, _MOTION, _FOLL, _MOTION, _FOLL, _HOLD, _FOLL, _REST, Stop(_HOLD),
            Stop(_HOLD), _FOLL, _FAIL),
    _STOP: (_HOLD, Stop(_OFF), _STOPS, Stop(_HOLD), _GIVE, Stop(_HAND), Stop(_HOLD), Stop(_MOVE),
            Stop(_IDEN), _NO_FAULT, _STOPS, _STOP, _STOPS, _STOP, _HOLD, _FOLL, _REST, _STOP,
            _STOP, _HOLD, _FAIL),
    _HAND: (_HOLD, _OFF, _GUIDED, _HOLD, _GIVE, _HAND, _HOLD, _GUIDED, _GUIDED, _NO_FAULT,
            _HAND, _HAND, _HAND, _HAND, _HOLD, _GUIDED, '', _HAND, _HAND, _HAND, _FAIL),
    _GIVE: (_HOLD, _OFF, _HOLD, _HOLD, _GIVE, _HAND, _GIVE, _MOVE, _IDEN, _NO_FAULT,
            _GIVE, _GIVE, _GIVE, _GIVE, _HOLD, _FOLL, '', _GIVE, _GIVE, _GIVE, _FAIL),
    _MOVE: (_HOLD, Stop(_OFF), _JOINTS, Stop(_HOLD), _GIVE, Stop(_HAND), _MOVE, _JOINTS,
            _JOINTS, _NO_FAULT, _JOINTS, _MOVE, _JOINTS, _MOVE, _HOLD, _JOINTS, '', _MOVE,
            Stop(_HOLD), _HOLD, _FAIL),
    _IDEN: (_HOLD, Stop(_OFF), _JOINTS, Stop(_HOLD), _GIVE, Stop(_HAND), _IDEN, _JOINTS,
            _JOINTS, _NO_FAULT, _JOINTS, _JOINTS, _JOINTS, _IDEN, _HOLD, _JOINTS, '', _IDEN,
            Stop(_HOLD), _HOLD, _FAIL),
    _FAIL: (_HOLD, _OFF, _FAULT, _FAIL, _FAULT, _FAULT, _FAIL, _FAULT, _FAULT, _HOLD,
            _FAULT, _FAULT, _FAIL, _FAIL, _HOLD, _FAULT, '', _FAIL, _FAIL, _FAIL, _FAIL)}
#: Next state by state and request. A text is the reason why the request is refused; an empty one
#: is not reported.
TABLE: dict[State, dict[Request, _Entry]] = {
    state: dict(zip(Request, row, strict=True)) for state, row in _ROWS.items()}


class ArmStates:
    """
    The state of one arm: guard, controller and services have the same.

    :ivar state: what the arm does
    :ivar then: what follows when it has come to rest (`State.STOPPING`)
    :ivar reason: of a stop, of giving way or of a fault; empty if there is none
    :ivar refused: number of refused references
    :ivar last_refusal: reason of the last refused reference or request; empty before the first
    """

    def __init__(self) -> None:
        self.state = self.then = State.HOLDING
        self.reason = self.last_refusal = ''
        self.refused = 0
        #: Called with the state before, after each request that was not refused.
        self.watchers: list[Callable[[State], None]] = []

    def refusal(self, request: Request) -> str | None:
        """Why a request is refused; None if it is not."""
        entry = TABLE[self.state][request]
        if self.state is State.STOPPING:
            if self.then is State.INACTIVE and isinstance(TABLE[State.INACTIVE][request], str):
                return _INACTIVE
            if self.then is not State.HOLDING and request in (Request.MOTION, Request.REST):
                return _STOPS
        return entry.format(self.reason) if isinstance(entry, str) else None

    def check(self, request: Request) -> None:
        """:raises ParameterError: if a request is refused"""
        reason = self.refusal(request)
        if reason is not None:
            raise ParameterError(reason)

    def take(self, request: Request, reason: str = '') -> None:
        """
        Change the state as a request wants.

        :param reason: of a stop, of giving way or of a fault
        :raises ParameterError: if it is refused
        """
        entry, before = TABLE[self.state][request], self.state
        if entry is before and reason == self.reason and before is not State.STOPPING:
            return
        self.check(request)
        if isinstance(entry, Stop):
            released = before is State.STOPPING and request is Request.RELEASE
            if not released or self.then is State.GUIDED:
                self.state, self.then = State.STOPPING, entry.then
        elif isinstance(entry, State):
            self.state = self.then if (before is State.STOPPING and request is Request.ARRIVED
                                       ) else entry
        # What comes while the arm stops, or is in a fault, is not why.
        known = before is self.state and (
            request in (Request.COLLISION, Request.LOST)
            or before is State.FAULT and request is not Request.FAILURE)
        if not (known or request in _KEEP_REASON):
            self.reason = reason
        for watcher in self.watchers:
            watcher(before)

    def end(self, reason: str = '') -> None:
        """The arm is not controlled any more."""
        before, self.state = self.state, State.INACTIVE
        self.reason = reason
        for watcher in self.watchers:
            watcher(before)

    @property
    def waits_for(self) -> str:
        """What the arm waits for, for people."""
        if self.state is State.STOPPING:
            return f'rest, then: {self.then.value}'
        return _WAITS[self.state]

    def refuse(self, reason: str) -> None:
        """Count a reference that is not followed, and keep the reason."""
        # In this order: another thread reads the reason when the count has changed.
        self.last_refusal = reason
        self.refused += 1


_WAITS = {
    State.INACTIVE: 'activation', State.HOLDING: 'a motion that begins near the robot, or ~/arm',
    State.RESTING: 'a motion of the stream', State.FOLLOWING: 'the next reference',
    State.GUIDED: 'a hand, or ~/teach with false', State.COMPLIANT: '~/stop, ~/arm or a motion '
    'that begins near the robot', State.MOVING: 'the joints to arrive',
    State.IDENTIFYING: 'the joints to have moved', State.FAULT: '~/recover'}
#: Events that say nothing new about why the arm does what it does.
_KEEP_REASON = frozenset({Request.ARRIVED, Request.RELEASE, Request.TOOL, Request.PAYLOAD,
                          Request.REFILL, Request.POSTURE})
