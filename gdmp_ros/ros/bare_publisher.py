"""
Reference for the CPU load of the server: a process that only sleeps and publishes the same bytes.

``publish`` sends references at 1 kHz in compiled code: stamp and sequence number are new, nothing
is computed. ``subscribe`` receives them twice, as the arm and a recorder receive those of the
server, so that sending costs the same.
"""
from __future__ import annotations

import sys

from gdmp_msgs.msg import Reference
import numpy as np

from gdmp_ros.control.target import TARGET_SIZE
from gdmp_ros.kernels import kernel
from gdmp_ros.realtime.native import clock_functions, sleep_until
from gdmp_ros.ros.dds import current
from gdmp_ros.ros.messages import fill_reference
from gdmp_ros.ros.middleware import DEEP, reliable
from gdmp_ros.ros.rcl import (
    bytes_of,
    Outgoing,
    rcl_functions,
    send_message,
    write_integer,
    write_stamp,
)
from gdmp_ros.ros.serialized import SerializedTemplate
from gdmp_ros.util.processes import stop_event

TOPIC = '/bare_publisher/reference'
PERIOD_NS = 1_000_000
#: Time between two looks for subscribers.
LOOK_NS = 50_000_000
SUBSCRIBERS = 2
#: References that are sent before Python looks whether to end.
BLOCK = 50


@kernel
def send(functions, outlet, clocks, time, deadline, sequence):
    """
    Send `BLOCK` references, one in each period.

    :param deadline: before the first [ns]
    :param sequence: number of the last reference
    """
    data, parts = bytes_of(outlet), outlet.parts
    for _ in range(BLOCK):
        deadline, sequence = deadline + PERIOD_NS, sequence + 1
        sleep_until(clocks, time, deadline)
        write_stamp(data, parts[0], deadline)
        write_integer(data, parts[1], 8, sequence)
        send_message(functions, outlet)


def publish() -> None:
    """Publish until SIGTERM."""
    participant, stop = current().client('bare_publisher'), stop_event()
    clock, message = participant.clock, Reference()
    message.header.frame_id = 'panda_link0'
    template = SerializedTemplate(message, TARGET_SIZE, fill_reference)
    publisher = participant.publisher(Reference, TOPIC, reliable(DEEP))
    sent = Outgoing(publisher, template)
    while not stop.is_set() and publisher.subscribers() < SUBSCRIBERS:
        clock.sleep_until(clock.now() + LOOK_NS)
    time, sequence = np.zeros(2, dtype=np.int64), 0
    with sent.in_use():
        # Compile it first: a deadline that has passed is not waited for.
        send(rcl_functions(), sent.outlet, clock_functions(), time, 0, sequence)
        print('publishing', flush=True)
        deadline = clock.now()
        while not stop.is_set():
            send(rcl_functions(), sent.outlet, clock_functions(), time, deadline, sequence)
            deadline, sequence = deadline + BLOCK * PERIOD_NS, sequence + BLOCK
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
