"""Modules that may not be installed, and where they come from."""
from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from gdmp_ros.errors import DataError

ROS = ': the nodes need ROS 2 (make setup)'


def extra(name: str) -> str:
    """Say that a module comes with an extra of this package."""
    return f", it comes with pip install 'gdmp_ros[{name}]'"


@contextmanager
def needs(origin: str) -> Iterator[None]:
    """
    Do what imports something that may not be installed.

    :param origin: where it comes from: `ROS`, or an `extra`
    :raises DataError: naming the module that is missing or broken
    """
    try:
        yield
    except ModuleNotFoundError as error:
        raise DataError(f'{error.name} is missing{origin}') from None
    except ImportError as error:  # it is there, but what it needs is not
        raise DataError(f'{error.name} cannot be used ({error}){origin}') from None
