"""The demonstration from bags to report."""
from __future__ import annotations

from dataclasses import dataclass
import os
from pathlib import Path
import platform
import shutil
import time
from typing import Any, cast

import numpy as np
import psutil

from gdmp_ros import __version__
from gdmp_ros.cli.record import EPOCH_NS
from gdmp_ros.data import lasa, recordings, runs
from gdmp_ros.data.bags import NS
from gdmp_ros.dmp import Skill
from gdmp_ros.dmp.evaluation import reproduction_error
from gdmp_ros.errors import GdmpError
from gdmp_ros.experiments.demo import pictures, report
from gdmp_ros.manifolds import Product, SymmetricPositiveDefinite, UnitQuaternion
from gdmp_ros.realtime.statistics import Punctuality, punctuality_of
from gdmp_ros.ros.testbed import session
from gdmp_ros.util.atomic_write import write_json
from gdmp_ros.util.dds_network import Domain
from gdmp_ros.util.processes import ChildProcesses, interrupt_on_sigterm
from gdmp_ros.util.terminal import table
from gdmp_ros.view.films import render_to

FRAME = 'panda_link0'
PERIOD_NS = 1_000_000
#: Where the goal goes in mid-motion, from where it was, and its stiffness.
GOAL_STEP_M = np.array([0.03, -0.11, 0.04])
GOAL_TURN_RAD = np.array([0.25, 0.2, 0.3])
GOAL_STIFFNESS = np.diag([300.0, 700.0, 350.0])
#: Recorded before the motion begins and after it has finished [s].
LEAD_S, TAIL_S = 0.5, 1.0


@dataclass(frozen=True)
class Switch:
    """A goal switch: the new goal and how far it is from the old one [m, rad, geodesic]."""

    pose: np.ndarray
    stiffness: np.ndarray
    step_m: float
    step_rad: float
    step_stiffness: float


@dataclass(frozen=True)
class Timeline:
    """When what happened, wall time [ns]; the streamed window in monotonic time [ns]; how."""

    switched: int
    finished: int
    window: tuple[int, int]
    scheduler: str


def run_demo(folder: Path, name: str) -> int:
    """
    Run everything.

    :returns: exit code
    :raises GdmpError: if something ended early or did not happen in time
    """
    interrupt_on_sigterm()
    _clear(folder)
    print(f'demonstrations: LASA {name}, recorded as rosbag2')
    bags = _record(folder, name)
    recording = recordings.read(bags[0])
    skill = Skill.learn(recording.demonstration)
    error = float(reproduction_error(skill, recording.demonstration)[0])
    skill.save(folder / 'skill.json')
    switch = _switch(skill)
    domain = Domain()
    try:
        timeline, cpu = _stream(folder, bags[0], switch, domain.environment())
    finally:
        domain.release()
    print('reading the recorded bag')
    run = runs.read(folder / 'run')
    document = _report(folder, run, timeline, switch, cpu)
    document['learning'] = {'mean_relative_error': error, 'demonstration': bags[0].name}
    write_json(folder / 'report.json', document)
    print('drawing')
    _draw(folder, run, timeline, document)
    _closing_table(document)
    print(f'report, pictures and bag: {folder}')
    return 0


