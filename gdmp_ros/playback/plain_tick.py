"""
A tick of a stream that only goes on, compiled: a motion, or a place that is held.

What it cannot do is left to `gdmp_ros.playback.player`: requests, the beginning and the end of a
motion, the way to the robot, sequences, commands for a gripper.
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gdmp_ros.dmp.layout import FINISHED, PROGRESS, SPEED
from gdmp_ros.kernels import kernel
from gdmp_ros.playback.bounds import bound_in_time_and_space, NEXT
from gdmp_ros.playback.channels import advance_references
from gdmp_ros.playback.look_ahead import LookAhead
from gdmp_ros.playback.states import State

#: What ends a tick that a kernel makes: nothing; the motion has finished, or goes on after its
#: end; it has come to rest. `RESTS`: there is no motion.
GOES_ON, FINISHES, GOES_ON_AGAIN, STOPS, RESTS = range(5)
_ENDS = {State.MOVING: FINISHES, State.FINISHED: GOES_ON_AGAIN, State.STOPPING: STOPS,
         State.RESTARTING: STOPS, State.WAITING: STOPS, State.PAUSED: GOES_ON}
#: What `plain_tick` returns: it was made; the state of the player changes: then the reference is
#: not bounded yet; it was made, and a command for the gripper is due.
MADE, CHANGES, DUE = range(3)
#: Indices of the counts of `Motion`.
ENDS, BOUNDED, COUNTS = range(3)


class Motion(NamedTuple):
    """
    What a kernel knows of a stream.

    :ivar counts: what ends a tick, and in how many the bounds were active
    :ivar due: progress at which the next command for a gripper is due, shape (1,)
    :ivar memory: of the roll-out
    :ivar state: its last state, overwritten
    :ivar table: of the channels (`gdmp_ros.playback.channels.KIND`)
    :ivar target: reference of the player
    :ivar parts: what is bounded, and four parts of `gdmp_ros.playback.bounds.StreamBounds`
    """

    counts: np.ndarray
    due: np.ndarray
    memory: np.ndarray
    state: np.ndarray
    table: np.ndarray
    target: np.ndarray
    parts: np.ndarray
    bounded: np.ndarray
    work: np.ndarray
    tempo: np.ndarray
    ahead: LookAhead


@kernel
def plain_tick(motion, dt):
    """Let ``dt`` seconds pass; returns `MADE`, `CHANGES` or `DUE`."""
    ends = motion.counts[ENDS]
    if ends != RESTS:
        motion.state[0] = motion.tempo[NEXT] * dt
        advance_references(motion.memory, motion.state, motion.table, motion.target)
        finished = motion.memory[FINISHED] != 0.0
        if (ends == FINISHES and finished or ends == GOES_ON_AGAIN and not finished
                or ends == STOPS and motion.memory[SPEED] == 0.0):
            return CHANGES
    if dt > 0.0 and bound_in_time_and_space(motion.target, motion.bounded, motion.table,
                                            motion.parts, dt, motion.work, motion.tempo,
                                            motion.memory, motion.ahead):
        motion.counts[BOUNDED] += 1
    return DUE if ends != RESTS and motion.memory[PROGRESS] >= motion.due[0] else MADE


def end_of(state: State, moves: bool) -> int:
    """What ends a tick of a player in a state."""
    return _ENDS[state] if moves else RESTS
