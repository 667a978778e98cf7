"""What the user of the studio has changed in a skill."""
from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from gdmp_ros.dmp.skill import Skill


@dataclass(eq=False)
class Changes:
    """
    What the user has changed in a skill.

    :ivar start: pose (x, y, z, qw, qx, qy, qz); None for that of the skill
    :ivar goal: the same
    :ivar via: positions by progress, 0 to 1 [m]
    :ivar duration: [s]; None for that of the skill
    :ivar corrections: the skill with corrections by hand, before the other changes; newest last
    """

    start: np.ndarray | None = None
    goal: np.ndarray | None = None
    via: dict[float, np.ndarray] = field(default_factory=dict)
    duration: float | None = None
    corrections: tuple[Skill, ...] = ()

    def copy(self) -> Changes:
        """The same changes, which stay as they are."""
        return replace(self, via=dict(self.via))

    def __eq__(self, other: object) -> bool:
        return (isinstance(other, Changes) and repr(self) == repr(other)
                and self.corrections == other.corrections)

    def __bool__(self) -> bool:
        return bool(self.via or self.corrections) or any(
            one is not None for one in (self.start, self.goal, self.duration))
