"""A tick of the closed loop without ROS, compared with MuJoCo alone, on one core."""
from __future__ import annotations

import time
from typing import Any, TYPE_CHECKING

import numpy as np

from experiments import timing
from gdmp_ros.data import lasa
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import GdmpError

if TYPE_CHECKING:
    from gdmp_ros.sim.closed_loop import ClosedLoop

TITLE = 'a tick of a simulated Panda, compared with the steps of MuJoCo alone; one core, no ROS'
#: Steps of MuJoCo that are measured at a time.
STEPS = 2000
#: Places that the tool of a Panda cannot reach: too close, below the floor, too far away [m].
LIMITED = ((0.0, 0.0, 0.2), (0.15, 0.0, -0.2), (0.9, 0.5, 0.6))


def run(settings: timing.TimingSettings) -> dict[str, Any]:
    """
    Time of a tick: guard, governor, tank, friction, law and simulation, with a moving reference.

    The reference is taken and the tick is made as in the loop of ``panda_sim``.

    The friction that is compensated is that of the model.

    Medians over repetitions of one skill from start to end. MuJoCo alone: ``mj_step1`` and
    ``mj_step2`` of the same arm, called by compiled code. With limits active: the reference rests
    at the limit of a joint, at a wall, or where the arm is stretched out; the slowest of them.
    """
    from gdmp_ros.sim.arm import Arm
    from gdmp_ros.sim.closed_loop import ClosedLoop
    from gdmp_ros.sim.execution import execution_ticks
    from gdmp_ros.sim.native import address, functions, steps
    skill = Skill.learn(lasa.robot_demonstrations('GShape')[0])
    loop, alone = ClosedLoop(Arm()), Arm()
    resting = [_at_limits(np.array(place)) for place in LIMITED]
    references = np.array([target.copy() for target, _ in execution_ticks(skill, loop)])
    times, simulations, errors = [], [], []
    limited: list[list[float]] = [[] for _ in resting]
    with timing.one_core():
        for _ in range(settings.repetitions):
            loop.reset()
            begun = time.perf_counter()
            poses = loop.follow_all(references)
            times.append(1e6 * (time.perf_counter() - begun) / len(references))
            away = poses[:, :3] - references[:, :3]
            errors.append(float(np.sqrt(np.square(away).sum(axis=1).mean())))
            for measured, (held, targets) in zip(limited, resting):
                begun = time.perf_counter()
                held.follow_all(targets)
                measured.append(1e6 * (time.perf_counter() - begun) / len(targets))
            alone.reset()
            begun = time.perf_counter()
            steps(functions(), address(alone.model), address(alone.data), STEPS)
            simulations.append(1e6 * (time.perf_counter() - begun) / STEPS)
    tick_us, step_us = float(np.median(times)), float(np.median(simulations))
    limited_us = max(float(np.median(one)) for one in limited)
    return {'tick_us': tick_us, 'mj_step_us': step_us, 'ratio': tick_us / step_us,
            'limited_tick_us': limited_us, 'limited_ratio': limited_us / tick_us,
            'position_rmse_m': errors[-1]}


def _at_limits(place: np.ndarray) -> tuple[ClosedLoop, np.ndarray]:
    """Return an arm whose reference is kept from a place by its limits, and references there."""
    from gdmp_ros.control.settings import ControllerSettings, GuardSettings
    from gdmp_ros.control.target import resting_target
    from gdmp_ros.sim.arm import Arm
    from gdmp_ros.sim.closed_loop import ClosedLoop
    loop = ClosedLoop(Arm(), ControllerSettings(guard=GuardSettings(
        jump_position=10.0, arming_position=10.0)))
    pose = loop.arm.measure().pose
    pose[:3] = place
    targets = np.tile(resting_target(pose), (STEPS, 1))
    for _ in range(3):
        loop.follow_all(targets)
    if not loop.controller.blocked:
        raise GdmpError(f'no limit keeps the reference from {place.tolist()}')
    return loop, targets


def rows(document: dict[str, Any]) -> list[list[str]]:
    """Table: heading, then lines."""
    return [['closed loop', 'value'],
            ['one tick of 1 ms [µs]', f'{document["tick_us"]:.0f}'],
            ['mj_step1 and mj_step2 alone, compiled [µs]', f'{document["mj_step_us"]:.1f}'],
            ['ratio', f'{document["ratio"]:.1f}'],
            ['a tick with limits active [µs]', f'{document["limited_tick_us"]:.0f}'],
            ['ratio to a tick without', f'{document["limited_ratio"]:.2f}'],
            ['tracking, position (RMS) [mm]', f'{document["position_rmse_m"] * 1e3:.1f}']]
