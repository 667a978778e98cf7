"""Time of learning, compared with movement_primitives."""
from __future__ import annotations

from typing import Any

from experiments import timing
from experiments.bench.peers import CartesianPeer
from gdmp_ros.dmp.skill import Skill

TITLE = 'learning a pose skill: 1000 samples, 50 basis functions'


def run(settings: timing.TimingSettings) -> dict[str, Any]:
    """Figures; the keys are those of the file."""
    shown = timing.demonstration(timing.POSE, 5.0)
    stiff = timing.demonstration(timing.pose_with_stiffness(3), 5.0)
    peer = CartesianPeer(shown, 50)
    count = settings.repetitions
    Skill.learn(shown, 50)
    with timing.one_core():
        return {
            'pose_ms': timing.median_time(lambda: lambda: Skill.learn(shown, 50), 5,
                                          count) * 1e3,
            'pose_stiffness_ms': timing.median_time(lambda: lambda: Skill.learn(stiff, 50), 5,
                                                    count) * 1e3,
            'peer_pose_ms': timing.median_time(lambda: peer.learn, 1, count) * 1e3}


def rows(document: dict[str, Any]) -> list[list[str]]:
    """Table: heading, then lines."""
    peer = document['peer_pose_ms']
    return [['learning', 'ms', 'faster than the peer'],
            ['pose', f'{document["pose_ms"]:.2f}', f'{peer / document["pose_ms"]:.0f} ×'],
            ['pose + SPD(3)', f'{document["pose_stiffness_ms"]:.2f}', ''],
            ['movement_primitives, pose', f'{peer:.1f}', '']]
