"""Recorded references of a stream, to send them again."""
from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gdmp_ros.control.modes import StreamMode
from gdmp_ros.data.bags import message_of, NS, opened, REFERENCE, topics_in
from gdmp_ros.data.message_numbers import reference_target
from gdmp_ros.errors import DataError

#: A longer pause between two references is not replayed [s].
LONGEST_PAUSE_S = 60.0


class RecordedReferences(NamedTuple):
    """
    References in the order of their stamps.

    :ivar frame: ``frame_id`` of all of them
    :ivar times: since the first one [s], shape ``(T,)``
    :ivar targets: shape ``(T, TARGET_SIZE)`` (`gdmp_ros.control.target`)
    :ivar modes: `StreamMode` of each
    :ivar steps: by which the sequence number grows at each
    """

    topic: str
    frame: str
    times: np.ndarray
    targets: np.ndarray
    modes: list[StreamMode]
    steps: np.ndarray


def read_references(bag: Path, topic: str = '') -> RecordedReferences:
    """
    Read the references of one stream from a bag.

    :param topic: by default the only topic of this type
    :raises DataError: if there are none, of several topics or publishers, in several frames, or of
        joints
    """
    with opened(bag) as reader:
        known = [name for name, kind, count in topics_in(reader) if kind == REFERENCE and count]
        if topic not in known if topic else len(known) != 1:
            raise DataError(f'{bag}: expected {"references on " + topic if topic else "one topic"}'
                            f' of type {REFERENCE}, the bag has {", ".join(known) or "none"}')
        topic = topic or known[0]
        connections = [c for c in reader.connections if c.topic == topic]
        messages: list[Any] = [message_of(reader, connection, raw)
                               for connection, _, raw in reader.messages(connections)]
    messages.sort(key=lambda m: int(m.sequence))
    frames = sorted({message.header.frame_id for message in messages})
    if len(frames) > 1:
        raise DataError(f'{bag}, topic {topic}: the frames are {", ".join(frames)}, expected one')
    if any(len(getattr(message, 'joints', ())) for message in messages):
        raise DataError(f'{bag}, topic {topic}: references of the joints cannot be replayed')
    stamps = np.array([m.header.stamp.sec * NS + m.header.stamp.nanosec for m in messages])
    times = (stamps - stamps[0]) / NS
    pauses = np.diff(times)
    wrong = (pauses < 0.0) | (pauses > LONGEST_PAUSE_S)
    if wrong.any():
        at = int(np.argmax(wrong)) + 1
        raise DataError(f'{bag}, topic {topic}, reference {at}: its stamp is '
                        f'{pauses[at - 1]:.3g} s after that of the one before, expected 0 to '
                        f'{LONGEST_PAUSE_S:g} s: are there several publishers?')
    sequences = [int(m.sequence) for m in messages]
    return RecordedReferences(
        topic, frames[0], times, np.array([reference_target(m) for m in messages]),
        [StreamMode(getattr(m, 'mode', 0)) for m in messages],
        np.diff(sequences, prepend=sequences[0] - 1))
