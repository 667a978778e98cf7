"""
Serialised messages: read without deserialising, and templates in which only numbers change.

Serialising a Python message takes 20 µs or more; writing stamp and numbers into a serialised one
takes 2 µs. Their positions are found by serialising a message with known marks.
"""
from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
import math
import struct
from typing import Any, NamedTuple, TypeAlias

from gdmp_msgs.msg import Reference
from geometry_msgs.msg import PoseStamped
import numpy as np
from rclpy.serialization import serialize_message

from gdmp_ros.control.joint_target import joint_target_size
from gdmp_ros.control.reference_check import LARGEST_NUMBER, QUATERNION_TOLERANCE
from gdmp_ros.control.target import TARGET_SIZE
from gdmp_ros.data.bags import joint_target, ns_of, reference_target
from gdmp_ros.ros.messages import checked_pose, fill_joint_reference, fill_reference, NS
from gdmp_ros.ros.middleware import deserialized

#: Serialised data; the name ``bytes`` is a method below.
Buffer: TypeAlias = bytes
_HEADER = 4  # bytes of CDR encapsulation; alignment is relative to its end
_MARK = 1e-200
#: Kinds of messages of one topic that are known at once.
MOST_LAYOUTS = 8
_BYTES = (0, 165, 90, 255, 15, 240, 1)  # that an integer is set to, to find it
_SECONDS, _NANOSECONDS = 0x5AA50F00, 0x3C3CC3C3  # that a stamp is set to, to find it


class _FrameCheck:
    """Whether serialised messages have the encapsulation and the frame of another one."""

    def __init__(self, data: Buffer, frame: str):
        # Behind encapsulation and stamp the string of the frame, with its length.
        self._begin = data[:_HEADER]
        self._string = data[_HEADER + 8:_HEADER + 12 + len(frame.encode())]
        self._ends = _HEADER + 8 + len(self._string)

    def passes(self, data: Buffer) -> bool:
        return data[:_HEADER] == self._begin and data[_HEADER + 8:self._ends] == self._string


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
        self._frame = _FrameCheck(data, frame)

    def read(self, data: Buffer) -> np.ndarray:
        """
        (x, y, z, qw, qx, qy, qz), normalised.

        :raises GdmpError: as `checked_pose`, `deserialized` and ``other``
        """
        if len(data) >= self._size and self._frame.passes(data):
            x, y, z, qx, qy, qz, qw = struct.unpack_from('<7d', data, self._numbers)
            norm = math.sqrt(qw * qw + qx * qx + qy * qy + qz * qz)
            if (abs(x) <= LARGEST_NUMBER and abs(y) <= LARGEST_NUMBER and abs(z) <= LARGEST_NUMBER
                    and abs(norm - 1.0) <= QUATERNION_TOLERANCE):
                return np.array([x, y, z, qw / norm, qx / norm, qy / norm, qz / norm])
        return self._other(deserialized(data, PoseStamped))


