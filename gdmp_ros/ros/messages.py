"""
Messages as numbers, and templates of serialised messages.

Serialising a Python message takes 20 µs or more; writing stamp and numbers into a serialised one
takes 2 µs. Their positions are found by serialising a message with known marks.
"""
from __future__ import annotations

from collections.abc import Callable
import math
import struct
from typing import Any, TypeAlias

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from gdmp_msgs.msg import Reference, RobotState
from geometry_msgs.msg import Pose, PoseStamped
from nav_msgs.msg import Path
import numpy as np
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import Float64MultiArray, MultiArrayDimension, MultiArrayLayout

from gdmp_ros.control.controller import Tick
from gdmp_ros.control.guard import QUATERNION_TOLERANCE
from gdmp_ros.control.limits import LIMITS
from gdmp_ros.control.target import ACCELERATION, POSE, STIFFNESS, TARGET_SIZE, TWIST
from gdmp_ros.data import message_numbers
from gdmp_ros.errors import DataError, ManifoldError
from gdmp_ros.realtime.statistics import Punctuality

NS = 1_000_000_000
#: Serialised data; the name ``bytes`` is a method below.
Buffer: TypeAlias = bytes
_HEADER = 4  # bytes of CDR encapsulation; alignment is relative to its end
_MARK = 1e-200
#: Numbers of a robot state before those of its joints.
ROBOT_STATE_FIXED = 93 + len(LIMITS)


def pose_numbers(pose: Pose) -> np.ndarray:
    """(x, y, z, qw, qx, qy, qz) of a pose message."""
    return np.array(message_numbers.pose_numbers(pose))


def set_pose(pose: Pose, numbers: np.ndarray) -> None:
    """Write (x, y, z, qw, qx, qy, qz) to a pose message."""
    p, q = pose.position, pose.orientation
    p.x, p.y, p.z, q.w, q.x, q.y, q.z = (float(v) for v in numbers[:7])


def set_vectors(first: Any, second: Any, numbers: np.ndarray) -> None:
    """Write six numbers to two vectors, as of a twist or a wrench."""
    first.x, first.y, first.z, second.x, second.y, second.z = (float(v) for v in numbers)


