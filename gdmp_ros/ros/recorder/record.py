"""Records topics to a bag without losing messages: deep histories, read in batches."""
from __future__ import annotations

import argparse
from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial
from importlib import import_module
import os
from pathlib import Path
import shutil
import sys
from typing import Any, Protocol

from rclpy.qos import ReliabilityPolicy

from gdmp_ros.data.bags import BagWriter
from gdmp_ros.errors import DataError, GdmpError
from gdmp_ros.realtime.loop import Loop, NS, run
from gdmp_ros.ros.dds import current
from gdmp_ros.ros.middleware import latched, Participant, reliable
from gdmp_ros.util.dds_network import default_environment
from gdmp_ros.util.processes import stop_event

#: Recording ends if the disk has less free space: closing a bag needs some [MB].
KEEP_FREE_MB = 64.0
#: Interval at which the histories are read [s]: 20 messages of a 1 kHz topic.
DRAIN_S = 0.02
#: Messages of a topic, of all its publishers together, that wait for being read. It is the most
#: that Fast DDS keeps: a busy machine may hold the recorder up for seconds.
HISTORY = 5000


class Sink(Protocol):
    """What takes messages, as `gdmp_ros.data.bags.BagWriter.raw` does."""

    def raw(self, topic: str, msgtype: str, stamp_ns: int, data: bytes,
            definition: str | None = None, digest: str | None = None) -> None:
        """Take a serialised message."""


def message_class(name: str) -> Any:
    """Message class of a type name ``package/msg/Name``."""
    package, _, kind = name.split('/')
    return getattr(import_module(f'{package}.msg'), kind)


def definition(name: str) -> tuple[str, str]:
    """Text of a message definition with its dependencies, as bags store it, and its hash."""
    from rosbags.typesys import get_types_from_msg, get_typestore, Stores
    store = get_typestore(Stores.ROS2_JAZZY)
    package = name.split('/', 1)[0]
    # All of the package: messages contain each other.
    for path in (_share(package) / 'msg').glob('*.msg'):
        kind = f'{package}/msg/{path.stem}'
        if kind not in store.types:
            store.register(get_types_from_msg(path.read_text(), kind))
    text, _ = store.generate_msgdef(name, ros_version=2)
    return text, store.hash_rihs01(name)


def _share(package: str) -> Path:
    """Folder ``share/package``; the wheels install to the prefix of the interpreter."""
    prefixes = [*os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep), sys.prefix]
    for prefix in filter(None, prefixes):
        folder = Path(prefix) / 'share' / package
        if folder.is_dir():
            return folder
    raise DataError(f'package {package} is not installed in any of {prefixes}')


class Tap:
    """
    Subscriptions; every message goes to a bag with the time of its publication.

    :ivar waiting: topics without a message since the last `begin`
    """

    def __init__(self, participant: Participant, topics: Mapping[str, str],
                 best_effort: Collection[str] = (), rare: Collection[str] = (),
                 lasting: Collection[str] = ()):
        """
        Subscribe.

        :param topics: topic names and their types (``package/msg/Name``)
        :param best_effort: topics whose publishers are not reliable
        :param rare: topics with a message now and then: nothing waits for them
        :param lasting: topics whose messages hold until there is another one (transient local):
            what came before the first `begin` is written as of the subscription, and what came
            before a later one by `repeat`
        """
        self._lasting: dict[bytes, tuple[str, str]] = {}
        self._participant = participant
        self._inputs = []
        self._expected = frozenset(topics) - frozenset(rare)
        self._since = participant.clock.wall()
        self.waiting = set(self._expected)
        for topic, kind in topics.items():
            quality = latched(HISTORY) if topic in lasting else reliable(HISTORY)
            if topic in best_effort:
                quality.reliability = ReliabilityPolicy.BEST_EFFORT
            subscription = participant.subscription(message_class(kind), topic, quality)
            extra = definition(kind) if kind.startswith('gdmp_msgs/') else (None, None)
            self._inputs.append((topic, kind, subscription, topic in lasting, *extra))

    def begin(self) -> None:
        """Discard the messages that have arrived so far."""
        self.drain(None)
        self.waiting = set(self._expected)

    def drain(self, writer: Sink | None) -> int:
        """Write the messages that have arrived, or discard them; returns their number."""
        count = 0
        for topic, kind, subscription, lasts, text, digest in self._inputs:
            while (received := subscription.take()) is not None:
                count += 1
                self.waiting.discard(topic)
                if lasts:
                    self._lasting[received.data] = topic, kind
                if writer is not None:
                    published = max(received.published, self._since if lasts else 0)
                    writer.raw(topic, kind, published, received.data, text, digest)
        return count

    def repeat(self, writer: Sink, time_ns: int) -> None:
        """Write what holds since before, as of a time."""
        for data, (topic, kind) in self._lasting.items():
            writer.raw(topic, kind, time_ns, data)

    def release(self) -> None:
        """Unsubscribe."""
        for _, _, subscription, *_ in self._inputs:
            self._participant.destroy(subscription)


