"""
Reference for the CPU load of the server: a process that only sleeps and publishes the same bytes.

``publish`` sends a serialised reference at 1 kHz; ``subscribe`` receives it twice, as the arm and
a recorder receive those of the server, so that sending costs the same.
"""
from __future__ import annotations

import sys
import time

from gdmp_msgs.msg import Reference
import rclpy
from rclpy.node import Node
from rclpy.serialization import serialize_message
from rclpy.signals import SignalHandlerOptions

from gdmp_ros.realtime.loop import MonotonicClock, run_periodic
from gdmp_ros.ros.lifecycle import DEEP, reliable
from gdmp_ros.ros.polling import PolledGroup, take
from gdmp_ros.util.processes import stop_event

TOPIC = '/bare_publisher/reference'
PERIOD_NS = 1_000_000
SUBSCRIBERS = 2


def publish() -> None:
    """Publish until SIGTERM."""
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    stop = stop_event()
    message = Reference()
    message.header.frame_id = 'panda_link0'
    data = serialize_message(message)
    publisher = Node('bare_publisher').create_publisher(Reference, TOPIC, reliable(DEEP))
    while not stop.is_set() and publisher.get_subscription_count() < SUBSCRIBERS:
        time.sleep(0.05)
    print('publishing', flush=True)
    run_periodic(lambda *_: publisher.publish(data), PERIOD_NS, MonotonicClock(), stop.is_set)
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
