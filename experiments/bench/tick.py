"""A tick of the closed loop without ROS, compared with MuJoCo alone, on one core."""
from __future__ import annotations

import time
from typing import Any

import numpy as np

from experiments import timing
from gdmp_ros.data import lasa
from gdmp_ros.dmp.skill import Skill

TITLE = 'a tick of a simulated Panda, compared with the steps of MuJoCo alone; one core, no ROS'
#: Steps of MuJoCo that are measured at a time.
STEPS = 2000


def run(settings: timing.TimingSettings) -> dict[str, Any]:
    """
    Time of a tick: guard, governor, tank, friction, law and simulation, with a moving reference.

    The reference is taken and the tick is made as in the loop of ``panda_sim``.

    The friction that is compensated is that of the model.

    Medians over repetitions of one skill from start to end. MuJoCo alone: ``mj_step1`` and
    ``mj_step2`` of the same arm, called by compiled code.
    """
    from gdmp_ros.sim.arm import Arm
    from gdmp_ros.sim.closed_loop import ClosedLoop
    from gdmp_ros.sim.execution import execution_ticks
    from gdmp_ros.sim.native import address, functions, steps
    skill = Skill.learn(lasa.robot_demonstrations('GShape')[0])
    loop, alone = ClosedLoop(Arm()), Arm()
    references = np.array([target.copy() for target, _ in execution_ticks(skill, loop)])
    times, simulations, errors = [], [], []
    with timing.one_core():
        for _ in range(settings.repetitions):
            loop.reset()
            begun = time.perf_counter()
            poses = loop.follow_all(references)
            times.append(1e6 * (time.perf_counter() - begun) / len(references))
            away = poses[:, :3] - references[:, :3]
            errors.append(float(np.sqrt(np.square(away).sum(axis=1).mean())))
            alone.reset()
            begun = time.perf_counter()
            steps(functions(), address(alone.model), address(alone.data), STEPS)
            simulations.append(1e6 * (time.perf_counter() - begun) / STEPS)
    tick_us, step_us = float(np.median(times)), float(np.median(simulations))
    return {'tick_us': tick_us, 'mj_step_us': step_us, 'ratio': tick_us / step_us,
            'position_rmse_m': errors[-1]}


def rows(document: dict[str, Any]) -> list[list[str]]:
    """Table: heading, then lines."""
    return [['closed loop', 'value'],
            ['one tick of 1 ms [µs]', f'{document["tick_us"]:.0f}'],
            ['mj_step1 and mj_step2 alone, compiled [µs]', f'{document["mj_step_us"]:.1f}'],
            ['ratio', f'{document["ratio"]:.1f}'],
            ['tracking, position (RMS) [mm]', f'{document["position_rmse_m"] * 1e3:.1f}']]
