"""A client of a Franka that only reads states and answers with zero torque, to compare with."""
from __future__ import annotations

import time

import numpy as np

from gdmp_ros.util.optional_imports import extra, optional_import

with optional_import(extra('franka')):
    import pylibfranka as libfranka


def exchange(host: str, cycles: int) -> tuple[np.ndarray, int]:
    """
    Control a robot for some cycles with zero torque above gravity; it may sink.

    :returns: CPU time of each cycle, time from the state to the answer, share of the commands that
        arrived in time [ns, ns, 1], shape ``(cycles, 3)``; number of states that were lost
    """
    robot = libfranka.Robot(host, libfranka.RealtimeConfig.kIgnore)
    control, zero = robot.start_torque_control(), libfranka.Torques([0.0] * 7)
    figures, lost = np.empty((cycles, 3)), 0
    worked = time.thread_time_ns()
    for i in range(cycles):
        state, duration = control.readOnce()
        arrived = time.monotonic_ns()
        control.writeOnce(zero)
        answered, last, worked = time.monotonic_ns() - arrived, worked, time.thread_time_ns()
        figures[i] = worked - last, answered, state.control_command_success_rate
        lost += max(round(1e3 * duration.to_sec()) - 1, 0)
    control.readOnce()
    zero.motion_finished = True
    control.writeOnce(zero)
    return figures, lost
