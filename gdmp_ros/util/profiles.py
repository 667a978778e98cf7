"""Scalar time profiles from 0 to 1, for Python and for kernels."""
from __future__ import annotations

from typing import Any

from gdmp_ros.kernels import jitable


@jitable
def smoothstep(u: Any) -> Any:
    """``3 u² - 2 u³``: from 0 to 1 with zero slope at both ends; also of an array."""
    return u * u * (3.0 - 2.0 * u)


@jitable
def minimum_jerk(u: Any) -> Any:
    """``10 u³ - 15 u⁴ + 6 u⁵``: from 0 to 1, at rest at both ends; also of an array."""
    return u * u * u * (10.0 - 15.0 * u + 6.0 * u * u)
