"""What the adapter sends, and how often."""
from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation


class Output:
    """One output of the adapter, with a largest rate."""

    def __init__(self, rate_hz: float, send: Callable[[Any], None]):
        self.send = send
        self._period = 1.0 / rate_hz
        self._next = 0.0

    def due(self, now: float) -> bool:
        """Whether to send again at a time of the monotonic clock [s]."""
        # Half a tick of tolerance, because references arrive a little early or late.
        if now < self._next - 0.5e-3:
            return False
        self._next = max(self._next + self._period, now)
        return True


class Command(NamedTuple):
    """
    A reference for other controllers.

    :ivar pose: (x, y, z, qw, qx, qy, qz)
    :ivar stiffness: 6×6 [N/m, Nm/rad]
    :ivar stamp_ns: of the reference
    """

    pose: np.ndarray
    stiffness: np.ndarray
    stamp_ns: int


def along_axes(stiffness: np.ndarray, quaternion: np.ndarray | None) -> np.ndarray:
    """
    Diagonal of a stiffness in the axes of the base or of the tool.

    :param stiffness: 6×6, base frame
    :param quaternion: of the tool (wxyz); None for the axes of the base
    """
    if quaternion is None:
        return np.diag(stiffness).copy()
    rotation = Rotation.from_quat(np.roll(quaternion, -1)).as_matrix()
    return np.concatenate([np.diag(rotation.T @ stiffness[:3, :3] @ rotation),
                           np.diag(rotation.T @ stiffness[3:, 3:] @ rotation)])
