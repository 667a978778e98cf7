"""What happened in a recorded run, in order, and the limits that were active."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gdmp_ros.control.limits import Limit, LIMITS
from gdmp_ros.data.runs import ONE_STREAM, Run
from gdmp_ros.manifolds.quaternion import rotation_angles

#: References further apart than this are an interruption [ns].
INTERRUPTION_NS = 20_000_000
#: A limit that is not active for less than this is still the same event [ns].
SAME_EVENT_NS = 200_000_000
#: A reference at rest for this long is a pause between motions [ns].
PAUSE_NS = 100_000_000
#: A goal that changes again within this time still moves [ns]: the server tells it at 10 Hz.
GOAL_MOVES_NS = 350_000_000
#: A goal has changed if it is this far from the one before [m, rad].
OTHER_GOAL = 1e-4


class Event(NamedTuple):
    """
    Something that happened.

    :ivar time: since the first state [s]
    """

    time: float
    text: str


class Limited(NamedTuple):
    """
    A limit that was active.

    :ivar begins: times since the first state at which it became active [s]
    :ivar ends: times at which it no longer was, for longer than a moment [s]
    :ivar seconds: during which it was active, in total
    :ivar largest: by how much what was asked for exceeded the limit, at most
    """

    limit: Limit
    begins: np.ndarray
    ends: np.ndarray
    seconds: float
    largest: float


def events(run: Run) -> list[Event]:
    """What happened: motions, changes of the goal, interruptions."""
    found = [*_motions(run), *_goals(run), *run.steps, *_interruptions(run)]
    origin = run.state_stamps[0]
    return [Event((stamp - origin) * 1e-9, text) for stamp, text in sorted(found)]


def limited(run: Run) -> list[Limited]:
    """
    The limits that were active, in the order in which they first were.

    What the reference or the law asked for exceeded them: the arm was commanded less.
    """
    result, tick = [], 1e-9 * float(np.median(np.diff(run.state_stamps)))
    for limit, column in zip(LIMITS, run.limited.T):
        active = np.flatnonzero(column > 0.0)
        if not len(active):
            continue
        parts = np.flatnonzero(np.diff(run.state_stamps[active]) > SAME_EVENT_NS) + 1
        ends = np.array([(run.state_stamps[part[0]], run.state_stamps[part[-1]])
                         for part in np.split(active, parts)])
        begins, ends = (ends.T - run.state_stamps[0]) * 1e-9
        result.append(Limited(limit, begins, ends + tick, tick * len(active),
                              float(column.max())))
    return sorted(result, key=lambda one: float(one.begins[0]))


def _motions(run: Run) -> list[tuple[int, str]]:
    moving = run.moving
    edges = np.flatnonzero(np.diff(moving.astype(int), prepend=0, append=0))
    merged: list[list[int]] = []
    for first, last in zip(edges[::2], edges[1::2]):
        begin = int(run.reference_stamps[first])
        end = int(run.reference_stamps[min(last, len(moving) - 1)])
        if merged and begin - merged[-1][1] < PAUSE_NS:
            merged[-1][1] = end
        else:
            merged.append([begin, end])
    return [event for begin, end in merged for event in (
        (begin, 'the reference begins to move'),
        (end, f'the reference stops, after {(end - begin) * 1e-9:.2f} s'))]


def _interruptions(run: Run) -> list[tuple[int, str]]:
    stamps = run.reference_stamps
    result = [(int(stamps[i]), f'no reference for {(stamps[i + 1] - stamps[i]) * 1e-6:.0f} ms')
              for i in np.flatnonzero(np.diff(stamps) > INTERRUPTION_NS)]
    steps = np.diff(run.sequences.astype(np.int64))
    result += [(int(stamps[i + 1]), 'another stream of references begins')
               for i in np.flatnonzero(np.abs(steps) >= ONE_STREAM)]
    return result


def _goals(run: Run) -> list[tuple[int, str]]:
    stamps, goals = run.goal_stamps, run.goals
    away = np.linalg.norm(np.diff(goals[:, :3], axis=0), axis=1)
    turned = rotation_angles(goals[1:, 3:], goals[:-1, 3:])
    changed = np.flatnonzero((away > OTHER_GOAL) | (turned > OTHER_GOAL))
    if not len(changed):
        return []
    parts = np.flatnonzero(np.diff(stamps[changed]) > GOAL_MOVES_NS) + 1
    result = []
    for part in np.split(changed, parts):
        first, last = part[0], part[-1] + 1
        angle = rotation_angles(goals[last:last + 1, 3:], goals[first:first + 1, 3:])[0]
        by = f'{np.linalg.norm(goals[last, :3] - goals[first, :3]):.3f} m, {angle:.2f} rad'
        seconds = (stamps[last] - stamps[first + 1]) * 1e-9
        result.append((int(stamps[first + 1]), f'the goal changes by {by}' if len(part) == 1 else
                       f'the goal moves for {seconds:.1f} s, by {by}'))
    return result
