"""Compiled clients of a Franka that only read states, or answer them with zero torque."""
from __future__ import annotations

import numpy as np

from gdmp_ros.errors import GdmpError
from gdmp_ros.franka.channel import ARRIVED, CAME, CYCLE_S, in_time, NUMBER, passed, receive, send
from gdmp_ros.franka.robot import FrankaRobot, PATIENCE_S
from gdmp_ros.franka.settings import FrankaSettings
from gdmp_ros.kernels import kernel, local_zeros
from gdmp_ros.realtime.loop import in_loop_thread
from gdmp_ros.realtime.native import steady_ns, thread_cpu_ns


@kernel
def _exchange(wire, patience_ms, figures):
    """See `exchange`; -1 if the robot is silent."""
    zero, lost = local_zeros(7), 0
    worked = thread_cpu_ns(wire.clocks, wire.time)
    for k in range(figures.shape[0]):
        if receive(wire, patience_ms) != CAME:
            return -1
        send(wire, zero)
        figures[k, 1] = steady_ns(wire.clocks, wire.time) - wire.integers[ARRIVED]
        last, worked = worked, thread_cpu_ns(wire.clocks, wire.time)
        figures[k, 0], figures[k, 2] = worked - last, in_time(wire)
        if k > 0:
            lost += passed(wire) - 1
    return lost


def exchange(host: str, cycles: int) -> tuple[np.ndarray, int]:
    """
    Control a robot for some cycles with zero torque above gravity; it may sink.

    :returns: CPU time of each cycle, time from the state to the answer, share of the commands that
        arrived in time [ns, ns, 1], shape ``(cycles, 3)``; number of states that were lost
    :raises GdmpError: if the robot does not answer
    """
    robot = FrankaRobot(FrankaSettings(host=host))
    wire, figures = robot.channel.wire, np.empty((cycles, 3))
    _exchange(wire, 1, figures[:0])  # compiled before it is needed
    robot.begin()
    lost = _exchange(wire, round(1e3 * PATIENCE_S), figures)
    if lost < 0:
        raise GdmpError(f'{host}: the robot does not answer')
    robot.read()
    robot.write(np.zeros(7), last=True)
    robot.close()
    return figures, lost


@kernel
def _watch(wire, patience_ms, figures):
    """See `watch`; how many states came before the robot was silent."""
    for k in range(figures.shape[0]):
        if receive(wire, patience_ms) != CAME:
            return k
        figures[k, 0], figures[k, 1] = wire.integers[NUMBER], wire.integers[ARRIVED]
    return figures.shape[0]


def watch(robot: FrankaRobot, states: int) -> tuple[np.ndarray, np.ndarray]:
    """
    Read states of a robot that is not controlled, as the loop of a node does.

    :returns: times by the robot, and of arrival, steady time [s]
    :raises GdmpError: if the robot does not answer
    """
    wire, figures = robot.channel.wire, np.empty((states, 2), dtype=np.int64)
    _watch(wire, 1, figures[:0])  # compiled before it is needed
    came = in_loop_thread(lambda: _watch(wire, round(1e3 * PATIENCE_S), figures))
    if came < states:
        raise GdmpError(f'the robot does not answer: no state within {PATIENCE_S:g} s')
    return CYCLE_S * figures[:, 0], 1e-9 * figures[:, 1]
