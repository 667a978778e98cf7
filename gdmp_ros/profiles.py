"""How far along a path one is over time."""
from __future__ import annotations

from typing import Any


def minimum_jerk(t: Any) -> Any:
    """Give ``10 t³ - 15 t⁴ + 6 t⁵``: from 0 to 1, at rest at both ends; also of an array."""
    return t ** 3 * (10.0 - 15.0 * t + 6.0 * t * t)
