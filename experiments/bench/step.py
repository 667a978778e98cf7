"""Time of a step (`Rollout.advance` from Python), compared with movement_primitives."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
import time
from typing import Any

import numpy as np

from experiments import timing
from experiments.bench.peers import CartesianPeer
from gdmp_ros.dmp.rollout import Batch, Rollout
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.manifolds.spd import SymmetricPositiveDefinite

TITLE = 'one step of a 5 s skill, 50 basis functions, dt 1 ms'
DT, DURATION, CALLS, BATCH = 1e-3, 5.0, 1500, 200
SPD_SIZES = (2, 3, 4, 6, 10, 20)


def measure_step(learned: Skill, repetitions: int, moving: bool = False,
                 clock: Callable[[], float] = time.perf_counter) -> float:
    """Median time of ``Rollout.advance(1 ms)`` from Python [µs]; see `timing.median_time`."""
    def prepare() -> Callable[[], object]:
        rollout = Rollout(learned)
        if moving:
            rollout.retarget(learned.manifold.geodesic(learned.goal, learned.start, 0.2))
        return lambda: rollout.advance(DT)

    return timing.median_time(prepare, CALLS, repetitions, clock) * 1e6


def measure_batch(repetitions: int) -> float:
    """Median time of a 1 ms step of 200 pose + stiffness skills in one call [µs]."""
    learned = [timing.skill(timing.pose_with_stiffness(3), DURATION, seed=seed)
               for seed in range(8)]

    def prepare() -> Callable[[], object]:
        batch = Batch([Rollout(learned[i % 8], duration=DURATION * (1.0 + 0.002 * i))
                       for i in range(BATCH)])
        return lambda: batch.advance(DT)

    return timing.median_time(prepare, 200, repetitions) * 1e6


def measure_peer(repetitions: int) -> float:
    """Median time of a step of the peer, pose only [µs]."""
    peer = CartesianPeer(timing.demonstration(timing.POSE, DURATION), 50, DT)
    peer.learn()

    def prepare() -> Callable[[], object]:
        peer.begin()
        return peer.step

    return timing.median_time(prepare, CALLS // 3, repetitions) * 1e6


def _with_frames() -> Skill:
    """The pose skill with two task frames."""
    shown = timing.demonstration(timing.POSE, DURATION)
    return Skill.learn(replace(shown, frames={
        name: np.concatenate([point[:3], [1.0, 0.0, 0.0, 0.0]])
        for name, point in (('start', shown.points[0]), ('goal', shown.points[-1]))}), 50)


def run(settings: timing.TimingSettings) -> dict[str, Any]:
    """Figures; the keys are those of the file."""
    count = settings.repetitions
    pose, three, six = (timing.skill(manifold, DURATION) for manifold in (
        timing.POSE, timing.pose_with_stiffness(3), timing.pose_with_stiffness(6)))
    with timing.one_core():
        return {
            'pose_us': measure_step(pose, count),
            'pose_frames_us': measure_step(_with_frames(), count),
            'pose_stiffness_us': measure_step(three, count),
            'pose_stiffness6_us': measure_step(six, count),
            'pose_stiffness6_moving_us': measure_step(six, count, moving=True),
            'batch200_us': measure_batch(count),
            'peer_pose_us': measure_peer(count),
            'spd_us': {str(m): measure_step(
                timing.skill(SymmetricPositiveDefinite(m), DURATION), count)
                       for m in SPD_SIZES}}


def rows(document: dict[str, Any]) -> list[list[str]]:
    """Table: heading, then lines."""
    ours = [('pose', 'pose_us'), ('… with two task frames', 'pose_frames_us'),
            ('pose + SPD(3) stiffness', 'pose_stiffness_us'),
            ('pose + SPD(6) stiffness', 'pose_stiffness6_us'),
            ('… with the goal moving', 'pose_stiffness6_moving_us'),
            (f'{BATCH} × pose + SPD(3) in one call', 'batch200_us')]
    peer = document['peer_pose_us']
    lines = [[name, f'{document[key]:.2f}', f'{peer / document[key]:.1f} ×' if i < 4 else '']
             for i, (name, key) in enumerate(ours)]
    lines += [[f'SPD({m})', f'{value:.2f}', ''] for m, value in document['spd_us'].items()]
    return [['step', 'µs', 'faster than the peer'], *lines,
            ['movement_primitives, pose', f'{peer:.2f}', '']]


def draw(document: dict[str, Any], axes: Any) -> None:
    """Times as bars."""
    keys = ['pose_us', 'pose_stiffness_us', 'pose_stiffness6_us', 'peer_pose_us']
    names = ['pose', 'pose +\nSPD(3)', 'pose +\nSPD(6)', 'movement_primitives\npose']
    values = np.array([document[key] for key in keys])
    bars = axes.bar(names, values, color='0.75', edgecolor='black',
                    hatch=['', '/', 'x', '..'], label='median')
    axes.bar_label(bars, fmt='%.1f')
    axes.set(yscale='log', ylabel='time of a step [µs]', title=TITLE)
    axes.legend()

