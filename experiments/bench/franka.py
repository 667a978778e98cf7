"""
A cycle of the control of a Franka, compared with a client that only reads and writes.

Against a server of the robot's protocol on this machine, without ROS. The arm follows a circle.
"""
from __future__ import annotations

from pathlib import Path
import tempfile
import time
from typing import Any

import numpy as np

from experiments import timing
from gdmp_ros.control.target import resting_target, TWIST
from gdmp_ros.errors import GdmpError
from gdmp_ros.franka.protocol_server import HOST
from gdmp_ros.franka.settings import BETWEEN_CLIENTS_S
from gdmp_ros.realtime.loop import in_loop_thread
from gdmp_ros.ros.arm_choice import ArmChoice
from gdmp_ros.util.terminal import progress

TITLE = 'a cycle of a Franka at 1 kHz'
#: Longest measurement [s], and cycles after the begin that do not count.
LONGEST_S, FIRST = 10.0, 200
#: The circle: radius [m] and angular frequency [rad/s].
RADIUS, RATE = 0.02, 2.0
CLIENTS = ('bare', 'loop')


def run(settings: timing.TimingSettings) -> dict[str, Any]:
    """Figures of both clients, one after the other; none without the server."""
    choice = ArmChoice('franka', protocol_server=True)
    try:
        choice.check()
    except GdmpError as error:
        return {'missing': str(error)}
    from gdmp_ros.franka.bare_client import exchange
    cycles = FIRST + round(1000.0 * min(settings.seconds, LONGEST_S))
    with (tempfile.TemporaryDirectory(prefix='gdmp-franka-') as name, choice.robot(Path(name)),
          progress('clients', len(CLIENTS)) as step):
        bare = in_loop_thread(lambda: exchange(HOST, cycles))
        step()
        time.sleep(BETWEEN_CLIENTS_S)
        own = in_loop_thread(lambda: _follow_circle(cycles))
        step()
    return {'bare': _figures(*bare), 'loop': _figures(*own)}


def _follow_circle(cycles: int) -> tuple[np.ndarray, int]:
    from gdmp_ros.control.arm_control import ArmControl
    from gdmp_ros.franka.driver import FrankaDriver
    from gdmp_ros.franka.robot import FrankaRobot
    from gdmp_ros.franka.settings import FrankaSettings
    settings = FrankaSettings(host=HOST)
    robot = FrankaRobot(settings)
    driver = FrankaDriver(robot, settings.rotor_inertia, wall_time=True)
    loop = ArmControl(driver)
    loop.warm_up(driver.measured, driver.dt)
    figures = np.empty((cycles, 3))
    loop.activate()
    center, begun = driver.measured.pose.copy(), robot.channel.arrived
    worked = time.thread_time_ns()
    for i in range(cycles):
        measured = loop.wait()
        if measured is None:
            raise GdmpError(loop.states.reason)
        loop.must_follow(_on_circle(center, 1e-9 * (robot.channel.arrived - begun)))
        loop.answer(measured)
        answered, last, worked = (time.monotonic_ns() - robot.channel.arrived, worked,
                                  time.thread_time_ns())
        figures[i] = worked - last, answered, robot.success_rate
    loop.end()
    robot.close()
    return figures, driver.lost


def _on_circle(center: np.ndarray, seconds: float) -> np.ndarray:
    angle = RATE * seconds
    target = resting_target(center)
    target[:2] += RADIUS * (np.cos(angle) - 1.0), RADIUS * np.sin(angle)
    target[TWIST:TWIST + 2] = RATE * RADIUS * np.array([-np.sin(angle), np.cos(angle)])
    return target


def _figures(figures: np.ndarray, lost: int) -> dict[str, float]:
    cpu, wall, arrived = figures[FIRST:].T
    return {**{f'{name}_{share}_us': float(np.percentile(values, share)) * 1e-3
               for name, values in (('cpu', cpu), ('wall', wall)) for share in (50, 99)},
            'in_time': float(arrived.mean()),
            'cycles_lost': lost}


def rows(document: dict[str, Any]) -> list[list[str]]:
    """Table: heading, then lines."""
    if 'missing' in document:
        return [['not measured'], [document['missing']]]
    lines = []
    for client, title in zip(CLIENTS, ('reads and writes only', 'loop of franka_arm')):
        d = document[client]
        lines.append([title, *(f'{d[f"{name}_50_us"]:.0f} / {d[f"{name}_99_us"]:.0f}'
                               for name in ('cpu', 'wall')),
                      f'{d["in_time"]:.3f}', f'{d["cycles_lost"]}'])
    return [['client', 'CPU of a cycle p50 / p99 [µs]', 'state to answer p50 / p99 [µs]',
             'commands in time', 'cycles lost'], *lines]
