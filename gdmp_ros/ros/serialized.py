"""
Serialised messages: read without deserialising, and templates in which only numbers change.

Serialising a Python message takes 20 µs or more; writing stamp and numbers into a serialised one
takes 2 µs. Their positions are found by serialising a message with known marks.
"""
from __future__ import annotations

from collections.abc import Callable
import math
import struct
from typing import Any, TypeAlias

from geometry_msgs.msg import PoseStamped
import numpy as np
from rclpy.serialization import deserialize_message, serialize_message

from gdmp_ros.control.reference_check import QUATERNION_TOLERANCE
from gdmp_ros.errors import DataError
from gdmp_ros.ros.messages import checked_pose, NS

#: Serialised data; the name ``bytes`` is a method below.
Buffer: TypeAlias = bytes
_HEADER = 4  # bytes of CDR encapsulation; alignment is relative to its end
_MARK = 1e-200
_BYTES = (0, 165, 90, 255, 15, 240, 1)  # that an integer is set to, to find it


def deserialized(data: Buffer, kind: Any) -> Any:
    """
    Read a serialised message.

    :raises DataError: if it is not one of this type
    """
    try:
        return deserialize_message(data, kind)
    except RuntimeError as error:
        raise DataError(f'not a {kind.__name__}: {error}') from None


class PoseReader:
    """
    Reads serialised PoseStamped messages of one frame, quickly, and those of others.

    It takes a tenth of the time of `checked_pose` with deserialisation.
    """

    def __init__(self, frame: str, other: Callable[[PoseStamped], np.ndarray] | None = None):
        """
        Prepare.

        :param frame: ``frame_id`` that the poses have
        :param other: gives the pose of a message with another one; by default it is refused
        """
        self._other = other or (lambda message: checked_pose(message, frame))
        message = PoseStamped()
        message.header.frame_id = frame
        data = serialize_message(message)
        self._size, self._numbers = len(data), len(data) - 7 * 8
        # Encapsulation; behind the stamp the string of the frame.
        self._begin, self._string = data[:_HEADER], data[_HEADER + 8:_HEADER + 12 + len(frame)]

    def read(self, data: Buffer) -> np.ndarray:
        """
        (x, y, z, qw, qx, qy, qz), normalised.

        :raises GdmpError: as `checked_pose`, `deserialized` and ``other``
        """
        if (len(data) >= self._size and data[:_HEADER] == self._begin
                and data[_HEADER + 8:_HEADER + 8 + len(self._string)] == self._string):
            x, y, z, qx, qy, qz, qw = struct.unpack_from('<7d', data, self._numbers)
            norm = math.sqrt(qw * qw + qx * qx + qy * qy + qz * qz)
            if math.isfinite(x + y + z) and abs(norm - 1.0) <= QUATERNION_TOLERANCE:
                return np.array([x, y, z, qw / norm, qx / norm, qy / norm, qz / norm])
        return self._other(deserialized(data, PoseStamped))


class SerializedTemplate:
    """A serialised message in which stamp, counters, mode and numbers are replaced."""

    def __init__(self, message: Any, count: int, fill: Callable[[Any, np.ndarray], None]):
        """
        Find the positions of what is replaced: counters are ``sequence`` and ``tick``.

        :param message: with its strings (frame); they cannot change later
        :param count: number of numbers
        :param fill: writes the numbers to the message
        """
        marks = _MARK * (1.0 + np.arange(count))
        fill(message, marks)
        self._stamped = hasattr(message, 'header')
        self._integers = [(_position_of(message, name), form)
                          for name, form in (('sequence', '<Q'), ('mode', '<B'), ('tick', '<Q'))
                          if hasattr(message, name)]
        data = bytearray(serialize_message(message))
        data += b'\0' * (-(len(data) - _HEADER) % 8)
        self._size = len(serialize_message(message))
        self._data = data
        self._doubles = np.frombuffer(data, dtype='<f8', offset=_HEADER)
        self._positions = np.array([_find(self._doubles, mark) for mark in marks])

    def bytes(self, numbers: np.ndarray, stamp_ns: int = 0, *integers: int) -> bytes:
        """
        Serialised message with these values.

        :param integers: of ``sequence``, ``mode`` and ``tick``, as far as the message has them
        """
        if self._stamped:
            struct.pack_into('<iI', self._data, _HEADER, stamp_ns // NS, stamp_ns % NS)
        self._doubles[self._positions] = numbers
        for (position, form), value in zip(self._integers, integers):
            struct.pack_into(form, self._data, position, value)
        return bytes(memoryview(self._data)[:self._size])

    def sequence_of(self, data: Buffer) -> int:
        """Sequence number of a serialised message with these strings."""
        return int(struct.unpack_from('<Q', data, self._integers[0][0])[0])

    def numbers_of(self, data: Buffer) -> np.ndarray:
        """Numbers of a serialised message with these strings."""
        count = (len(data) - _HEADER) // 8
        return np.asarray(np.frombuffer(data, '<f8', count, _HEADER)[self._positions])


def stamp_ns_of(data: Buffer) -> int:
    """Stamp of a serialised message that begins with a header [ns]."""
    seconds, ns = struct.unpack_from('<iI', data, _HEADER)
    return int(seconds) * NS + int(ns)


def _position_of(message: Any, name: str) -> int:
    """First byte of an integer in the serialised message."""
    data = []
    for value in _BYTES:
        setattr(message, name, value)
        data.append(serialize_message(message))
    setattr(message, name, 0)
    # Little-endian: the lowest byte is the value. Padding holds whatever the memory held before.
    found = [i for i, shown in enumerate(zip(*data)) if shown == _BYTES]
    if len(found) != 1:
        raise RuntimeError(f'unknown serialisation: {name} was found {len(found)} times')
    return found[0]


def _find(values: np.ndarray, mark: Any) -> int:
    found = np.flatnonzero(values == mark)
    if len(found) != 1:
        raise RuntimeError(f'unknown serialisation: a mark was found {len(found)} times')
    return int(found[0])
