"""Settings as dataclass fields that carry their description, unit and range."""
from __future__ import annotations

from dataclasses import astuple, dataclass, Field, field, fields
from typing import Any

import numpy as np


@dataclass(frozen=True)
class About:
    """
    What is known of a setting besides its default.

    :ivar unit: empty if there is none
    :ivar low: smallest value, None without bound
    :ivar high: largest value
    :ivar choices: the strings allowed
    :ivar each: whether a tuple may have one entry for all, or one for each joint
    """

    description: str
    unit: str = ''
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()
    each: bool = False


def setting(default: Any, description: str, unit: str = '', low: float | None = None,
            high: float | None = None, choices: tuple[str, ...] = (), each: bool = False) -> Any:
    """Field of a settings dataclass; parameters of nodes are declared from it."""
    return field(default=default,
                 metadata={'about': About(description, unit, low, high, choices, each)})


def about(settings_class: Any) -> dict[str, tuple[Any, About]]:
    """Default and description of each setting of a dataclass, by name."""
    result: tuple[Field[Any], ...] = fields(settings_class)
    return {item.name: (item.default, item.metadata['about'])
            for item in result if 'about' in item.metadata}


def numbers_type(settings_class: Any) -> np.dtype:
    """Record type of the numbers and tuples of a settings dataclass, for kernels."""
    defaults: list[tuple[str, Any]] = [
        (item.name, item.default) for item in fields(settings_class)]
    shapes = [(name, np.shape(default)) for name, default in defaults]
    return np.dtype([(name, np.float64, shape) if shape else (name, np.float64)
                     for name, shape in shapes])


def numbers(settings: Any) -> np.ndarray:
    """The same numbers as a flat array, in the order of `numbers_type`."""
    return np.hstack([np.ravel(value) for value in astuple(settings)]).astype(float)
