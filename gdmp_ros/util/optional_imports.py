"""Imports of packages that may not be installed, with an error that says where they come from."""
from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from gdmp_ros.errors import DataError

#: Origin of rclpy and of the message packages.
ROS = ': the nodes need ROS 2 (make setup)'
#: Extras of packages that files for ROS import too.
_EXTRAS = {'psutil': 'faults', 'mujoco': 'sim'}


def extra(name: str) -> str:
    """Origin of a package that an extra of this one installs."""
    return f", it comes with pip install '.[{name}]' in the folder of gdmp_ros"


@contextmanager
def optional_import(origin: str) -> Iterator[None]:
    """
    Run imports that may fail.

    :param origin: where the packages come from: `ROS`, or an `extra`
    :raises DataError: naming the package that is missing or broken
    """
    try:
        yield
    except ModuleNotFoundError as error:
        if error.name in _EXTRAS:
            origin = extra(_EXTRAS[error.name])
        raise DataError(f'{error.name} is missing{origin}') from None
    except ImportError as error:  # installed, but something that it needs is not
        raise DataError(f'{error.name} cannot be used ({error}){origin}') from None
