"""What a gripper is told, and what it tells; simulated or real."""
from __future__ import annotations

import math
from typing import NamedTuple, Protocol

from gdmp_ros.errors import ParameterError

#: Speed of the fingers if a command has none [m/s].
DEFAULT_SPEED = 0.1
#: Something is held if the fingers are further apart than they were to be [m].
HELD_M = 0.001


class GripperCommand(NamedTuple):
    """
    What a gripper is to do.

    :ivar width: between the fingers [m]
    :ivar force: with which it holds what is between them [N]; 0: move to the width only
    :ivar speed: of the fingers [m/s]
    """

    width: float
    force: float = 0.0
    speed: float = DEFAULT_SPEED


class GripperState(NamedTuple):
    """
    State of a gripper.

    :ivar width: between the fingers [m]
    :ivar widest: largest width [m]
    :ivar moving: whether a command is being carried out
    :ivar holding: whether something is between the fingers
    :ivar commands: number of commands that were begun
    :ivar problem: why the last command failed; empty if it did not
    """

    width: float
    widest: float
    moving: bool
    holding: bool
    commands: int
    problem: str = ''


class Gripper(Protocol):
    """A gripper; any thread may use it."""

    @property
    def state(self) -> GripperState:
        """The newest state."""

    def command(self, command: GripperCommand) -> int:
        """
        Begin a command; a newer one replaces it.

        :returns: its number: that of `GripperState.commands` from then on
        :raises ParameterError: if it is not possible
        """


def check_command(command: GripperCommand, widest: float, strongest: float) -> None:
    """
    Check a command.

    :param widest: largest width [m]
    :param strongest: largest force [N]
    :raises ParameterError: if a number is out of range
    """
    for name, value, most, unit in (('width', command.width, widest, 'm'),
                                    ('force', command.force, strongest, 'N'),
                                    ('speed', command.speed, 1.0, 'm/s')):
        if not (math.isfinite(value) and 0.0 <= value <= most):
            raise ParameterError(f'gripper: {name} is {value:.4g} {unit}, expected 0 to '
                                 f'{most:.4g} {unit}')
    if command.speed == 0.0:
        raise ParameterError('gripper: speed is 0 m/s, expected more')
