"""Events of a recorded run, in order: motions, interruptions, other streams, limits."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gdmp_ros.control.limits import LIMITS
from gdmp_ros.data.runs import ONE_STREAM, Run

#: References further apart than this are an interruption [ns].
INTERRUPTION_NS = 20_000_000
#: A limit that is not active for less than this is still the same event [ns].
SAME_EVENT_NS = 200_000_000
#: A reference at rest for this long is a pause between motions [ns].
PAUSE_NS = 100_000_000


class Event(NamedTuple):
    """
    Something that happened.

    :ivar time: since the first state [s]
    """

    time: float
    text: str


def events(run: Run) -> list[Event]:
    """All events of a run."""
    found = [*_motions(run), *_interruptions(run), *_limits(run)]
    origin = run.state_stamps[0]
    return [Event((stamp - origin) * 1e-9, text) for stamp, text in sorted(found)]


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


def _limits(run: Run) -> list[tuple[int, str]]:
    result = []
    for limit, column in zip(LIMITS, run.limited.T):
        active = np.flatnonzero(column > 0.0)
        if not len(active):
            continue
        parts = np.flatnonzero(np.diff(run.state_stamps[active]) > SAME_EVENT_NS) + 1
        for part in np.split(active, parts):
            seconds = (run.state_stamps[part[-1]] - run.state_stamps[part[0]]) * 1e-9
            result.append((int(run.state_stamps[part[0]]),
                           f'limit {limit.name} exceeded by up to {np.max(column[part]):.3g} '
                           f'{limit.unit}, for {seconds:.2f} s'))
    return result