def stamp_of(ns: int) -> Time:
    """Time message of nanoseconds."""
    return Time(sec=ns // NS, nanosec=ns % NS)


def reference_target(message: Reference) -> np.ndarray:
    """The numbers of a reference as a target (`gdmp_ros.control.target`)."""
    target = np.empty(TARGET_SIZE)
    target[POSE:TWIST] = message_numbers.pose_numbers(message.pose)
    target[TWIST:ACCELERATION] = message_numbers.vector_numbers(message.twist.linear,
                                                                message.twist.angular)
    target[ACCELERATION:STIFFNESS] = message_numbers.vector_numbers(message.acceleration.linear,
                                                                    message.acceleration.angular)
    target[STIFFNESS:-1] = message.stiffness
    target[-1] = message.damping_ratio
    return target


def fill_reference(message: Reference, numbers: np.ndarray) -> None:
    """Write `TARGET_SIZE` numbers to a reference (the inverse of `reference_target`)."""
    set_pose(message.pose, numbers[POSE:])
    set_vectors(message.twist.linear, message.twist.angular, numbers[TWIST:TWIST + 6])
    set_vectors(message.acceleration.linear, message.acceleration.angular,
                numbers[ACCELERATION:ACCELERATION + 6])
    message.stiffness = numbers[STIFFNESS:-1]
    message.damping_ratio = float(numbers[-1])


def robot_state_numbers(tick: Tick) -> np.ndarray:
    """Numbers of a tick as `fill_robot_state` takes them."""
    measured = tick.measurement
    return np.concatenate([measured.pose, tick.twist, tick.wrench, tick.stiffness, tick.requested,
                           [tick.spring, tick.tank], tick.violation, measured.position,
                           measured.velocity, tick.torque])


def fill_robot_state(message: RobotState, numbers: np.ndarray) -> None:
    """Write the numbers of a tick (`robot_state_numbers`)."""
    set_pose(message.pose, numbers)
    set_vectors(message.twist.linear, message.twist.angular, numbers[7:13])
    set_vectors(message.wrench.force, message.wrench.torque, numbers[13:19])
    message.stiffness, message.requested_stiffness = numbers[19:55], numbers[55:91]
    message.spring_energy, message.tank_energy = float(numbers[91]), float(numbers[92])
    message.limited = numbers[93:ROBOT_STATE_FIXED]
    joints = numbers[ROBOT_STATE_FIXED:].reshape(3, -1)
    message.position, message.velocity, message.torque = (list(row) for row in joints)


def matrix_message(size: int) -> Float64MultiArray:
    """Zero matrix with labelled layout, row-major."""
    dimensions = [MultiArrayDimension(label='rows', size=size, stride=size * size),
                  MultiArrayDimension(label='columns', size=size, stride=size)]
    return Float64MultiArray(layout=MultiArrayLayout(dim=dimensions), data=[0.0] * size * size)


def fill_matrix(message: Float64MultiArray, numbers: np.ndarray) -> None:
    """Write the entries of a matrix."""
    message.data = list(numbers)


def fill_pose_stamped(message: PoseStamped, numbers: np.ndarray) -> None:
    """Write a pose."""
    set_pose(message.pose, numbers)


def path_message(poses: np.ndarray, frame: str, stamp: Time) -> Path:
    """Path through poses (x, y, z, qw, qx, qy, qz), shape ``(T, 7)``."""
    result = Path()
    result.header.frame_id, result.header.stamp = frame, stamp
    for numbers in poses:
        one = PoseStamped(header=result.header)
        set_pose(one.pose, numbers)
        result.poses.append(one)
    return result


def checked_pose(message: PoseStamped, frame: str) -> np.ndarray:
    """
    (x, y, z, qw, qx, qy, qz) of a pose, normalised.

    :raises ManifoldError: if the frame is wrong, a number not finite, or the quaternion not unit
    """
    if message.header.frame_id != frame:
        raise ManifoldError(f'pose is in frame {message.header.frame_id!r}, expected {frame!r}')
    numbers = pose_numbers(message.pose)
    if not np.isfinite(numbers).all():
        raise ManifoldError('pose has a NaN or infinite number')
    norm = float(np.linalg.norm(numbers[3:]))
    if abs(norm - 1.0) > QUATERNION_TOLERANCE:
        raise ManifoldError(f'quaternion norm is {norm:.6g}, expected 1 within '
                            f'{QUATERNION_TOLERANCE:g}')
    numbers[3:] /= norm
    return numbers


def lateness_diagnostics(node: str, level: bytes, message: str, figures: Punctuality,
                         extra: dict[str, object], stamp: Any) -> DiagnosticArray:
    """/diagnostics message of a node with a loop."""
    values = {'rate [Hz]': f'{figures.rate_hz:.1f}', 'ticks': figures.ticks,
              'missed ticks': figures.missed, 'lateness p50 [us]': f'{figures.p50_us:.0f}',
              'lateness p99 [us]': f'{figures.p99_us:.0f}',
              'lateness max [us]': f'{figures.max_us:.0f}', **extra}
    status = DiagnosticStatus(level=level, name=f'{node}: stream', message=message,
                              hardware_id='gdmp_ros')
    status.values = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
    result = DiagnosticArray(status=[status])
    result.header.stamp = stamp
    return result


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
    Reads serialised PoseStamped messages of one frame.

    It takes a tenth of the time of `checked_pose` with deserialisation.
    """

    def __init__(self, frame: str):
        """:param frame: ``frame_id`` that the poses must have"""
        self._frame = frame
        message = PoseStamped()
        message.header.frame_id = frame
        data = serialize_message(message)
        self._size, self._numbers = len(data), len(data) - 7 * 8
        # Encapsulation; behind the stamp the string of the frame.
        self._begin, self._string = data[:_HEADER], data[_HEADER + 8:_HEADER + 12 + len(frame)]

    def read(self, data: Buffer) -> np.ndarray:
        """
        (x, y, z, qw, qx, qy, qz), normalised.

        :raises GdmpError: as `checked_pose` and `deserialized`
        """
        if (len(data) >= self._size and data[:_HEADER] == self._begin
                and data[_HEADER + 8:_HEADER + 8 + len(self._string)] == self._string):
            x, y, z, qx, qy, qz, qw = struct.unpack_from('<7d', data, self._numbers)
            norm = math.sqrt(qw * qw + qx * qx + qy * qy + qz * qz)
            if math.isfinite(x + y + z) and abs(norm - 1.0) <= QUATERNION_TOLERANCE:
                return np.array([x, y, z, qw / norm, qx / norm, qy / norm, qz / norm])
        # Names the reason.
        return checked_pose(deserialized(data, PoseStamped), self._frame)


class SerializedTemplate:
    """A serialised message in which stamp, sequence number and numbers are replaced."""

    def __init__(self, message: Any, count: int, fill: Callable[[Any, np.ndarray], None]):
        """
        Find the positions of stamp and numbers.

        :param message: with its strings (frame); they cannot change later
        :param count: number of numbers
        :param fill: writes the numbers to the message
        """
        marks = _MARK * (1.0 + np.arange(count))
        fill(message, marks)
        self._stamped = hasattr(message, 'header')
        sequenced = hasattr(message, 'sequence')
        if sequenced:
            message.sequence = 0x1122334455667788
        data = bytearray(serialize_message(message))
        data += b'\0' * (-(len(data) - _HEADER) % 8)
        self._size = len(serialize_message(message))
        self._data = data
        self._doubles = np.frombuffer(data, dtype='<f8', offset=_HEADER)
        self._integers = np.frombuffer(data, dtype='<u8', offset=_HEADER)
        self._positions = np.array([_find(self._doubles, mark) for mark in marks])
        self._sequence = (_find(self._integers, np.uint64(0x1122334455667788)) if sequenced
                          else -1)

    def bytes(self, numbers: np.ndarray, stamp_ns: int = 0, sequence: int = 0) -> bytes:
        """Serialised message with these values."""
        if self._stamped:
            struct.pack_into('<iI', self._data, _HEADER, stamp_ns // NS, stamp_ns % NS)
        self._doubles[self._positions] = numbers
        if self._sequence >= 0:
            self._integers[self._sequence] = sequence
        return bytes(memoryview(self._data)[:self._size])

    def sequence_of(self, data: Buffer) -> int:
        """Sequence number of a serialised message with these strings."""
        return int(struct.unpack_from('<Q', data, _HEADER + 8 * self._sequence)[0])

    def numbers_of(self, data: Buffer) -> np.ndarray:
        """Numbers of a serialised message with these strings."""
        count = (len(data) - _HEADER) // 8
        return np.asarray(np.frombuffer(data, '<f8', count, _HEADER)[self._positions])


def stamp_ns_of(data: Buffer) -> int:
    """Stamp of a serialised message that begins with a header [ns]."""
    seconds, ns = struct.unpack_from('<iI', data, _HEADER)
    return int(seconds) * NS + int(ns)


def _find(values: np.ndarray, mark: Any) -> int:
    found = np.flatnonzero(values == mark)
    if len(found) != 1:
        raise RuntimeError(f'unknown serialisation: a mark was found {len(found)} times')
    return int(found[0])
