"""Speed of the closed loop without ROS: reference, impedance law and arm on one core."""
from __future__ import annotations

import time
from typing import Any

import numpy as np

from experiments import timing
from gdmp_ros.data import lasa
from gdmp_ros.dmp.skill import Skill

TITLE = 'closed-loop simulation of a Panda, one core, without ROS'


def run(settings: timing.TimingSettings) -> dict[str, Any]:
    """Simulated time / real time: median over repetitions of one skill from start to end."""
    from gdmp_ros.sim.arm import Arm
    from gdmp_ros.sim.closed_loop import ClosedLoop
    from gdmp_ros.sim.execution import execution_ticks
    skill = Skill.learn(lasa.robot_demonstrations('GShape')[0])
    loop = ClosedLoop(Arm())
    ratios, errors, seconds = [], [], 0.0
    with timing.one_core():
        for _ in range(settings.repetitions):
            loop.reset()
            begun = time.perf_counter()
            errors_m = [np.linalg.norm(tick.measurement.pose[:3] - target[:3])
                        for target, tick in execution_ticks(skill, loop)]
            seconds = len(errors_m) * loop.arm.period
            ratios.append(seconds / (time.perf_counter() - begun))
            errors.append(float(np.sqrt(np.mean(np.square(errors_m)))))
    return {'times_real_time': float(np.median(ratios)), 'simulated_s': seconds,
            'tick_us': 1e6 * loop.arm.period / float(np.median(ratios)),
            'position_rmse_m': errors[-1]}


def rows(document: dict[str, Any]) -> list[list[str]]:
    """Table: heading, then lines."""
    return [['closed loop', 'value'],
            ['simulated time / real time', f'{document["times_real_time"]:.1f} ×'],
            ['one tick of 1 ms [µs]', f'{document["tick_us"]:.0f}'],
            ['tracking, position (RMS) [mm]', f'{document["position_rmse_m"] * 1e3:.1f}']]
