"""Wiping: a cycle is shown on a table, and executed on tables that are higher and lower."""
from __future__ import annotations

from pathlib import Path
import shutil
from typing import Any

from gdmp_msgs.action import ExecuteSkill
import numpy as np

from gdmp_ros.control.settings import LimitSettings
from gdmp_ros.control.target import resting_target, WRENCH, WRENCH_GAIN
from gdmp_ros.data import bags, recordings
from gdmp_ros.data.run_analysis import limit_figures
from gdmp_ros.data.runs import Run
from gdmp_ros.data.skill_from_bags import LearningSettings, skill_from_bags
from gdmp_ros.errors import ParameterError
from gdmp_ros.ros.arm_choice import ArmChoice, SIMULATED
from gdmp_ros.ros.clients.testbed import NodeTestbed, Opener, process_bed
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.closed_loop import ClosedLoop
from gdmp_ros.sim.scenes import cloth_table
from gdmp_ros.util.atomic_write import write_json
from gdmp_ros.util.profiles import smoothstep
from gdmp_ros.util.signals import interrupt_on_sigterm
from gdmp_ros.util.terminal import table

FRAME, WRENCH_TOPIC = 'panda_link0', '/ft/wrench'
#: Force [N], period [s] and radius [m] of the wiping that is shown, and how many cycles.
FORCE, PERIOD, RADIUS, SHOWN = 12.0, 2.5, 0.05, 5
#: Table below the tool [m], and the way down to it and up [s].
BELOW, WAY_S = 0.03, 1.5
#: How much higher the tables are on which it is executed [m].
HEIGHTS = (-0.02, 0.0, 0.02)
#: Cycles that are executed; the first one is the entry and does not count.
CYCLES = 4
#: Largest distance of the tool from the reference at the end [m, rad]: the height of a table is
#: not known.
TABLE_TOLERANCE = (0.04, 0.05)
#: Rate at which the measured force is corrected [1/s].
GAIN = 5.0
#: Standard deviation of the noise of the sensors [m, N].
POSITION_NOISE, FORCE_NOISE = 1e-4, 0.3
#: Largest change of a joint torque in a tick [Nm].
TORQUE_RATE = 1.0
#: Ticks of the demonstration between two samples.
SAMPLE_EVERY = 5


def record_wiping(bag: Path) -> None:
    """Show the wiping to the simulated arm: down, circles with a force, and up; with noise."""
    loop, rng = ClosedLoop(Arm(cloth_table(BELOW))), np.random.default_rng(1)
    start, seconds = loop.arm.measure().pose.copy(), SHOWN * PERIOD
    with bags.BagWriter(bag) as writer:
        for k in range(round(1000 * (seconds + 2.0 * WAY_S))):
            t = 1e-3 * k - WAY_S
            down = smoothstep(min(t / WAY_S + 1.0, 1.0))
            up = smoothstep(max((t - seconds) / WAY_S, 0.0))
            angle = 2.0 * np.pi * min(max(t, 0.0), seconds) / PERIOD
            target = resting_target(start)
            target[:3] += [RADIUS * (np.cos(angle) - 1.0), RADIUS * np.sin(angle),
                           -BELOW * (down - up)]
            target[WRENCH + 2] = -FORCE * smoothstep(min(max(t + 0.5, 0.0) / 0.5, 1.0)) * (1 - up)
            target[WRENCH_GAIN + 2] = GAIN
            loop.must_follow(target)
            tick = loop.tick()
            if k % SAMPLE_EVERY:
                continue
            stamp = recordings.EPOCH_NS + k * 1_000_000
            pose = tick.measurement.pose.copy()
            pose[:3] += POSITION_NOISE * rng.standard_normal(3)
            felt = tick.wrench + FORCE_NOISE * rng.standard_normal(6) * [1, 1, 1, .03, .03, .03]
            writer.pose(recordings.POSE_TOPIC, stamp, pose.tolist(), FRAME)
            writer.wrench(WRENCH_TOPIC, stamp + 300_000, felt.tolist(), FRAME)


