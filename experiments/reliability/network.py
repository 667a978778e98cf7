"""
Two hosts on one machine: network namespaces joined by a cable that loses and delays frames.

The cable is a thread between two virtual Ethernet pairs; it also works with kernels without
``netem``.
"""
from __future__ import annotations

import array
from collections import deque
import contextlib
from dataclasses import dataclass
import fcntl
import os
from pathlib import Path
import random
import selectors
import shutil
import socket
import struct
import subprocess
import threading
import time

from gdmp_ros.errors import GdmpError

_SIOCETHTOOL, _ETHTOOL_STXCSUM, _ETHTOOL_STSO, _ETHTOOL_SGSO = 0x8946, 0x17, 0x1F, 0x24
_LARGEST = 65_536
_SHARED = Path('/dev/shm')
HOSTS = ('server', 'robot')
#: SCHED_FIFO priority of the thread of a cable.
_PRIORITY = 30


@dataclass
class Quality:
    """
    Quality of a cable.

    :ivar loss: fraction of the frames that are lost
    :ivar delay: of every frame [s]
    :ivar jitter: largest random delay in addition [s]
    :ivar cut: True loses all frames
    """

    loss: float = 0.0
    delay: float = 0.0
    jitter: float = 0.0
    cut: bool = False


class Cable:
    """Forwards Ethernet frames between two interfaces, in its own thread."""

    def __init__(self, ends: tuple[str, str], quality: Quality, seed: int = 0):
        self.quality = quality
        self._random = random.Random(seed)
        self._sockets = []
        for name in ends:
            end = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(3))
            end.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 23)
            end.bind((name, 0))
            end.setblocking(False)
            self._sockets.append(end)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name='cable', daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread."""
        self._ended.set()
        self._thread.join()
        for end in self._sockets:
            end.close()

    def _run(self) -> None:
        # A busy machine must not lower the quality.
        with contextlib.suppress(PermissionError):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_PRIORITY))
        selector = selectors.DefaultSelector()
        for number, end in enumerate(self._sockets):
            selector.register(end, selectors.EVENT_READ, number)
        waiting: deque[tuple[float, int, bytes]] = deque()
        while not self._ended.is_set():
            left = max(waiting[0][0] - time.monotonic(), 0.0) if waiting else 0.1
            for key, _ in selector.select(min(left, 0.1)):
                self._read(key.data, waiting)
            while waiting and waiting[0][0] <= time.monotonic():
                _, number, frame = waiting.popleft()
                with contextlib.suppress(OSError):  # a full buffer loses frames
                    self._sockets[1 - number].send(frame)
        selector.close()

    def _read(self, number: int, waiting: deque[tuple[float, int, bytes]]) -> None:
        quality = self.quality
        while True:
            try:
                frame, address = self._sockets[number].recvfrom(_LARGEST)
            except BlockingIOError:
                return
            if address[2] == socket.PACKET_OUTGOING:
                continue
            if quality.cut or self._random.random() < quality.loss:
                continue
            due = time.monotonic() + quality.delay + quality.jitter * self._random.random()
            # Frames do not overtake each other.
            waiting.append((max(due, waiting[-1][0]) if waiting else due, number, frame))


def _disable_offload(interface: str) -> None:
    """Let the sender compute checksums and segments: no hardware does it behind this cable."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as control:
        for command in (_ETHTOOL_STXCSUM, _ETHTOOL_STSO, _ETHTOOL_SGSO):
            _ethtool(control, interface, command)


def _ethtool(control: socket.socket, interface: str, command: int) -> None:
    value = array.array('B', struct.pack('II', command, 0))
    address, _ = value.buffer_info()
    # An interface may not have the feature.
    with contextlib.suppress(OSError):
        fcntl.ioctl(control, _SIOCETHTOOL,
                    struct.pack('16sP', interface.encode(), address) + b'\0' * 16)


class TwoHosts:
    """Namespaces ``server`` and ``robot`` with their own addresses; leaving removes them."""

    def __init__(self, quality: Quality):
        """:raises GdmpError: if the rights or the tools to create them are missing"""
        self._quality = quality
        self._names = {host: f'gdmp-{os.getpid()}-{host}' for host in HOSTS}
        self._ends = tuple(f'gd{os.getpid() % 100000}{host[0]}' for host in HOSTS)

    def __enter__(self) -> TwoHosts:
        try:
            for number, host in enumerate(HOSTS):
                self._make(number, host)
            self.cable = Cable((self._ends[0], self._ends[1]), self._quality)
        except BaseException:
            self._remove()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.cable.close()
        self._remove()

    def _make(self, number: int, host: str) -> None:
        name, end = self._names[host], self._ends[number]
        inside = f'{end}i'
        (_SHARED / name).mkdir()
        _ip('netns', 'add', name)
        _ip('link', 'add', end, 'type', 'veth', 'peer', 'name', inside)
        for interface in (end, inside):
            _disable_offload(interface)
        _ip('link', 'set', inside, 'netns', name)
        _ip('link', 'set', end, 'up')
        for words in (('link', 'set', 'lo', 'up'), ('link', 'set', inside, 'up'),
                      ('addr', 'add', f'10.93.7.{number + 1}/24', 'dev', inside),
                      ('route', 'add', '224.0.0.0/4', 'dev', inside)):
            _ip('-n', name, *words)

    def _remove(self) -> None:
        for name in self._names.values():
            subprocess.run(['ip', 'netns', 'del', name], check=False, capture_output=True)
            shutil.rmtree(_SHARED / name, ignore_errors=True)
        for end in self._ends:
            subprocess.run(['ip', 'link', 'del', end], check=False, capture_output=True)

    def on(self, host: str) -> list[str]:
        """Command that runs another one on a host, with the shared memory of that host."""
        return ['nsenter', f'--net=/run/netns/{self._names[host]}', 'unshare', '--mount', 'sh',
                '-c', f'mount --bind {_SHARED / self._names[host]} /dev/shm && exec "$@"', 'sh']


def _ip(*words: str) -> None:
    try:
        done = subprocess.run(['ip', *words], capture_output=True, text=True)
    except FileNotFoundError:
        raise GdmpError('two hosts need the command ip (Debian, Ubuntu: apt install iproute2)'
                        ) from None
    if done.returncode != 0:
        raise GdmpError(f'two hosts cannot be made: ip {" ".join(words)}: {done.stderr.strip()}')
