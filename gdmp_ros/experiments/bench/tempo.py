"""Whether the path survives a change of tempo: 1 s to 2 s at mid-run, beside the peer's."""
from __future__ import annotations

from typing import Any

import numpy as np

from gdmp_ros.dmp import Demonstration, Rollout, Skill
from gdmp_ros.experiments import timing as measure
from gdmp_ros.experiments.bench.peers import CartesianPeer

TITLE = 'duration changed from 1 s to 2 s at mid-run'
DT, DURATION = 1e-3, 1.0


def run(settings: measure.Settings) -> dict[str, Any]:
    """Largest distance from the path as learned: geodesic for ours, metres for the peer's."""
    shown = measure.demonstration(measure.POSE, DURATION)
    skill = Skill.learn(shown, 50)
    rollout, points, progress, rates = Rollout(skill), [], [], []
    for tick in range(round(2.0 * DURATION / DT)):
        if tick == round(0.5 * DURATION / DT):
            rollout.set_speed(0.5)
        points.append(rollout.advance(DT).point)
        progress.append(rollout.progress)
        rates.append(rollout.speed)
    whole = Rollout(skill).sample(np.array(progress) * skill.duration).points
    away = [skill.manifold.distance(a, b) for a, b in zip(points, whole)]
    ours = np.array(points)[:, :3]
    peer, path = _peer(shown, change=True), _peer(shown, change=False)
    return {'path_deviation': float(max(away)),
            'largest_rate': float(np.abs(np.diff(rates)).max() / DT),
            'peer_path_deviation_m': _from_path(peer, path),
            'times': (DT * np.arange(len(ours))).tolist(), 'path': ours.tolist(),
            'peer_path': peer.tolist(), 'peer_unchanged': path.tolist()}


def _peer(shown: Demonstration, change: bool) -> np.ndarray:
    peer = CartesianPeer(shown, 50, DT)
    peer.learn()
    peer.begin()
    points = []
    for tick in range(round((1.5 if change else 1.0) * DURATION / DT)):
        if change and tick == round(0.5 * DURATION / DT):
            peer.dmp.execution_time = 2.0 * DURATION
            # Its clock runs in seconds of the execution time: the phase goes on from one half.
            peer.dmp.t = peer.dmp.last_t = 0.5 * 2.0 * DURATION
        points.append(peer.step()[:3].copy())
    return np.array(points)


def _from_path(points: np.ndarray, path: np.ndarray) -> float:
    """Largest distance of a point from a polyline's nodes [m]."""
    return float(max(np.linalg.norm(path - point, axis=1).min() for point in points))


def rows(document: dict[str, Any]) -> list[list[str]]:
    """Table: heads, then lines."""
    return [['', 'gdmp_ros', 'movement_primitives'],
            ['largest distance from the path', f'{document["path_deviation"]:.1e}',
             f'{document["peer_path_deviation_m"] * 1e3:.0f} mm'],
            ['largest change of the tempo [1/s]', f'{document["largest_rate"]:.1f}',
             'at once']]


def draw(document: dict[str, Any], axes: Any) -> None:
    """Both paths, seen from above."""
    for key, style, name in (('path', '-', 'gdmp_ros'), ('peer_path', ':', 'movement_primitives'),
                             ('peer_unchanged', '--', 'movement_primitives, unchanged')):
        points = np.array(document[key])
        axes.plot(points[:, 0], points[:, 1], style, color='black', label=name)
    axes.set(xlabel='x [m]', ylabel='y [m]', title=TITLE)
    axes.legend()
