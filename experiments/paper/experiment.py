"""Settings, data and verdict of an experiment."""
from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gdmp_ros.manifolds import SymmetricPositiveDefinite

#: In the order of the paper; two claims without a figure at the end.
IDS = ('fig2', 'fig3', 'letters', 'fig4', 'fig5', 'baselines', 'fig6', 'fig7', 'fig8', 'fig9',
       'fig10', 'fig11', 'fig12', 'table1', 'theorem1')
#: Results of a run: arrays by name.
Data = dict[str, np.ndarray]


@dataclass(frozen=True)
class Settings:
    """
    Settings of all experiments.

    :ivar letters: folder of the 2D-Letters data set, None without it
    :ivar ros: run robot tasks through the nodes instead of the same loop without ROS
    :ivar jobs: number of processes; -1 for one per core
    :ivar folder: for recordings and scenes of the robot tasks
    """

    letters: Path | None = None
    ros: bool = False
    jobs: int = -1
    folder: Path = Path('out/paper')


def spd_distances(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Geodesic distances between positive definite matrices, shape ``(T, m, m)`` each."""
    spd = SymmetricPositiveDefinite(first.shape[-1])
    return np.array([spd.distance(np.ascontiguousarray(a), np.ascontiguousarray(b))
                     for a, b in zip(first, second)])


class Verdict(NamedTuple):
    """
    Whether a claim holds (None if it could not be tried), with the measured figures.

    :ivar notes: for the reader: what to install, what differs from the paper
    """

    holds: bool | None
    measured: dict[str, Any]
    notes: str = ''
