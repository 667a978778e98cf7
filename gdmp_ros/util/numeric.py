"""Numbers that somebody gave."""
from __future__ import annotations

from typing import Any

import numpy as np

from gdmp_ros.errors import GdmpError, ParameterError


def numbers(name: str, given: Any, error: type[GdmpError] = ParameterError) -> np.ndarray:
    """
    What was given as an array, float64.

    :param name: of it, in the message
    :raises error: if it is not numbers, or not in equal rows
    """
    try:
        return np.asarray(given, dtype=np.float64)
    except (OverflowError, TypeError, ValueError):
        raise error(f'{name}: expected numbers, got {given!r:.80}') from None
