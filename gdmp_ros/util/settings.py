"""Settings as dataclass fields that carry their description, unit and range."""
from __future__ import annotations

from dataclasses import dataclass, field, Field, fields
from typing import Any


@dataclass(frozen=True)
class About:
    """
    What is known of a setting besides its default.

    :ivar unit: empty if there is none
    :ivar low: smallest value, None without bound
    :ivar high: largest value
    """

    description: str
    unit: str = ''
    low: float | None = None
    high: float | None = None


def setting(default: Any, description: str, unit: str = '', low: float | None = None,
            high: float | None = None) -> Any:
    """Field of a settings dataclass; parameters of nodes are declared from it."""
    return field(default=default, metadata={'about': About(description, unit, low, high)})


def about(settings_class: Any) -> dict[str, tuple[Any, About]]:
    """Default and description of each setting of a dataclass, by name."""
    found: tuple[Field[Any], ...] = fields(settings_class)
    return {one.name: (one.default, one.metadata['about'])
            for one in found if 'about' in one.metadata}
