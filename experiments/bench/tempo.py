"""Path deviation after a change of tempo at mid-run, compared with movement_primitives."""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from experiments import timing
from experiments.bench.peers import CartesianPeer
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.rollout import Rollout
from gdmp_ros.dmp.skill import Skill

TITLE = 'duration changed from 1 s to 2 s at mid-run'
DT, DURATION = 1e-3, 1.0


class Change(NamedTuple):
    """
    How the duration of the peer is doubled at mid-run.

    :ivar call: what the user writes
    :ivar clock: whether its clock is set so that the phase continues
    :ivar velocity: whether the velocity is halved, as the slower motion needs it
    """

    call: str
    clock: bool
    velocity: bool


CHANGES = {
    'duration': Change('execution_time_ = 2; the phase jumps back', False, False),
    'duration_and_clock': Change('execution_time_ = 2, t = 1: the phase continues', True, False),
    'duration_clock_and_velocity': Change('execution_time_ = 2, t = 1, velocity halved', True,
                                          True)}


def run(settings: timing.TimingSettings) -> dict[str, Any]:
    """Largest distance from the learned path: geodesic for gdmp_ros, in metres for the peer."""
    shown = timing.demonstration(timing.POSE, DURATION)
    skill = Skill.learn(shown, 50)
    rollout, points, progress, rates = Rollout(skill), [], [], []
    for tick in range(round(2.0 * DURATION / DT)):
        if tick == round(0.5 * DURATION / DT):
            rollout.set_speed(0.5)
        points.append(rollout.advance(DT).point)
        progress.append(rollout.progress)
        rates.append(rollout.speed)
    unchanged = Rollout(skill).sample(np.array(progress) * skill.duration).points
    distances = [skill.manifold.distance(a, b) for a, b in zip(points, unchanged)]
    peer_path, _ = run_peer(shown, None)
    document: dict[str, Any] = {
        'path_deviation': float(max(distances)),
        'largest_rate': float(np.abs(np.diff(rates)).max() / DT),
        'times': (DT * np.arange(len(points))).tolist(),
        'path': np.array(points)[:, :3].tolist(), 'peer_unchanged': peer_path.tolist(), 'peer': {}}
    for name, change in CHANGES.items():
        path, duration = run_peer(shown, change)
        document['peer'][name] = {
            'call': change.call, 'execution_time_': duration, 'path': path.tolist(),
            'path_deviation_m': _distance_from_path(path, peer_path)}
    return document


def run_peer(shown: Demonstration, change: Change | None) -> tuple[np.ndarray, float]:
    """
    Run the peer.

    :returns: positions [m], shape ``(T, 3)``, and its duration at the end [s]
    """
    peer = CartesianPeer(shown, 50, DT)
    peer.learn()
    peer.begin()
    points = []
    for tick in range(round((1.0 if change is None else 1.5) * DURATION / DT)):
        if change is not None and tick == round(0.5 * DURATION / DT):
            # The name ends with an underscore: a property without it does not exist.
            peer.dmp.execution_time_ = 2.0 * DURATION
            if change.clock:
                peer.dmp.t = peer.dmp.last_t = 0.5 * 2.0 * DURATION
            if change.velocity:
                peer.velocity = 0.5 * peer.velocity
        points.append(peer.step()[:3].copy())
    return np.array(points), float(peer.dmp.execution_time_)


def _distance_from_path(points: np.ndarray, path: np.ndarray) -> float:
    """Largest distance of a point from the nearest sample of a path [m]."""
    return float(max(np.linalg.norm(path - point, axis=1).min() for point in points))


def rows(document: dict[str, Any]) -> list[list[str]]:
    """Table: heading, then lines."""
    lines = [['gdmp_ros', 'set_speed(0.5)', f'{document["path_deviation"]:.1e}',
              f'{document["largest_rate"]:.1f}']]
    lines += [['movement_primitives', one['call'], f'{1e3 * one["path_deviation_m"]:.1f} mm',
               'a step'] for one in document['peer'].values()]
    return [['', 'call', 'largest distance from the path', 'rate of the tempo [1/s]'], *lines]


def draw(document: dict[str, Any], axes: Any) -> None:
    """Paths seen from above."""
    paths: list[tuple[str, Any, Any]] = [
             ('gdmp_ros', '-', document['path']),
             ('movement_primitives, unchanged', '--', document['peer_unchanged'])]
    paths += [(f'movement_primitives, {one["call"]}', style, one['path'])
              for style, one in zip((':', '-.', (0, (1, 3))), document['peer'].values())]
    for i, (name, style, path) in enumerate(paths):
        points = np.array(path)
        axes.plot(points[:, 0], points[:, 1], ls=style, color=f'{0.15 * i}', label=name)
    axes.set(xlabel='x [m]', ylabel='y [m]', title=TITLE)
    axes.legend(fontsize=6)
