"""
Reference for the CPU load of the server: a process that only sleeps and publishes the same bytes.

``publish`` sends references at 1 kHz as the server does, from a template with stamp, sequence
number and numbers; nothing is computed. ``subscribe`` receives them twice, as the arm and a
recorder receive those of the server, so that sending costs the same.
"""
from __future__ import annotations

import itertools
import sys

from gdmp_msgs.msg import Reference
import numpy as np

from gdmp_ros.control.target import resting_target
from gdmp_ros.realtime.loop import periodic, run
from gdmp_ros.ros.dds import current
from gdmp_ros.ros.messages import fill_reference
from gdmp_ros.ros.middleware import DEEP, reliable
from gdmp_ros.ros.serialized import SerializedTemplate
from gdmp_ros.util.processes import stop_event

TOPIC = '/bare_publisher/reference'
PERIOD_NS = 1_000_000
#: Time between two looks for subscribers.
LOOK_NS = 50_000_000
SUBSCRIBERS = 2


def publish() -> None:
    """Publish until SIGTERM."""
    participant, stop = current().client('bare_publisher'), stop_event()
    clock = participant.clock
    message = Reference()
    message.header.frame_id = 'panda_link0'
    numbers = resting_target(np.array([0.5, 0.0, 0.4, 0.0, 1.0, 0.0, 0.0]))
    template = SerializedTemplate(message, len(numbers), fill_reference)
    publisher = participant.publisher(Reference, TOPIC, reliable(DEEP))
    while not stop.is_set() and publisher.subscribers() < SUBSCRIBERS:
        clock.sleep_until(clock.now() + LOOK_NS)
    print('publishing', flush=True)
    sequence = itertools.count(1)

    def step(deadline_ns: int, now_ns: int) -> None:
        publisher.send(template.bytes(numbers, deadline_ns, next(sequence)))

    run(periodic(step, PERIOD_NS, clock), clock, stop.is_set)
    participant.close()


def subscribe() -> None:
    """Receive with several participants until SIGTERM."""
    stop = stop_event()
    subscriptions = [current().client(f'bare_subscriber_{number}').subscription(
        Reference, TOPIC, reliable(20)) for number in range(SUBSCRIBERS)]
    while not stop.wait(0.02):
        for subscription in subscriptions:
            subscription.discard()


if __name__ == '__main__':
    {'publish': publish, 'subscribe': subscribe}[sys.argv[1]]()