class SerializedTemplate:
    """A serialised message in which stamps, counters, mode and numbers are replaced."""

    def __init__(self, message: Any, count: int, fill: Callable[[Any, np.ndarray], None],
                 headers: Sequence[Any] | None = None):
        """
        Find the positions of what is replaced: counters are ``sequence`` and ``tick``.

        :param message: with its strings (frame); they cannot change later
        :param count: number of numbers
        :param fill: writes the numbers to the message
        :param headers: in the message, all with the same stamp; by default its own, if it has one
        """
        marks = _MARK * (1.0 + np.arange(count))
        fill(message, marks)
        if headers is None:
            headers = [message.header] if hasattr(message, 'header') else []
        self._stamps = [_position_of_stamp(message, header.stamp) for header in headers]
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
        for position in self._stamps:
            struct.pack_into('<iI', self._data, position, stamp_ns // NS, stamp_ns % NS)
        self._doubles[self._positions] = numbers
        for (position, form), value in zip(self._integers, integers):
            struct.pack_into(form, self._data, position, value)
        return bytes(memoryview(self._data)[:self._size])

    @property
    def size(self) -> int:
        """Number of bytes."""
        return self._size

    def layout(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The message, and among its bytes the first of each number; of stamps and integers."""
        parts = [*self._stamps, *(position for position, _ in self._integers)]
        return (np.frombuffer(self.bytes(np.zeros(len(self._positions))), dtype=np.uint8).copy(),
                _HEADER + 8 * self._positions, np.array(parts, dtype=np.int64))

    def integers_of(self, data: Buffer) -> list[int]:
        """``sequence``, ``mode`` and ``tick`` of a serialised message, as far as it has them."""
        return [struct.unpack_from(form, data, position)[0] for position, form in self._integers]

    def numbers_of(self, data: Buffer) -> np.ndarray:
        """Numbers of a serialised message with these strings."""
        count = (len(data) - _HEADER) // 8
        return np.asarray(np.frombuffer(data, '<f8', count, _HEADER)[self._positions])


class Alike(NamedTuple):
    """
    Messages that differ in stamp and numbers only.

    :ivar about: what is known of them (`AlikeReader`)
    :ivar template: of them; None if they were serialised in another way than here
    :ivar same: bytes that are the same in all: the first, the end, and they
    """

    about: Any
    template: SerializedTemplate | None
    same: list[tuple[int, int, Buffer]]

    def fits(self, data: Buffer) -> bool:
        """Whether a serialised message is one of them."""
        return (self.template is not None and len(data) == self.template.size
                and all(data[first:end] == part for first, end, part in self.same))

    def layout(self) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        """A message, ranges of bytes that are the same in all, and where each number begins."""
        if self.template is None:
            return None
        data, numbers, _ = self.template.layout()
        for first, end, part in self.same:
            data[first:end] = np.frombuffer(part, dtype=np.uint8)
        return data, np.array([(first, end) for first, end, _ in self.same]), numbers


class AlikeReader:
    """
    Reads the numbers of serialised messages, quickly if only stamp and numbers have changed.

    What else is in a message, such as names, is that of one that came before.
    """

    def __init__(self, kind: Any, numbers: Callable[[Any], Sequence[float]],
                 fill: Callable[[Any, np.ndarray], None], parts: Callable[[Any], Sequence[Any]],
                 about: Callable[[Any], Any] = lambda _: None):
        """
        Prepare.

        :param kind: that begins with a header
        :param numbers: of a message
        :param fill: writes as many numbers to a message
        :param parts: of a message behind its header, in their order: strings, integers (the
            length of an array of strings) and arrays of numbers; without the last ones if these
            are no arrays
        :param about: what is to be known of a message, which does not depend on its numbers
        """
        self._kind, self._numbers, self._fill, self._parts = kind, numbers, fill, parts
        self._about = about
        # Several may publish on one topic.
        self._known = deque[Alike](maxlen=MOST_LAYOUTS)

    def read(self, data: Buffer) -> tuple[np.ndarray, Alike]:
        """
        Numbers of a message, and what it is like.

        :raises DataError: if it is not one of the kind
        """
        for alike in self._known:
            if alike.template is not None and alike.fits(data):
                return alike.template.numbers_of(data), alike
        message = deserialized(data, self._kind)
        numbers = np.array(self._numbers(message), dtype=float)
        alike = self._learned(data, message, len(numbers))
        if alike.template is not None:
            self._known.append(alike)
        return numbers, alike

    def _learned(self, data: Buffer, message: Any, count: int) -> Alike:
        """Know what is the same in messages like this one: all but the stamp and the numbers."""
        about, ranges = self._about(message), _ranges(message, self._parts(message))
        # A template changes its message.
        template = (SerializedTemplate(deserialized(data, self._kind), count, self._fill)
                    if count else None)
        if template is None or template.size != len(data):
            return Alike(about, None, [])
        return Alike(about, template, [(first, end, data[first:end]) for first, end in ranges])


def _ranges(message: Any, parts: Sequence[Any]) -> list[tuple[int, int]]:
    """
    Bytes of a serialised message that are neither stamp nor numbers, nor filled up.

    What fills up to an alignment has any content.

    :param parts: see `AlikeReader`
    """
    result, at = [(0, _HEADER)], _HEADER + 8
    for part in (message.header.frame_id, *parts):
        at += -(at - _HEADER) % 4
        size = 4 + (len(part.encode()) + 1 if isinstance(part, str) else 0)
        result.append((at, at + size))
        at += size
        if not isinstance(part, (str, int)) and len(part):
            at += -(at - _HEADER) % 8 + 8 * len(part)
    return result


class ReceivedReference(NamedTuple):
    """
    A reference from a topic.

    :ivar target: see `gdmp_ros.data.bags`
    :ivar stamp: [ns]
    :ivar mode: a `StreamMode`
    """

    target: np.ndarray
    frame: str
    stamp: int
    sequence: int
    mode: int


class Layout(NamedTuple):
    """
    Where everything is in messages of one kind and size, for kernels.

    :ivar like: one of them, as bytes
    :ivar same: ranges of bytes that are the same in all, shape (k, 2)
    :ivar places: the first byte of each number
    :ivar parts: the first byte of the stamp, of the sequence number and of the mode
    """

    like: np.ndarray
    same: np.ndarray
    places: np.ndarray
    parts: np.ndarray


class _KnownReferences:
    """References of one frame, of the tool or of some joints, that are read quickly."""

    def __init__(self, frame: str, joints: int = 0):
        message = Reference()
        message.header.frame_id = frame
        count = joint_target_size(joints) if joints else TARGET_SIZE
        self.template = SerializedTemplate(message, count,
                                           fill_joint_reference if joints else fill_reference)
        like, places, parts = self.template.layout()
        same = [(0, _HEADER), (_HEADER + 8, _HEADER + 12 + len(frame.encode()) + 1)]
        for before, array in enumerate(places[:3 * joints:joints] if joints else ()):
            # Before the first array stands the number of references of joints: one.
            begin, length = int(array) - 8, struct.pack('<I', joints)
            expected = length if before else struct.pack('<I', 1) + length
            same.append((begin, begin + len(expected)))
            if like[begin:begin + len(expected)].tobytes() != expected:
                raise RuntimeError('unknown serialisation: an array of joints has no length')
        self.layout = Layout(like, np.array(same), places, parts)
        self._same = [(begin, end, like[begin:end].tobytes()) for begin, end in same]

    def fit(self, data: Buffer) -> bool:
        """Whether a serialised message is one of them."""
        return len(data) == self.template.size and all(
            data[begin:end] == part for begin, end, part in self._same)


class ReferenceReader:
    """Reads serialised references: quickly those in one frame, and all others."""

    def __init__(self, frame: str, joints: int = 1):
        """
        Prepare.

        :param frame: ``frame_id`` that the references have
        :param joints: how many those of joints have
        """
        self._frame = frame
        self._known = _KnownReferences(frame), _KnownReferences(frame, joints)

    @property
    def layouts(self) -> tuple[Layout, Layout]:
        """Those of references of the tool, and of the joints, that are read quickly."""
        of_tool, of_joints = self._known
        return of_tool.layout, of_joints.layout

    def read(self, data: Buffer) -> ReceivedReference:
        """
        Read a reference; whether it is a good one is not checked.

        :raises DataError: if it is not a reference
        """
        for known in self._known:
            if known.fit(data):
                sequence, mode = known.template.integers_of(data)
                return ReceivedReference(known.template.numbers_of(data), self._frame,
                                         stamp_ns_of(data), sequence, mode)
        message = deserialized(data, Reference)
        header = message.header
        return ReceivedReference(
            joint_target(message) if message.joints else reference_target(message),
            header.frame_id, ns_of(header.stamp), message.sequence,
            message.mode)


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
    result = [i for i, part in enumerate(zip(*data)) if part == _BYTES]
    if len(result) != 1:
        raise RuntimeError(f'unknown serialisation: {name} was found {len(result)} times')
    return result[0]


def _position_of_stamp(message: Any, stamp: Any) -> int:
    """First byte of a stamp in the serialised message."""
    before = stamp.sec, stamp.nanosec
    stamp.sec, stamp.nanosec = _SECONDS, _NANOSECONDS
    data, mark = serialize_message(message), struct.pack('<iI', _SECONDS, _NANOSECONDS)
    stamp.sec, stamp.nanosec = before
    if data.count(mark) != 1:
        raise RuntimeError(f'unknown serialisation: a stamp was found {data.count(mark)} times')
    return int(data.index(mark))


def _find(values: np.ndarray, mark: Any) -> int:
    result = np.flatnonzero(values == mark)
    if len(result) != 1:
        raise RuntimeError(f'unknown serialisation: a mark was found {len(result)} times')
    return int(result[0])
