"""Waiting for a robot of the studio, in lockstep."""


LOOK_NS = 20_000_000


def wait(robot, clock, until, timeout=40.0):
    """Let time pass until the robot is as wanted; returns its view."""
    ends = clock.now() + 1e9 * timeout
    while True:
        view = robot.view()
        if view is not None and until(view):
            return view
        assert clock.now() < ends, view
        clock.sleep_until(clock.now() + LOOK_NS)
