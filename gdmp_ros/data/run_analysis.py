"""What a recorded run says: figures, and events in the order they happened."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gdmp_ros.control.limits import LIMITS
from gdmp_ros.data import runs
from gdmp_ros.data.runs import Run
from gdmp_ros.manifolds import UnitQuaternion

#: References further apart are an interruption [ns].
GAP_NS = 20_000_000
#: A limit that lets go for less than this is still the same event [ns].
SAME_NS = 200_000_000
#: References that stand for so long are a pause between motions [ns].
STAND_NS = 100_000_000
#: References published so long after their stamps have stamps of another clock [s].
OTHER_CLOCK_S = 10.0


class Event(NamedTuple):
    """
    Something that happened.

    :ivar time: since the first state [s]
    """

    time: float
    what: str


class Tracking(NamedTuple):
    """
    How far the arm was from what it followed.

    :ivar states: indices of the states that followed a recorded reference
    :ivar away: distances [m]
    :ivar turned: angles [rad]
    """

    states: np.ndarray
    away: np.ndarray
    turned: np.ndarray


def tracking(run: Run) -> Tracking:
    """Compare the measured pose with the reference that was being followed, state by state."""
    order = np.argsort(run.sequences, kind='stable')
    at = np.minimum(np.searchsorted(run.sequences[order], run.applied), len(order) - 1)
    index = order[at]
    states = np.flatnonzero(run.sequences[index] == run.applied)
    wanted, had = run.references[index[states]], run.poses[states]
    away = np.linalg.norm(had[:, :3] - wanted[:, :3], axis=1)
    manifold = UnitQuaternion()
    turned = np.array([2.0 * manifold.distance(a, manifold.align(b, a))
                       for a, b in zip(had[:, 3:], wanted[:, 3:])])
    return Tracking(states, away, turned)


def lateness(run: Run) -> np.ndarray:
    """How long after its stamp, which is its deadline, each reference was published [s]."""
    return np.asarray((run.published - run.reference_stamps) * 1e-9)


def events(run: Run) -> list[Event]:
    """Motions, interruptions, other streams, and limits that bit, in order."""
    found = [*_motions(run), *_interruptions(run), *_bites(run)]
    origin = run.state_stamps[0]
    return [Event((stamp - origin) * 1e-9, what) for stamp, what in sorted(found)]


def _motions(run: Run) -> list[tuple[int, str]]:
    moving, result = run.moving, []
    edges = np.flatnonzero(np.diff(moving.astype(int), prepend=0, append=0))
    spans = [[run.reference_stamps[a], run.reference_stamps[min(b, len(moving) - 1)]]
             for a, b in zip(edges[::2], edges[1::2])]
    merged: list[list[int]] = []
    for begin, end in spans:
        if merged and begin - merged[-1][1] < STAND_NS:
            merged[-1][1] = end
        else:
            merged.append([begin, end])
    for begin, end in merged:
        result += [(int(begin), 'the reference begins to move'),
                   (int(end), f'it stands, after {(end - begin) * 1e-9:.2f} s')]
    return result


def _interruptions(run: Run) -> list[tuple[int, str]]:
    stamps, result = run.reference_stamps, []
    for i in np.flatnonzero(np.diff(stamps) > GAP_NS):
        result.append((int(stamps[i]), f'no reference for {(stamps[i + 1] - stamps[i]) * 1e-6:.0f}'
                                       ' ms'))
    steps = np.diff(run.sequences.astype(np.int64))
    for i in np.flatnonzero(np.abs(steps) >= runs.ONE_STREAM):
        result.append((int(stamps[i + 1]), 'another stream of references begins'))
    return result


def _bites(run: Run) -> list[tuple[int, str]]:
    result = []
    for limit, column in zip(LIMITS, run.limited.T):
        biting = np.flatnonzero(column > 0.0)
        if not len(biting):
            continue
        parts = np.flatnonzero(np.diff(run.state_stamps[biting]) > SAME_NS) + 1
        for part in np.split(biting, parts):
            most = float(np.max(column[part]))
            seconds = (run.state_stamps[part[-1]] - run.state_stamps[part[0]]) * 1e-9
            result.append((int(run.state_stamps[part[0]]),
                           f'limited: {limit.name} by up to {most:.3g} {limit.unit}, for '
                           f'{seconds:.2f} s'))
    return result


def figures(run: Run, tracked: Tracking) -> list[tuple[str, str]]:
    """Rows of the summary."""
    states, away, turned = tracked
    late = 1e6 * lateness(run)
    told = np.abs(np.median(late)) < 1e6 * OTHER_CLOCK_S
    seconds = np.ptp(run.reference_stamps) * 1e-9
    speed = np.linalg.norm(run.twists[:, :3], axis=1)
    rows = [
        ('duration', f'{np.ptp(run.state_stamps) * 1e-9:.2f} s'),
        ('references', f'{len(run.sequences)}, {len(run.sequences) / max(seconds, 1e-9):.1f} a '
                       'second'),
        ('references lost', f'{runs.lost(run)}'),
        ('lateness p50, p99, max', ', '.join(f'{value:.0f}' for value in (
            *np.percentile(late, [50, 99]), late.max())) + ' µs' if told else
         'not known: the stamps are of another clock'),
        ('fastest', f'{speed.max():.3f} m/s'),
        ('least energy in the tank', f'{run.tank.min():.2f} J'),
    ]
    if len(states):
        rows.insert(3, ('tracking, RMS', f'{1e3 * np.sqrt(np.mean(away ** 2)):.2f} mm, '
                                         f'{np.sqrt(np.mean(turned ** 2)):.4f} rad'))
        rows.insert(4, ('tracking, largest', f'{1e3 * away.max():.2f} mm, {turned.max():.4f} rad'))
    return rows
