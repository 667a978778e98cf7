"""What figures of matplotlib and of plotly have in common: colours and ellipsoids."""
from __future__ import annotations

import numpy as np

INK = ('#1b4f8a', '#c1440e', '#2e7d32', '#6a3d9a', '#444444', '#b8860b')
#: Length of the longest half-axis of all ellipsoids in a figure [m].
ELLIPSOID_M = 0.035


def evenly(positions: np.ndarray, count: int) -> np.ndarray:
    """
    Samples at equal distances along a path.

    :param positions: shape ``(T, 3)``
    :returns: indices, shape ``(count,)``
    """
    steps = np.linalg.norm(np.diff(positions, axis=0, prepend=positions[:1]), axis=1)
    passed = np.cumsum(steps)
    at = np.searchsorted(passed, np.linspace(0.0, passed[-1], count))
    return np.minimum(at, len(positions) - 1)
