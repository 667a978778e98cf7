"""Looks ahead along a motion: how fast it may be, so that what follows stays inside its bounds."""
from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gdmp_ros.dmp.integrator import advance
from gdmp_ros.dmp.layout import scalar_index
from gdmp_ros.dmp.rollout import Rollout
from gdmp_ros.kernels import kernel
from gdmp_ros.manifolds.linalg import copy_into, norm
from gdmp_ros.playback.channels import COUNT, KIND, OF_JOINTS, STATE_ACCELERATION, VELOCITY

#: Time between two samples, time that is looked ahead, and time after which all samples are
#: computed again [s].
STEP_S, AHEAD_S, RENEW_S = 0.002, 0.2, 2.0
#: Most samples of one tick; samples that are kept.
_BUDGET, _KEPT_SAMPLES = 4, 128
#: Share of an acceleration that a change of the tempo may use; the rest is for the motion.
SHARE = 0.25
#: Scalars of a motion, and the change of each with which all samples are computed again: requests
#: change them, and phase stopping the last one.
_WATCHED = tuple(scalar_index(name) for name in (
    'speed_goal', 'switched_at', 'target_since', 'amplitude_goal', 'obstacles', 'slowdown'))
_TOLERANCES = (0.0, 0.0, 0.0, 0.0, 0.0, 0.05)
#: Indices of `LookAhead.numbers`: time of the motion since the first sample [s], number of
#: samples, and the watched scalars as they were then.
_TIME, _COUNT, _KNOWN = range(3)
#: A part that is slower than this has no direction [m/s, rad/s].
SLOW = 1e-6
#: Largest rate of the tempo [1/s].
MOST_RATE = 5.0
#: Columns of what is bounded: numbers of a part (-3: a position, 3: a rotation, 1: a joint), its
#: first velocity, largest speed and acceleration.
SIZE, AT, MOST_SPEED, MOST_ACCELERATION = range(4)


class LookAhead(NamedTuple):
    """
    What a kernel keeps of the motion that follows.

    :ivar memory: a copy of the roll-out that runs ahead
    :ivar state: its state
    :ivar tempos: largest tempo at the last samples, at index ``k % len(tempos)``
    :ivar rates: largest rate of the tempo at them [1/s]
    :ivar numbers: see `_TIME`
    """

    memory: np.ndarray
    state: np.ndarray
    tempos: np.ndarray
    rates: np.ndarray
    numbers: np.ndarray


def look_ahead_of(rollout: Rollout | None) -> LookAhead:
    """Nothing is known yet of a motion; None: there is no motion."""
    size, state_size = (0, 0) if rollout is None else (len(rollout.memory), rollout.state_size)
    return LookAhead(np.empty(size), np.empty(state_size), np.ones(_KEPT_SAMPLES),
                     np.zeros(_KEPT_SAMPLES), np.zeros(_KNOWN + len(_WATCHED)))


@kernel
def largest_tempo(memory, table, parts, present, passed, ahead):
    """
    The largest tempo with which a motion can keep its bounds from now on.

    After a request all samples are computed again, in some ticks; the tempo does not rise then.

    :param memory: of the roll-out
    :param table: of the channels, see `gdmp_ros.playback.channels.KIND`
    :param parts: what is bounded, see `SIZE`
    :param present: tempo
    :param passed: time of the motion since the last call [s]
    :param ahead: `LookAhead`; changed
    :returns: the tempo, and the largest rate of its change [1/s]
    """
    numbers, count = ahead.numbers, ahead.tempos.size
    if ahead.memory.size != memory.size:
        return 1.0, MOST_RATE
    numbers[_TIME] += passed
    if numbers[_COUNT] == 0.0 or numbers[_TIME] > RENEW_S or _is_changed(memory, numbers):
        copy_into(memory, ahead.memory)
        for i in range(len(_WATCHED)):
            numbers[_KNOWN + i] = memory[_WATCHED[i]]
        numbers[_TIME], numbers[_COUNT] = 0.0, 0.0
    for _ in range(_BUDGET):
        if numbers[_COUNT] * STEP_S > numbers[_TIME] + AHEAD_S:
            break
        k = int(numbers[_COUNT]) % count
        ahead.state[0] = STEP_S
        advance(ahead.memory, ahead.state)
        ahead.tempos[k], ahead.rates[k] = _bounds_at(ahead.state, table, parts)
        numbers[_COUNT] += 1.0
    tempo, rate = 1.0, MOST_RATE
    if numbers[_COUNT] * STEP_S < numbers[_TIME] + AHEAD_S:
        tempo = present
    first = int(numbers[_TIME] / STEP_S)
    for k in range(first, int(numbers[_COUNT])):
        rate = min(rate, ahead.rates[k % count])
    for k in range(first, int(numbers[_COUNT])):
        until = max((k + 1) * STEP_S - numbers[_TIME], 0.0)
        if ahead.tempos[k % count] < 1.0:
            tempo = min(tempo, ahead.tempos[k % count] + rate * until)
    return tempo, rate


@kernel
def _bounds_at(state, table, parts):
    """Largest tempo in a state, and the largest rate of its change that leaves room for it."""
    tempo, rate, at = 1.0, MOST_RATE, 0
    for row in table:
        count, n = (row[COUNT], 1) if row[KIND] == OF_JOINTS else (2, 3)
        for i in range(count):
            # Half-angle to rotation vector.
            factor = 2.0 if n == 3 and i == 1 else 1.0
            first, change = row[VELOCITY] + n * i, row[STATE_ACCELERATION] + n * i
            speed = factor * norm(n, state[first:first + n])
            acceleration = factor * norm(n, state[change:change + n])
            largest = parts[at, MOST_ACCELERATION]
            if speed > SLOW:
                tempo = min(tempo, parts[at, MOST_SPEED] / speed)
                rate = min(rate, SHARE * largest / speed)
            if acceleration > largest:
                tempo = min(tempo, math.sqrt((1.0 - SHARE) * largest / acceleration))
            at += 1
    return tempo, rate


@kernel
def _is_changed(memory, numbers):
    """Whether a watched scalar is not what it was when the first sample was computed."""
    for i in range(len(_WATCHED)):
        if abs(memory[_WATCHED[i]] - numbers[_KNOWN + i]) > _TOLERANCES[i]:
            return True
    return False