class Recording:
    """
    Topics that are recorded until the recording is closed.

    :ivar full: whether it has ended because the disk is nearly full
    """

    def __init__(self, participant: Participant, bag: Path, topics: Mapping[str, str],
                 best_effort: Collection[str] = (), lasting: Collection[str] = (),
                 keep_free: float = KEEP_FREE_MB):
        """
        Subscribe.

        :param topics: topic names and their types (``package/msg/Name``)
        :param best_effort: see `Tap`
        :param lasting: see `Tap`
        :param keep_free: free space at which the recording ends [MB]
        """
        self.full = False
        self._clock, self._keep_free = participant.clock, keep_free
        self._topics, self._writer = topics, BagWriter(bag)
        self._tap = Tap(participant, topics, best_effort, lasting=lasting)

    def record(self, say: Callable[[str], None]) -> Loop:
        """
        Record until the loop is closed; the bag gets its name then.

        :param say: is told what happens
        """
        writer, tap, announced = self._writer.open(), self._tap, False
        try:
            say(f'waiting for {", ".join(self._topics)}')
            while not self.full:
                tap.drain(writer)
                free = shutil.disk_usage(writer.path.parent).free
                self.full = free < self._keep_free * 1e6
                if not tap.waiting and not announced:
                    announced = True
                    say('recording')
                yield self._clock.now() + round(DRAIN_S * NS)
        except GeneratorExit:
            pass  # closed: the bag is complete
        except BaseException:
            writer.close(keep=False)
            raise
        tap.drain(writer)
        writer.close()
        tap.release()


def options_of(arguments: Sequence[str] | None = None) -> argparse.Namespace:
    """What the command line says; ``topics`` has the type by topic."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('bag', type=Path)
    parser.add_argument('--keep-free', type=float, default=KEEP_FREE_MB, metavar='MB',
                        help='end the recording if the disk has less free space '
                             '(default %(default)g)')
    parser.add_argument('--best-effort', action='append', default=[], metavar='TOPIC',
                        help='a topic whose publisher is not reliable')
    parser.add_argument('--lasting', action='append', default=[], metavar='TOPIC',
                        help='a topic whose publisher keeps its last message for those who come '
                             'later')
    parser.add_argument('topics', nargs='+', metavar='TOPIC=TYPE')
    options = parser.parse_intermixed_args(arguments)
    options.topics = dict(pair.split('=', 1) for pair in options.topics)
    return options


def main(arguments: Sequence[str] | None = None) -> int:
    """Record until SIGTERM or SIGINT; the bag gets its name when it is complete."""
    options = options_of(arguments)
    os.environ.update(default_environment())
    participant, ended = current().client('recorder'), stop_event()
    try:
        recording = Recording(participant, options.bag, options.topics, options.best_effort,
                              options.lasting, options.keep_free)
        run(recording.record(partial(print, flush=True)), participant.clock, ended.is_set)
        if recording.full:
            raise DataError(f'{options.bag}: the disk is nearly full (less than '
                            f'{options.keep_free:g} MB left): the recording has ended, and what '
                            'was recorded is kept')
    except GdmpError as error:
        print(f'error: {error}', file=sys.stderr)
        return 1
    finally:
        participant.close()
    return 0


if __name__ == '__main__':
    sys.exit(main())
