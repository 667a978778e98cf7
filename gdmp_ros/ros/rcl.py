"""Messages that kernels take and send, by the addresses of the functions of rcl."""
from __future__ import annotations

import ctypes
import functools

import numpy as np

from gdmp_ros.kernels import ask_c, kernel

_TAKE, _PUBLISH = range(2)
_NS = 1_000_000_000
#: Bytes that are reserved for a message; rcl asks for more if one is longer.
_RESERVED = 4096


class _Allocator(ctypes.Structure):
    """``rcutils_allocator_t``."""

    _fields_ = [(name, ctypes.c_void_p) for name in (
        'allocate', 'deallocate', 'reallocate', 'zero_allocate', 'state')]


class _Message(ctypes.Structure):
    """``rcl_serialized_message_t``."""

    _fields_ = [('buffer', ctypes.c_void_p), ('length', ctypes.c_size_t),
                ('capacity', ctypes.c_size_t), ('allocator', _Allocator)]


@functools.cache
def functions() -> np.ndarray:
    """
    Addresses of the functions that the kernels call.

    :raises OSError: if there is no rcl
    :raises AttributeError: if it has not these functions
    """
    library = ctypes.CDLL('librcl.so')
    return np.array([ctypes.cast(getattr(library, name), ctypes.c_void_p).value or 0 for name in (
        'rcl_take_serialized_message', 'rcl_publish_serialized_message')])


class SerializedMemory:
    """
    Memory of a serialised message.

    :ivar numbers: ``rcl_serialized_message_t`` as integers: address, length, capacity, allocator
    """

    def __init__(self) -> None:
        self._library = ctypes.CDLL('librcutils.so')
        self._library.rcutils_get_default_allocator.restype = _Allocator
        self._message = _Message()
        allocator = self._library.rcutils_get_default_allocator()
        if self._library.rcutils_uint8_array_init(
                ctypes.byref(self._message), ctypes.c_size_t(_RESERVED), ctypes.byref(allocator)):
            raise MemoryError('no memory for a message')
        count = ctypes.sizeof(_Message) // 8
        self.numbers = np.ctypeslib.as_array((ctypes.c_int64 * count).from_buffer(self._message))

    def __del__(self) -> None:
        self._library.rcutils_uint8_array_fini(ctypes.byref(self._message))

    @property
    def data(self) -> bytes:
        """The message."""
        return ctypes.string_at(self._message.buffer, self._message.length)

    @data.setter
    def data(self, data: bytes) -> None:
        self._message.length = len(data)
        ctypes.memmove(self._message.buffer, data, len(data))


@kernel
def take(addresses, subscription, message):
    """
    Take the next message of a subscription; its number of bytes, 0 if there is none.

    :param addresses: see `functions`
    :param subscription: address of an ``rcl_subscription_t``
    :param message: `SerializedMemory.numbers`
    """
    none = np.int64(0)
    code = ask_c(addresses[_TAKE], (subscription, message, none, none))
    return message[1] if code == 0 else 0


@kernel
def publish(addresses, publisher, message):
    """
    Send a message.

    :param publisher: address of an ``rcl_publisher_t``
    """
    ask_c(addresses[_PUBLISH], (publisher, message, np.int64(0)))


@kernel
def read_integer(data, at, count):
    """An integer without sign among bytes, lowest byte first."""
    result = np.int64(0)
    for k in range(count - 1, -1, -1):
        result = (result << 8) | np.int64(data[at + k])
    return result


@kernel
def write_integer(data, at, count, value):
    """See `read_integer`."""
    for k in range(count):
        data[at + k] = (value >> (8 * k)) & 255


@kernel
def read_stamp(data, at):
    """A ``builtin_interfaces/Time`` among bytes [ns]."""
    return read_integer(data, at, 4) * _NS + read_integer(data, at + 4, 4)


@kernel
def write_stamp(data, at, time):
    """See `read_stamp`."""
    write_integer(data, at, 4, time // _NS)
    write_integer(data, at + 4, 4, time % _NS)
