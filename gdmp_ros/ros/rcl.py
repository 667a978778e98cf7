"""Messages that kernels take and send, by the addresses of the functions of rcl."""
from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, ExitStack
import ctypes
import functools
from typing import NamedTuple

import numpy as np

from gdmp_ros.errors import DataError
from gdmp_ros.kernels import ask_c, bytes_at, inlined, kernel
from gdmp_ros.realtime.loop import NS
from gdmp_ros.realtime.native import (
    addresses,
    post_address,
    semaphore,
    semaphore_functions,
    wait_for_post,
)
from gdmp_ros.ros.middleware import Publisher, Subscription
from gdmp_ros.ros.serialized import SerializedTemplate

_TAKE, _PUBLISH = range(2)
#: What `take_newest` returns: there was no message, it was read, it is not like those that a
#: kernel reads.
NOTHING, READ, FOREIGN = range(3)
#: Messages that are taken at once, and integers of an ``rmw_message_info_t``, of which the second
#: is the time at which it arrived [ns].
_MOST_TAKEN, _ABOUT, _ARRIVED = 20, 16, 1
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
def rcl_functions() -> np.ndarray:
    """
    Addresses of the functions that the kernels call.

    :raises OSError: if there is no rcl
    :raises AttributeError: if it has not these functions
    """
    return addresses(ctypes.CDLL('librcl.so'), 'rcl_take_serialized_message',
                     'rcl_publish_serialized_message')


def check_handle(address: int) -> None:
    """:raises DataError: if an address is 0"""
    if not address:
        raise DataError('this middleware does not tell the addresses of its handles')


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


class Inlet(NamedTuple):
    """
    A topic that a kernel reads.

    :ivar handle: address of the ``rcl_subscription_t``; 0 if there is no topic
    :ivar message: `SerializedMemory.numbers`
    :ivar about: what is told of a message
    :ivar like: `gdmp_ros.ros.serialized.Alike.layout`: a message, as ``same`` and ``places``;
        empty while none is known: then all messages are `FOREIGN`
    :ivar same: see ``like``
    :ivar places: see ``like``; the first byte of each number that is read
    :ivar numbers: written: the numbers of the last message, as bytes
    :ivar arrived: written: when it arrived, wall time [ns]
    """

    handle: np.ndarray
    message: np.ndarray
    about: np.ndarray
    like: np.ndarray
    same: np.ndarray
    places: np.ndarray
    numbers: np.ndarray
    arrived: np.ndarray


NO_INLET = Inlet(np.zeros(1, dtype=np.int64), np.zeros(1, dtype=np.int64),
                 np.zeros(_ABOUT, dtype=np.int64), np.zeros(0, dtype=np.uint8),
                 np.zeros((0, 2), dtype=np.int64), np.zeros(0, dtype=np.int64),
                 np.zeros(0, dtype=np.uint8), np.zeros(1, dtype=np.int64))


class Incoming:
    """
    The messages of a topic that a kernel reads.

    :ivar inlet: for the kernel; its address counts while the subscription is in use
    """

    def __init__(self, subscription: Subscription, numbers: np.ndarray, arrived: np.ndarray):
        """
        Prepare.

        :param numbers: written by the kernel; contiguous
        :param arrived: the same
        :raises DataError: if the subscription has no handle of rcl
        """
        with subscription.in_use() as address:
            check_handle(address)
        self._subscription, self._memory = subscription, SerializedMemory()
        self.inlet = NO_INLET._replace(
            handle=np.zeros(1, dtype=np.int64), message=self._memory.numbers,
            about=np.zeros(_ABOUT, dtype=np.int64), numbers=numbers.reshape(-1).view(np.uint8),
            arrived=arrived)

    @property
    def data(self) -> bytes:
        """The message that was taken last."""
        return self._memory.data

    def learn(self, layout: tuple[np.ndarray, np.ndarray, np.ndarray] | None) -> None:
        """
        Know what the messages are like from now on.

        :param layout: `gdmp_ros.ros.serialized.Alike.layout`, with the places of the numbers that
            are to be read; None: the kernel reads none
        """
        like, same, places = layout or NO_INLET[3:6]
        self.inlet = self.inlet._replace(like=like, same=same, places=places)

    @contextmanager
    def in_use(self) -> Iterator[None]:
        """Keep the subscription, and let the kernel know its address."""
        with self._subscription.in_use() as self.inlet.handle[0]:
            yield


