"""Waiting for a robot of the studio."""
import time


def wait(robot, until, timeout=40.0):
    """Wait until the robot is as wanted; returns its view."""
    ends = time.monotonic() + timeout
    while True:
        view = robot.view()
        if view is not None and until(view):
            return view
        assert time.monotonic() < ends, view
        time.sleep(0.02)
