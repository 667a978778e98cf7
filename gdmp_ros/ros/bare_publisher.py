"""
Reference for the CPU load of the server: a process that only sleeps and publishes the same bytes.

``publish`` sends references at 1 kHz as the server does, from a template with stamp, sequence
number and numbers; nothing is computed. ``subscribe`` receives them twice, as the arm and a
recorder receive those of the server, so that sending costs the same.
"""
from __future__ import annotations

import itertools
import sys
import time

from gdmp_msgs.msg import Reference
import numpy as np
import rclpy
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from gdmp_ros.control.target import resting_target
from gdmp_ros.realtime.loop import MonotonicClock, run_periodic
from gdmp_ros.ros.lifecycle import DEEP, reliable
from gdmp_ros.ros.messages import fill_reference
from gdmp_ros.ros.polling import PolledGroup, take
from gdmp_ros.ros.serialized import SerializedTemplate
from gdmp_ros.util.signals import stop_event

TOPIC = '/bare_publisher/reference'
PERIOD_NS = 1_000_000
SUBSCRIBERS = 2


def publish() -> None:
    """Publish until SIGTERM."""
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    stop = stop_event()
    message = Reference()
    message.header.frame_id = 'panda_link0'
    numbers = resting_target(np.array([0.5, 0.0, 0.4, 0.0, 1.0, 0.0, 0.0]))
    template = SerializedTemplate(message, len(numbers), fill_reference)
    publisher = Node('bare_publisher').create_publisher(Reference, TOPIC, reliable(DEEP))
    while not stop.is_set() and publisher.get_subscription_count() < SUBSCRIBERS:
        time.sleep(0.05)
    print('publishing', flush=True)
    sequence = itertools.count(1)

    def step(deadline_ns: int, now_ns: int) -> None:
        publisher.publish(template.bytes(numbers, deadline_ns, next(sequence)))

    run_periodic(step, PERIOD_NS, MonotonicClock(), stop.is_set)
    rclpy.shutdown()


def subscribe() -> None:
    """Receive with several participants until SIGTERM."""
    stop, subscriptions = stop_event(), []
    for number in range(SUBSCRIBERS):
        context = rclpy.Context()
        rclpy.init(context=context, args=[], signal_handler_options=SignalHandlerOptions.NO)
        subscriptions.append(Node(f'bare_subscriber_{number}', context=context)
                             .create_subscription(Reference, TOPIC, lambda _: None, reliable(20),
                                                  raw=True, callback_group=PolledGroup()))
    while not stop.wait(0.02):
        for subscription in subscriptions:
            while take(subscription) is not None:
                pass


if __name__ == '__main__':
    {'publish': publish, 'subscribe': subscribe}[sys.argv[1]]()