class Arrivals:
    """
    Lets a thread wait for messages on topics from which they are taken.

    Callbacks of rcl are registered within a ``with`` statement.
    """

    def __init__(self, subscriptions: Sequence[Subscription]):
        """:param subscriptions: without callbacks, and with handles of rcl"""
        self._subscriptions, self._memory = subscriptions, semaphore()
        self._spec = np.zeros(2, dtype=np.int64)

    def __enter__(self) -> Arrivals:
        with ExitStack() as stack:
            for subscription in self._subscriptions:
                self._register(subscription, post_address())
                stack.callback(self._register, subscription, 0)
            self._registered = stack.pop_all()
        return self

    def __exit__(self, *raised: object) -> None:
        self._registered.close()

    def _register(self, subscription: Subscription, function: int) -> None:
        """
        Let rcl call a function when a message comes; 0: none.

        :raises DataError: if the middleware cannot do so
        """
        with subscription.in_use() as address:
            code = ctypes.CDLL('librcl.so').rcl_subscription_set_on_new_message_callback(
                ctypes.c_void_p(address), ctypes.c_void_p(function),
                ctypes.c_void_p(self._memory.ctypes.data if function else 0))
        if code:
            raise DataError(f'{subscription.topic}: this middleware does not tell when messages '
                            f'come (code {code} of rcl)')

    def wait_until(self, deadline_ns: int) -> bool:
        """
        Wait until a message comes; messages that have come meanwhile count.

        :param deadline_ns: steady time at which waiting ends
        :returns: whether one has come
        """
        came = wait_for_post(semaphore_functions(), self._memory, self._spec, deadline_ns)
        if came:
            while wait_for_post(semaphore_functions(), self._memory, self._spec, 0):
                pass
        return bool(came)


class Outlet(NamedTuple):
    """
    A topic that a kernel sends to.

    :ivar handle: address of the ``rcl_publisher_t``
    :ivar message: `SerializedMemory.numbers`
    :ivar numbers: among the bytes of the message, the first of each number
    :ivar parts: of stamp, sequence number, mode and tick, as far as it has them
    """

    handle: np.ndarray
    message: np.ndarray
    numbers: np.ndarray
    parts: np.ndarray


class Outgoing:
    """
    The messages that a kernel sends to a topic.

    :ivar publisher: of the topic
    :ivar outlet: for the kernel; its address counts while the publisher is in use
    """

    def __init__(self, publisher: Publisher, template: SerializedTemplate):
        """:raises DataError: if the publisher has no handle of rcl"""
        with publisher.in_use() as address:
            check_handle(address)
        self.publisher = publisher
        self._memory = SerializedMemory()
        message, numbers, parts = template.layout()
        self._memory.data = message.tobytes()
        self.outlet = Outlet(np.zeros(1, dtype=np.int64), self._memory.numbers, numbers, parts)

    @contextmanager
    def in_use(self) -> Iterator[None]:
        """Keep the publisher, and let the kernel know its address."""
        with self.publisher.in_use() as self.outlet.handle[0]:
            yield


@kernel
def take_message(calls, subscription, message):
    """
    Take the next message of a subscription; its number of bytes, 0 if there is none.

    :param calls: see `rcl_functions`
    :param subscription: address of an ``rcl_subscription_t``
    :param message: `SerializedMemory.numbers`
    """
    none = np.int64(0)
    code = ask_c(calls[_TAKE], (subscription, message, none, none))
    return message[1] if code == 0 else 0


@kernel
def is_alike(data, known):
    """
    Whether a message differs from a known one in stamp and numbers only.

    :param known: with ``like`` and ``same``, as an `Inlet` or a `gdmp_ros.ros.serialized.Layout`
    """
    if data.size != known.like.size:
        return False
    for k in range(len(known.same)):
        for at in range(known.same[k, 0], known.same[k, 1]):
            if data[at] != known.like[at]:
                return False
    return True


@kernel
def read_numbers(data, places, numbers):
    """
    Read numbers of a message.

    :param places: the first byte of each
    :param numbers: written, as bytes
    """
    for k in range(places.size):
        for byte in range(8):
            numbers[8 * k + byte] = data[places[k] + byte]


@kernel
def take_newest(calls, inlet, now):
    """
    Read the messages that have come; the newest counts.

    :param calls: see `rcl_functions`
    :param now: wall time [ns]
    :returns: `NOTHING`, `READ` or `FOREIGN`: then the last message is for Python, others may wait
    """
    found, none = NOTHING, np.int64(0)
    if inlet.handle[0] == 0:
        return found
    for _ in range(_MOST_TAKEN):
        if ask_c(calls[_TAKE], (inlet.handle[0], inlet.message, inlet.about, none)) != 0:
            break
        data = bytes_at(inlet.message[0], inlet.message[1])
        if not is_alike(data, inlet):
            return FOREIGN
        read_numbers(data, inlet.places, inlet.numbers)
        arrived = inlet.about[_ARRIVED]
        inlet.arrived[0], found = arrived if arrived != 0 else now, READ
    return found


@kernel
def send_message(calls, outlet):
    """Send a message that has been written."""
    ask_c(calls[_PUBLISH], (outlet.handle[0], outlet.message, np.int64(0)))


@inlined
def bytes_of(outlet):
    """The bytes of a message."""
    return bytes_at(outlet.message[0], outlet.message[1])


@kernel
def write_numbers(outlet, numbers):
    """
    Write numbers to a message.

    :param numbers: as bytes, 8 each
    """
    data = bytes_of(outlet)
    for k in range(outlet.numbers.size):
        for byte in range(8):
            data[outlet.numbers[k] + byte] = numbers[8 * k + byte]


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
    return read_integer(data, at, 4) * NS + read_integer(data, at + 4, 4)


@kernel
def write_stamp(data, at, time):
    """See `read_stamp`."""
    write_integer(data, at, 4, time // NS)
    write_integer(data, at + 4, 4, time % NS)
