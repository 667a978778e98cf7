"""Checks the connection to a Franka, without moving it."""
from __future__ import annotations

from importlib.metadata import version
import socket
import time

import numpy as np

from gdmp_ros.errors import GdmpError
from gdmp_ros.franka.bare_client import watch
from gdmp_ros.franka.channel import CYCLE_S
from gdmp_ros.franka.robot import FrankaRobot
from gdmp_ros.franka.settings import BETWEEN_CLIENTS_S, FrankaSettings, PORT
from gdmp_ros.realtime.doctor import BAD, FAIR, Finding, GOOD

#: Round trips that are measured, and the longest of a direct cable [s].
TRIPS, LONG_TRIP_S = 5, 1e-3
#: Share of cycles that may be lost.
FEW_LOST = 0.001
#: The time between two states may vary by this, all but 2 % [s]: with less than a third of a cycle
#: states come evenly; with more than a cycle two come at once.
SMALL_JITTER_S, LARGE_JITTER_S = 3e-4, 1e-3


def examine(host: str, seconds: float = 10.0) -> list[Finding]:
    """
    Examine the connection.

    :param seconds: duration of the measurement of the cycles
    """
    findings = [Finding('libfranka', GOOD, f'pylibfranka {version("pylibfranka")}')]
    trips = _round_trips(host)
    if trips is None:
        return [*findings, Finding(
            'connection', BAD, f'no answer from {host}, port {PORT}',
            'connect the computer to the control box (not to the arm), give both addresses of one '
            'network, and activate FCI in Desk')]
    middle, largest = 1e3 * np.median(trips), 1e3 * max(trips)
    level = GOOD if 1e-3 * middle < LONG_TRIP_S else FAIR
    findings.append(Finding('round trip', level, f'{middle:.2f} ms, largest {largest:.2f} ms',
                            '' if level == GOOD else 'use a cable without a switch between'))
    try:
        robot = FrankaRobot(FrankaSettings(host=host))
        try:
            return findings + _cycles(robot, seconds)
        finally:
            robot.close()
    except GdmpError as error:
        return [*findings, Finding('robot', BAD, str(error), 'another program may control it; an '
                                   'older system than 5.9 needs another libfranka')]


def _round_trips(host: str) -> list[float] | None:
    """Times to open a connection, which the network alone decides [s]; None if there is none."""
    trips = []
    for _ in range(TRIPS):
        begun = time.perf_counter()
        try:
            socket.create_connection((host, PORT), timeout=2.0).close()
        except OSError:
            return None
        trips.append(time.perf_counter() - begun)
        time.sleep(0.01)
    time.sleep(BETWEEN_CLIENTS_S)
    return trips


def _cycles(robot: FrankaRobot, seconds: float) -> list[Finding]:
    """States of the robot for a time: which came, and how regularly."""
    robots, arrivals = watch(robot, round(seconds / CYCLE_S))
    steps = np.round(np.diff(robots) / 1e-3)
    lost = float(np.maximum(steps - 1.0, 0.0).sum())
    share = lost / max(lost + len(steps), 1.0)
    # From state to state: a robot's clock that is slow for a while is no jitter.
    between = np.diff(arrivals) - np.diff(robots)
    jitter = float(np.percentile(between, 99.0) - np.percentile(between, 1.0))
    real_time = (robots[-1] - robots[0]) / (arrivals[-1] - arrivals[0])
    return [
        Finding('lost cycles', GOOD if share <= FEW_LOST else BAD,
                f'{lost:.0f} of {lost + len(steps):.0f} in {seconds:g} s',
                '' if share <= FEW_LOST else 'other programs use the cores or the network: close '
                'them; a robot stops after 20 lost cycles in a row'),
        Finding('jitter', GOOD if jitter <= SMALL_JITTER_S else FAIR if jitter <= LARGE_JITTER_S
                else BAD, f'{1e3 * jitter:.2f} ms (98 % of the states)',
                '' if jitter <= SMALL_JITTER_S else 'use a PREEMPT_RT kernel, SCHED_FIFO and the '
                'CPU governor performance'),
        Finding("the robot's time", GOOD if abs(real_time - 1.0) < 0.02 else FAIR,
                f'{real_time:.3f} of real time', '' if abs(real_time - 1.0) < 0.02 else
                'a server of the protocol on a small machine: set wall_time')]