def run_wiping(folder: Path, arm: ArmChoice, testbed: Opener = process_bed) -> int:
    """
    Show, learn and execute the wiping.

    :param testbed: see `gdmp_ros.ros.clients.testbed.process_bed`
    :returns: exit code: 0 if the force is kept on all tables
    :raises GdmpError: if something does not happen in time
    """
    interrupt_on_sigterm()
    if arm.node != SIMULATED:
        raise ParameterError('--task wipe puts tables under the simulated arm: leave --arm out')
    folder.mkdir(parents=True, exist_ok=True)
    for name in ('demonstration', 'runs', 'logs'):
        shutil.rmtree(folder / name, ignore_errors=True)
    print('wiping a table, shown to the simulated arm', flush=True)
    record_wiping(folder / 'demonstration')
    print('learning', flush=True)
    figures: dict[str, Any] = {'task': 'wipe', 'shown_force_n': FORCE, 'tables': []}
    for name, topic in (('with force', WRENCH_TOPIC), ('plain', '')):
        learned = skill_from_bags([folder / 'demonstration'], LearningSettings(
            pose_topic=recordings.POSE_TOPIC, wrench_topic=topic, stiffness='none',
            rhythmic=True)).skill
        path = folder / f'{name.replace(" ", "-")}.json'
        learned.save(path)
        figures['period_s'] = learned.duration
        for height in HEIGHTS:
            print(f'{name}, table {1e3 * height:+.0f} mm', flush=True)
            figures['tables'].append({'skill': name, 'height_m': height,
                                      **_execute(folder, path, height, learned.duration, testbed)})
    kept = [one for one in figures['tables'] if one['skill'] == 'with force']
    figures['succeeded'] = all(
        one['force_rmse_n'] < 0.2 * FORCE and one['least_tank_j'] > 0.0
        and not one['error'] and not one['limits_broken'] for one in kept)
    write_json(folder / 'report.json', figures)
    table('force on the table', ['skill', 'table [mm]', 'force RMSE [N]', 'mean force [N]',
                                 'least energy in the tank [J]', 'limits'],
          [[one['skill'], f'{1e3 * one["height_m"]:+.0f}', f'{one["force_rmse_n"]:.2f}',
            f'{one["mean_force_n"]:.2f}', f'{one["least_tank_j"]:.2f}',
            ', '.join(one['limits_broken']) or 'kept'] for one in figures['tables']])
    print(f'report: {folder / "report.json"}')
    return 0 if figures['succeeded'] else 1


def _execute(folder: Path, skill: Path, height: float, period: float, testbed: Opener
             ) -> dict[str, Any]:
    """Wipe a table through the nodes."""
    name = f'{skill.stem}{1e3 * height:+.0f}mm'
    scene = folder / f'table{1e3 * height:+.0f}mm.xml'
    spec = cloth_table(BELOW - height)
    spec.compile()
    scene.write_text(spec.to_xml())
    with testbed(NodeTestbed, folder / 'runs' / name) as bed:
        bed.start({'model': str(scene.resolve())}, {'skill': str(skill.resolve()),
                                                    'wrench_gain': GAIN})
        # On a table that is elsewhere the tool does not reach the reference, and need not.
        bed.client.execute(ExecuteSkill.Goal(
            cycles=float(CYCLES), robot_position_tolerance=TABLE_TOLERANCE[0],
            robot_rotation_tolerance=TABLE_TOLERANCE[1]))
        result = bed.client.result(60.0)
        run = bed.recorded()
    return {'error': '' if result.error_code == result.SUCCESSFUL else result.error_string,
            **_figures(run, period)}


def _figures(run: Run, period: float) -> dict[str, Any]:
    """Force, energy and limits, from the second cycle to the last one."""
    began = int(run.reference_stamps[int(np.argmax(run.moving))])
    first, last = (began + round(cycles * period * 1e9) for cycles in (1.0, CYCLES - 0.1))
    within = (run.state_stamps >= first) & (run.state_stamps <= last)
    force = run.wrenches[within, 2]
    limits, joints = limit_figures(run, Arm().limits), LimitSettings()
    broken = [name for name, value, most in (
        ('torque', limits.torque, 1.0), ('torque rate', limits.torque_rate, TORQUE_RATE),
        ('joint position', -limits.joint_distance, 0.0),
        ('joint speed', limits.joint_speed, joints.joint_speed),
        ('speed', limits.speed, joints.speed)) if value > most]
    return {'force_rmse_n': float(np.sqrt(np.mean((force - FORCE) ** 2))),
            'mean_force_n': float(force.mean()), 'least_tank_j': limits.tank_energy,
            'limits_broken': broken}
