"""Records topics to a bag without losing a message: deep histories, drained in batches."""
from __future__ import annotations

import argparse
from collections.abc import Collection
from importlib import import_module
import os
from pathlib import Path
import shutil
import sys
import time
from typing import Any

import rclpy
from rclpy.node import Node
from rclpy.qos import ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions

from gdmp_ros.errors import DataError, GdmpError
from gdmp_ros.files.bags import BagWriter
from gdmp_ros.nodes.managed import DEEP, PolledGroup, reliable
from gdmp_ros.realtime.domain import network
from gdmp_ros.realtime.processes import ended_by_signal

#: Recording ends while the disk still has so much room: bags need some to be closed [MB].
KEEP_FREE_MB = 64.0
#: How often the histories are drained [s]: 20 messages of a 1 kHz topic at a time.
DRAIN_S = 0.02


def message_class(name: str) -> Any:
    """Message class of a type name ``package/msg/Name``."""
    package, _, kind = name.split('/')
    return getattr(import_module(f'{package}.msg'), kind)


def definition(name: str) -> tuple[str, str]:
    """Text of a message definition with all it contains, as bags store it, and its digest."""
    from rosbags.typesys import get_types_from_msg, get_typestore, Stores
    store = get_typestore(Stores.ROS2_JAZZY)
    package, _, kind = name.split('/')
    path = _share(package) / 'msg' / f'{kind}.msg'
    store.register(get_types_from_msg(path.read_text(), name))
    text, _ = store.generate_msgdef(name, ros_version=2)
    return text, store.hash_rihs01(name)


def _share(package: str) -> Path:
    """Where a package keeps its files; the wheels install to the interpreter's own prefix."""
    prefixes = [*os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep), sys.prefix]
    for prefix in filter(None, prefixes):
        folder = Path(prefix) / 'share' / package
        if folder.is_dir():
            return folder
    raise DataError(f'package {package} is not installed in any of {prefixes}')


class Recorder(Node):
    """Subscribes raw and writes what arrives, stamped with the time it was published."""

    def __init__(self, topics: dict[str, str], writer: BagWriter,
                 best_effort: Collection[str] = ()):
        """
        Subscribe.

        :param topics: topic names and their types (``package/msg/Name``)
        :param best_effort: topics whose publishers do not offer more
        """
        super().__init__('recorder')
        self._writer = writer
        self._inputs = []
        self._waiting = set(topics)
        for topic, kind in topics.items():
            quality = reliable(DEEP)
            if topic in best_effort:
                quality.reliability = ReliabilityPolicy.BEST_EFFORT
            subscription = self.create_subscription(
                message_class(kind), topic, lambda _: None, quality, raw=True,
                callback_group=PolledGroup())
            extra = definition(kind) if kind.startswith('gdmp_msgs/') else (None, None)
            self._inputs.append((topic, kind, subscription, *extra))

    @property
    def complete(self) -> bool:
        """Whether every topic has brought a message."""
        return not self._waiting

    def drain(self) -> None:
        """Write everything that has arrived."""
        for topic, kind, subscription, text, digest in self._inputs:
            with subscription.handle:
                while True:
                    taken = subscription.handle.take_message(subscription.msg_type, True)
                    if taken is None:
                        break
                    stamp = taken[1]['source_timestamp']
                    self._writer.raw(topic, kind, stamp, taken[0], text, digest)
                    self._waiting.discard(topic)


def main(arguments: list[str] | None = None) -> int:
    """Record until SIGTERM or SIGINT; the bag appears under its name when it is complete."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('bag')
    parser.add_argument('--keep-free', type=float, default=KEEP_FREE_MB, metavar='MB',
                        help='end the recording while the disk has so much room left '
                             '(default %(default)g)')
    parser.add_argument('--best-effort', action='append', default=[], metavar='TOPIC',
                        help='take a topic whose publisher is not reliable')
    parser.add_argument('topics', nargs='+', metavar='TOPIC=TYPE')
    options = parser.parse_args(arguments)
    topics = dict(pair.split('=', 1) for pair in options.topics)
    os.environ.update(network())
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    ended = ended_by_signal()
    try:
        with BagWriter(options.bag) as writer:
            node = Recorder(topics, writer, options.best_effort)
            print(f'waiting for {", ".join(topics)}', flush=True)
            said, full = False, False
            while not ended.is_set() and not full:
                node.drain()
                full = shutil.disk_usage(writer.path.parent).free < options.keep_free * 1e6
                if node.complete and not said:
                    print('recording', flush=True)
                    said = True
                time.sleep(DRAIN_S)
            node.drain()
        if full:
            raise DataError(f'{options.bag}: the disk is nearly full (less than '
                            f'{options.keep_free:g} MB left): the recording has ended, and what '
                            'was recorded is kept')
    except GdmpError as error:
        print(f'error: {error}', file=sys.stderr)
        return 1
    finally:
        rclpy.shutdown()
    return 0


if __name__ == '__main__':
    sys.exit(main())
