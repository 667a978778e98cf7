"""The bounds of a stream, whatever its references are of."""
from __future__ import annotations

import numpy as np

from gdmp_ros.playback.stream_settings import StreamSettings
from gdmp_ros.playback.streamed_skill import Bounds, Kind, StreamedSkill


class BoundedStream:
    """Bounds references; those of another kind begin another stream."""

    def __init__(self, settings: StreamSettings):
        self._settings = settings
        self._bounds: Bounds | None = None
        self._kind, self._before = Kind.TOOL, 0

    @property
    def bounded(self) -> int:
        """Ticks in which the bounds were active."""
        return self._before + (0 if self._bounds is None else self._bounds.bounded)

    def configure(self, settings: StreamSettings) -> None:
        """Use other bounds from now on."""
        self._settings = settings
        if self._bounds is not None:
            self._bounds.configure(settings)

    def reset(self) -> None:
        """The next reference begins a stream."""
        self._before, self._bounds = self.bounded, None

    def apply(self, skill: StreamedSkill, target: np.ndarray, dt: float) -> np.ndarray:
        """
        Bound the reference of a tick.

        :param skill: that is played
        :returns: the same array every time
        """
        if self._bounds is None or skill.kind is not self._kind:
            self.reset()
            self._bounds, self._kind = skill.bounds(self._settings), skill.kind
        return self._bounds.apply(target, dt)
