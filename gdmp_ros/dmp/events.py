"""What happens on the way of a motion besides the motion: commands for a gripper."""
from __future__ import annotations

import math
from typing import NamedTuple

from gdmp_ros.errors import ParameterError


class GripperEvent(NamedTuple):
    """
    A command for the gripper at a progress of the motion.

    :ivar progress: from 0 (start) to 1 (nominal end)
    :ivar width: between the fingers [m]
    :ivar force: with which the fingers press [N]; 0: they move to the width only
    :ivar speed: of the fingers [m/s]
    """

    progress: float
    width: float
    force: float
    speed: float


def checked_events(events: tuple[GripperEvent, ...]) -> tuple[GripperEvent, ...]:
    """
    Events in their order.

    :raises ParameterError: if a number is not finite or negative, a progress is beyond 1, or they
        are not in order
    """
    events = tuple(GripperEvent(*map(float, event)) for event in events)
    for number, event in enumerate(events):
        if not all(math.isfinite(value) and value >= 0.0 for value in event):
            raise ParameterError(f'gripper event {number}: {tuple(event)}, expected finite '
                                 'numbers of at least 0')
        if event.progress > 1.0 or event.speed == 0.0:
            raise ParameterError(f'gripper event {number}: progress is {event.progress:g}, '
                                 f'expected 0 to 1; speed is {event.speed:g} m/s, expected more '
                                 'than 0')
        if number and event.progress < events[number - 1].progress:
            raise ParameterError(f'gripper event {number}: progress is {event.progress:g}, before '
                                 f'that of the event before, {events[number - 1].progress:g}')
    return events