def _clear(folder: Path) -> None:
    """Remove what an earlier run wrote, and nothing else."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in ('demonstrations', 'run', 'logs'):
        shutil.rmtree(folder / name, ignore_errors=True)
    for path in [*folder.glob('.run.*.partial'), *folder.glob('*.png'), *folder.glob('*.npy'),
                 folder / 'report.json', folder / 'skill.json']:
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)


def _record(folder: Path, name: str) -> list[Path]:
    shown = lasa.robot_demonstrations(name)
    bags = [folder / 'demonstrations' / f'{name}_{i + 1}' for i in range(len(shown))]
    for i, (bag, demonstration) in enumerate(zip(bags, shown)):
        recordings.write(bag, demonstration, FRAME, EPOCH_NS + i * 60 * NS)
    return bags


def _switch(skill: Skill) -> Switch:
    manifold = cast(Product, skill.manifold)
    position, orientation, stiffness = manifold.split(skill.goal)
    turned = UnitQuaternion().exp(orientation, 0.5 * GOAL_TURN_RAD)
    return Switch(np.concatenate([position + GOAL_STEP_M, turned]), GOAL_STIFFNESS,
                  float(np.linalg.norm(GOAL_STEP_M)), float(np.linalg.norm(GOAL_TURN_RAD)),
                  SymmetricPositiveDefinite(3).distance(stiffness, GOAL_STIFFNESS))


def _stream(folder: Path, bag: Path, switch: Switch, environment: dict[str, str]
            ) -> tuple[Timeline, dict[str, float]]:
    """Start everything, execute, switch the goal, stop everything."""
    with session(folder, environment, {'lateness_file': str(folder / 'sim.npy')}, {
            'demonstrations': [str(bag)], 'lateness_file': str(folder / 'server.npy')}
                 ) as (operator, children):
        children.start('bare', 'gdmp_ros.realtime.bare_loop', [str(folder / 'bare.npy')])
        operator.spend(1.0)
        timeline, cpu = _perform(operator, switch, children)
        children.stop('bare')
    return timeline, cpu


def _perform(operator: Any, switch: Switch, children: ChildProcesses
             ) -> tuple[Timeline, dict[str, float]]:
    processes = {'server': psutil.Process(children.processes['trajectory_server'].pid),
                 'sim': psutil.Process(children.processes['panda_sim'].pid)}
    begun, used = time.monotonic_ns(), {n: sum(p.cpu_times()[:2]) for n, p in processes.items()}
    operator.spend(LEAD_S)
    print('executing the skill')
    operator.execute()
    operator.wait('half of the motion', lambda: operator.state.progress >= 0.5, 60.0)
    print('switching the goal of pose and stiffness')
    switched = time.time_ns()
    operator.goal_pose(switch.pose, FRAME)
    operator.goal_stiffness(switch.stiffness)
    result = operator.result(60.0)
    finished = time.time_ns()
    if result.error_code != result.SUCCESSFUL:
        raise GdmpError(f'the motion ended with {result.error_code}: {result.error_string}')
    operator.spend(TAIL_S)
    ended = time.monotonic_ns()
    seconds = (ended - begun) * 1e-9
    cpu = {n: (sum(p.cpu_times()[:2]) - used[n]) / seconds for n, p in processes.items()}
    return Timeline(switched, finished, (begun, ended), operator.state.scheduler), cpu


def _window(folder: Path, name: str, timeline: Timeline) -> np.ndarray:
    ticks = np.load(folder / f'{name}.npy')
    inside = (ticks[:, 0] >= timeline.window[0]) & (ticks[:, 0] <= timeline.window[1])
    return np.asarray(ticks[inside])


def _micros(figures: Punctuality) -> dict[str, float]:
    return {'p50': figures.p50_us, 'p99': figures.p99_us, 'max': figures.max_us}


def _report(folder: Path, run: runs.Run, timeline: Timeline, switch: Switch,
            cpu: dict[str, float]) -> dict[str, Any]:
    from gdmp_ros.sim.arm import Arm
    server = punctuality_of(_window(folder, 'server', timeline), PERIOD_NS)
    bare = punctuality_of(_window(folder, 'bare', timeline), PERIOD_NS)
    arm, began = Arm().limits, run.reference_stamps[int(np.argmax(run.moving))]
    return {
        'stream': {'rate_hz': server.rate_hz, 'bare_rate_hz': bare.rate_hz, 'ticks': server.ticks,
                   'missed': server.missed, 'bare_missed': bare.missed, 'lost': report.lost(run),
                   'lateness_us': _micros(server), 'bare_lateness_us': _micros(bare),
                   'scheduler': timeline.scheduler, 'cpu': cpu},
        'tracking': report.tracking(run, timeline.finished),
        'goal_switch': {'at_s': (timeline.switched - began) * 1e-9,
                        'finished_s': (timeline.finished - began) * 1e-9,
                        **report.at_goal(run, timeline.finished, switch.pose, switch.stiffness),
                        'step_m': switch.step_m, 'step_rad': switch.step_rad,
                        'step_stiffness': switch.step_stiffness},
        'limits': report.limits(run, arm.lower, arm.upper, arm.torque),
        'environment': {'gdmp_ros': __version__, 'python': platform.python_version(),
                        'kernel': platform.release(), 'cpus': os.cpu_count(),
                        'numpy': np.__version__},
    }


def _draw(folder: Path, run: runs.Run, timeline: Timeline, document: dict[str, Any]) -> None:
    lateness = {'trajectory_server': _window(folder, 'server', timeline)[:, 1] * 1e-3,
                'panda_sim': _window(folder, 'sim', timeline)[:, 1] * 1e-3,
                'bare sleeping loop': _window(folder, 'bare', timeline)[:, 1] * 1e-3}
    pictures.draw(run, folder, document['goal_switch']['at_s'], timeline.finished, lateness)
    missing = render_to(folder / 'arm.png', run.joints[-1], run.poses[::100, :3])
    if missing:
        print(missing)


def _closing_table(document: dict[str, Any]) -> None:
    s, t, g = document['stream'], document['tracking'], document['goal_switch']
    late, bare = s['lateness_us'], s['bare_lateness_us']
    limits = ', '.join(name for name, held in document['limits'].items() if not held)
    table('what was measured', ['', 'value', 'bare loop'], [
        ['rate [Hz]', f'{s["rate_hz"]:.1f}', f'{s["bare_rate_hz"]:.1f}'],
        ['ticks missed', f'{s["missed"]} of {s["ticks"]}', s['bare_missed']],
        ['lateness p50 / p99 / max [µs]', ' / '.join(f'{late[k]:.0f}' for k in late),
         ' / '.join(f'{bare[k]:.0f}' for k in bare)],
        ['references lost', s['lost'], ''],
        ['CPU server / simulation [cores]',
         f'{s["cpu"]["server"]:.2f} / {s["cpu"]["sim"]:.2f}', ''],
        ['tracking, position / rotation (RMS)',
         f'{t["position_rmse_m"] * 1e3:.1f} mm / {t["rotation_rmse_rad"]:.4f} rad', ''],
        ['goal switched by', f'{g["step_m"]:.2f} m, {g["step_rad"]:.2f} rad, '
                             f'stiffness {g["step_stiffness"]:.2f}', ''],
        ['at the new goal', f'{g["final_position_error_m"] * 1e3:.2f} mm, '
                            f'{g["final_rotation_error_rad"]:.4f} rad, '
                            f'stiffness {g["final_stiffness_distance"]:.4f}', ''],
        ['limits', f'exceeded: {limits}' if limits else 'all kept', '']])
