"""What the last motion of the tool looked like: progress, references, measured poses."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gdmp_ros.dmp.skill import Skill
from gdmp_ros.playback.player import Player
from gdmp_ros.playback.states import Status
from gdmp_ros.playback.streamed_skill import Kind

#: Most samples: a motion of two hours.
MOST = 150_000


class _Sample(NamedTuple):
    progress: float
    reference: np.ndarray
    measured: np.ndarray


class MotionRecord:
    """
    Samples of one motion; one thread adds, any thread reads.

    :ivar motion: number of the motion (`gdmp_ros.playback.player.Player.start`)
    :ivar skill: that was executed; None before the first motion
    """

    def __init__(self) -> None:
        self.motion = 0
        self.skill: Skill | None = None
        self._samples: list[_Sample] = []

    def add(self, player: Player, reference: np.ndarray | None, measured: np.ndarray) -> None:
        """
        Add a sample while a motion of the tool is executed; another motion begins anew.

        :param reference: pose (x, y, z, qw, qx, qy, qz); None if there is none
        :param measured: pose
        """
        rollout, playing = player.rollout, player.playing
        if (player.status is not Status.MOVING or rollout is None or reference is None
                or playing.kind is not Kind.TOOL):
            return
        if player.motion != self.motion:
            self.motion, self.skill, self._samples = player.motion, playing.skill, []
        if len(self._samples) < MOST:
            self._samples.append(_Sample(rollout.progress, np.array(reference), measured))

    def arrays(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Progress ``(T,)``, references ``(T, 7)`` and measured poses ``(T, 7)``."""
        samples = tuple(self._samples)
        return (np.array([sample.progress for sample in samples]),
                np.array([sample.reference for sample in samples]).reshape(-1, 7),
                np.array([sample.measured for sample in samples]).reshape(-1, 7))
