"""Commands for a gripper that were recorded with demonstrations, as events of a skill."""
from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from rosbags.highlevel import AnyReader

from gdmp_ros.control.gripper import DEFAULT_SPEED
from gdmp_ros.data.bags import GRIPPER, message_of, NS
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.events import GripperEvent
from gdmp_ros.errors import DataError
from gdmp_ros.learning.alignment import align

#: Commands that are this close after one another in time and equal are one [s].
REPEATED_S = 0.1


class RecordedCommand(NamedTuple):
    """
    A command that was recorded.

    :ivar stamp: [ns]
    :ivar width: [m]
    :ivar force: [N]
    :ivar speed: [m/s]
    """

    stamp: int
    width: float
    force: float
    speed: float


def commands_in(reader: AnyReader, bag: str) -> list[RecordedCommand]:
    """
    Commands for a gripper in an open bag.

    :raises DataError: if there are several topics with such commands
    """
    connections = [c for c in reader.connections if c.msgtype == GRIPPER]
    topics = sorted({c.topic for c in connections})
    if len(topics) > 1:
        raise DataError(f'{bag}: there are commands for several grippers: {", ".join(topics)}')
    result: list[RecordedCommand] = []
    for connection, bag_time, raw in reader.messages(connections) if connections else ():
        message = message_of(reader, connection, raw)
        stamp = message.header.stamp.sec * NS + message.header.stamp.nanosec or bag_time
        command = RecordedCommand(stamp, float(message.width), float(message.force),
                                  float(message.speed) or DEFAULT_SPEED)
        if result and result[-1][1:] == command[1:] and (
                command.stamp - result[-1].stamp < REPEATED_S * NS):
            continue
        result.append(command)
    return result


def during(commands: Sequence[RecordedCommand], first: int, last: int
           ) -> tuple[GripperEvent, ...]:
    """
    The commands as events of the demonstration between two stamps [ns].

    Those before it count at its beginning (of several the last one), those after it at its end.
    """
    result: list[GripperEvent] = []
    for one in commands:
        progress = float(np.clip((one.stamp - first) / (last - first), 0.0, 1.0))
        if progress == 0.0 and result:
            result.clear()
        result.append(GripperEvent(progress, one.width, one.force, one.speed))
    return tuple(result)


def common_events(takes: Sequence[Demonstration], names: Sequence[str],
                  events: Sequence[tuple[GripperEvent, ...]]) -> tuple[GripperEvent, ...]:
    """
    Events of several takes, at their usual progress after the alignment of the takes in time.

    :param names: of the takes, for messages
    :param events: of each take
    :raises DataError: if the takes do not have the same commands in the same order
    """
    kinds = [[event.force > 0.0 for event in one] for one in events]
    for name, kind in zip(names, kinds):
        if kind != kinds[0]:
            raise DataError(f'{name}: the gripper was told {_words(kind)}, in {names[0]} '
                            f'{_words(kinds[0])}: a skill needs the same commands in all takes')
    if not kinds[0]:
        return ()
    found = align(takes)
    places = np.array([[np.interp(event.progress, warp, found.progress) for event in one]
                       for one, warp in zip(events, found.warps)])
    numbers = np.median(np.array([[event[1:] for event in one] for one in events]), axis=0)
    usual = np.maximum.accumulate(np.median(places, axis=0))
    return tuple(GripperEvent(float(progress), *map(float, row))
                 for progress, row in zip(usual, numbers))


def _words(kind: Sequence[bool]) -> str:
    return ', '.join('to hold' if holds else 'to move' for holds in kind) or 'nothing'
