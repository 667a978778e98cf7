"""Arguments as arrays of numbers."""
from __future__ import annotations

from typing import Any

import numpy as np

from gdmp_ros.errors import GdmpError, ParameterError


def numbers(name: str, given: Any, error: type[GdmpError] = ParameterError) -> np.ndarray:
    """
    An argument as an array, float64.

    :param name: of it, in the message
    :raises error: if it is not numbers, or not in equal rows
    """
    try:
        return np.asarray(given, dtype=np.float64)
    except (OverflowError, TypeError, ValueError):
        raise error(f'{name}: expected numbers, got {given!r:.80}') from None


def numbers_or_none(given: Any) -> np.ndarray:
    """The same; an empty array if it is not numbers, for a caller that checks the shape."""
    try:
        return numbers('', given)
    except ParameterError:
        return np.empty(0)
