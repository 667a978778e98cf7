"""How far two places of the robot are from each other."""
from __future__ import annotations

from typing import NamedTuple


class Distance(NamedTuple):
    """
    Distance between two poses [m, rad]; between two postures the largest one of a joint [rad].
    """

    position: float
    rotation: float

    def within(self, position: float, rotation: float) -> bool:
        """Whether both are at most this large."""
        return self.position <= position and self.rotation <= rotation

    def __str__(self) -> str:
        return f'{1e3 * self.position:.1f} mm and {self.rotation:.3f} rad'
