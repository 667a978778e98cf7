"""
A goal on a belt: ``python -m test.ros.belt TOPIC KIND SPEED SECONDS X Y Z QW QX QY QZ``.

A process of its own, so that what a test receives does not delay what is sent. Prints when each
goal was sent [ns]; the goal is at the given pose at the first of these times and moves along y.
"""
import random
import sys
import time

from gdmp_msgs.msg import MovingGoal
from geometry_msgs.msg import PoseStamped
import numpy as np
import rclpy

from gdmp_ros.ros import messages
from gdmp_ros.ros.lifecycle import reliable
from test.ros.nodes import FRAME

NS = 1_000_000_000


def where(begin, speed, ns):
    """Pose of the goal ``ns`` after the first one."""
    return begin + speed * ns / NS * np.array([0.0, 1.0, 0, 0, 0, 0, 0])


def main():
    topic, name, speed, seconds, *begin = sys.argv[1:]
    begin, speed, seconds = np.array(begin, float), float(speed), float(seconds)
    kind = {'pose': PoseStamped, 'twist': MovingGoal}[name]
    rclpy.init()
    publisher = rclpy.create_node('belt').create_publisher(kind, topic, reliable(10))
    while publisher.get_subscription_count() == 0:
        time.sleep(0.01)
    choose = random.Random(1)
    first = time.time_ns()
    while time.time_ns() < first + seconds * NS:
        now = time.time_ns()
        message = kind()
        message.header.frame_id, message.header.stamp = FRAME, messages.stamp_of(now)
        messages.set_pose(message.pose, where(begin, speed, now - first))
        if name == 'twist':
            message.twist.linear.y = speed
        time.sleep(0.005 * choose.random())
        publisher.publish(message)
        print(now, flush=True)
        # One message with a twist; or poses at 30 Hz, of which one in five is lost.
        time.sleep(seconds if name == 'twist' else 0.033)
        while choose.random() < 0.2:
            time.sleep(0.033)
    print('end', flush=True)
    time.sleep(60.0)


if __name__ == '__main__':
    main()
