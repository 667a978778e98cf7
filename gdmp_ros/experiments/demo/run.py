"""The demonstration, from recorded bags to a report."""
from __future__ import annotations

from dataclasses import dataclass
import os
from pathlib import Path
import platform
import shutil
import time
from typing import Any, cast

from diagnostic_msgs.msg import DiagnosticArray
import numpy as np
import psutil

from gdmp_ros import __version__
from gdmp_ros.control.measurement import JointLimits
from gdmp_ros.control.settings import LimitSettings
from gdmp_ros.data import lasa, recordings, run_analysis, runs
from gdmp_ros.data.bags import NS
from gdmp_ros.dmp.evaluation import reproduction_error
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import GdmpError
from gdmp_ros.experiments.demo import pictures
from gdmp_ros.manifolds.product import Product
from gdmp_ros.manifolds.quaternion import UnitQuaternion
from gdmp_ros.manifolds.spd import SymmetricPositiveDefinite
from gdmp_ros.realtime.statistics import Punctuality, punctuality_of
from gdmp_ros.ros.arm_choice import ArmChoice
from gdmp_ros.ros.clients.joints_client import move_joints
from gdmp_ros.ros.messages import CPU_TIME, IN_TIME, LOST
from gdmp_ros.ros.testbed import NodeTestbed, SERVER
from gdmp_ros.util.atomic_write import write_json
from gdmp_ros.util.dds_network import Domain
from gdmp_ros.util.signals import interrupt_on_sigterm
from gdmp_ros.util.terminal import table
from gdmp_ros.view.films import render_to

FRAME = 'panda_link0'
PERIOD_NS = 1_000_000
#: Goal switch at mid-motion: change of position and orientation, and new stiffness.
GOAL_STEP_M = np.array([0.03, -0.11, 0.04])
GOAL_ROTATION_RAD = np.array([0.25, 0.2, 0.3])
GOAL_STIFFNESS = np.diag([300.0, 700.0, 350.0])
#: Recorded before the motion begins and after it has finished [s].
LEAD_S, TAIL_S = 0.5, 1.0
#: Duration of the measurement of a bare loop that is not beside the motion [s].
BARE_S = 3.0


@dataclass(frozen=True)
class Switch:
    """A goal switch: the new goal, and its distance from the old one [m, rad, geodesic]."""

    pose: np.ndarray
    stiffness: np.ndarray
    step_m: float
    step_rad: float
    step_stiffness: float


@dataclass(frozen=True)
class Timeline:
    """
    Times of the execution, and CPU load in between.

    :ivar switched: goal switch, wall time [ns]
    :ivar finished: end of the motion, wall time [ns]
    :ivar window: of the evaluation, steady time [ns]
    :ivar cpu: cores used by each process
    :ivar diagnosed: what the arm said of itself on ``/diagnostics``
    """

    switched: int
    finished: int
    window: tuple[int, int]
    scheduler: str
    cpu: dict[str, float]
    diagnosed: list[dict[str, str]]


def run_demo(folder: Path, name: str, arm: ArmChoice) -> int:
    """
    Run everything.

    :param name: LASA class
    :returns: exit code
    :raises GdmpError: if a process ended early or something did not happen in time
    """
    interrupt_on_sigterm()
    arm.check()
    _clear(folder)
    print(f'demonstrations: LASA {name}, recorded as rosbag2', flush=True)
    bags = _record(folder, name)
    recording = recordings.read(bags[0])
    skill = Skill.learn(recording.demonstration)
    error = float(reproduction_error(skill, recording.demonstration)[0])
    skill.save(folder / 'skill.json')
    switch = _switch(skill)
    with (Domain() as domain, arm.robot(folder / 'logs'),
          NodeTestbed(folder, domain.environment(), arm) as bed):
        timeline = _stream(bed, bags[0], switch)
        print('reading the recorded bag', flush=True)
        run = bed.recorded()
    document = _report(folder, run, timeline, switch, arm)
    document['learning'] = {'mean_relative_error': error, 'demonstration': bags[0].name}
    write_json(folder / 'report.json', document)
    print('drawing', flush=True)
    _draw(folder, run, timeline, document)
    _print_table(document)
    print(f'report, pictures and bag: {folder}')
    return 0


def _clear(folder: Path) -> None:
    """Remove the results of an earlier run, and nothing else."""
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
        recordings.write(bag, demonstration, FRAME, recordings.EPOCH_NS + i * 60 * NS)
    return bags


def _switch(skill: Skill) -> Switch:
    manifold = cast(Product, skill.manifold)
    position, orientation, stiffness = manifold.split(skill.goal)
    rotated = UnitQuaternion().exp(orientation, 0.5 * GOAL_ROTATION_RAD)
    return Switch(np.concatenate([position + GOAL_STEP_M, rotated]), GOAL_STIFFNESS,
                  float(np.linalg.norm(GOAL_STEP_M)), float(np.linalg.norm(GOAL_ROTATION_RAD)),
                  SymmetricPositiveDefinite(3).distance(stiffness, GOAL_STIFFNESS))


def _stream(bed: NodeTestbed, bag: Path, switch: Switch) -> Timeline:
    """Start all processes, execute the skill and switch its goal."""
    print('starting arm, server and recorder', flush=True)
    if bed.arm.kind == 'franka':
        bed.start_arm(lateness_file=str(bed.folder / 'sim.npy'))
        print('moving to the home posture', flush=True)
        move_joints(bed.client, bed.arm.node)
    bed.start(arm={'lateness_file': str(bed.folder / 'sim.npy')},
              server={'demonstrations': [str(bag)],
                      'lateness_file': str(bed.folder / 'server.npy')})
    bed.children.start('bare', 'gdmp_ros.realtime.bare_loop', [str(bed.folder / 'bare.npy')])
    for name in ('subscribe', 'publish'):
        bed.children.start(f'bare_{name}', 'gdmp_ros.ros.bare_publisher', [name])
    bed.wait_log('bare_publish', 'publishing', 30.0)
    bed.spend(1.0)
    bare = {}
    if bed.arm.kind == 'franka':
        # Not beside the motion of a robot, which needs the cores.
        used = _cpu_seconds(bed)
        bed.spend(BARE_S)
        bare = {'bare': (_cpu_seconds(bed)['bare'] - used['bare']) / BARE_S}
        for name in ('bare', 'bare_publish', 'bare_subscribe'):
            bed.children.stop(name)
    timeline = _execute(bed, switch)
    timeline.cpu.update(bare)
    for name in ('bare', SERVER, bed.arm.node):  # they write their lateness at the end
        if name in bed.children.processes:
            bed.children.stop(name)
    return timeline


def _execute(bed: NodeTestbed, switch: Switch) -> Timeline:
    diagnosed: list[dict[str, str]] = []
    bed.client.node.create_subscription(DiagnosticArray, '/diagnostics', lambda message: (
        diagnosed.extend({one.key: one.value for one in status.values}
                         for status in message.status if bed.arm.node in status.name)), 50)
    begun, used = time.monotonic_ns(), _cpu_seconds(bed)
    bed.spend(LEAD_S)
    print('executing the skill', flush=True)
    bed.client.execute()
    bed.wait_progress(0.5)
    print('switching the goal of pose and stiffness', flush=True)
    switched = time.time_ns()
    bed.client.goal_pose(switch.pose, FRAME)
    bed.client.goal_stiffness(switch.stiffness)
    result = bed.client.result(60.0)
    finished = time.time_ns()
    if result.error_code != result.SUCCESSFUL:
        hint = ('; without --friction its dry friction holds it: gdmp identify-friction'
                if bed.arm.kind == 'franka' and bed.arm.friction is None else '')
        raise GdmpError(f'the motion ended with {result.error_code}: {result.error_string}{hint}')
    bed.spend(TAIL_S)
    ended, used_then = time.monotonic_ns(), _cpu_seconds(bed)
    seconds = (ended - begun) * 1e-9
    return Timeline(switched, finished, (begun, ended), bed.state.scheduler,
                    {name: (used_then[name] - used[name]) / seconds for name in used}, diagnosed)


def _cpu_seconds(bed: NodeTestbed) -> dict[str, float]:
    processes = {'server': SERVER, 'sim': bed.arm.node, 'bare': 'bare_publish'}
    return {name: sum(psutil.Process(bed.children.processes[process].pid).cpu_times()[:2])
            for name, process in processes.items() if process in bed.children.processes}


def _window(folder: Path, name: str, timeline: Timeline) -> np.ndarray:
    ticks = np.load(folder / f'{name}.npy')
    inside = (ticks[:, 0] >= timeline.window[0]) & (ticks[:, 0] <= timeline.window[1])
    # A loop that follows the clock of a robot has other deadlines: all of its ticks count.
    return np.asarray(ticks[inside] if inside.any() else ticks)


def _report(folder: Path, run: runs.Run, timeline: Timeline, switch: Switch, arm: ArmChoice
            ) -> dict[str, Any]:
    began = int(run.reference_stamps[int(np.argmax(run.moving))])
    goal = run_analysis.goal_error(run, timeline.finished, switch.pose, switch.stiffness)
    return {
        'stream': _stream_figures(folder, run, timeline),
        'tracking': _tracking_figures(run, began, timeline.finished),
        'goal_switch': {'at_s': (timeline.switched - began) * 1e-9,
                        'finished_s': (timeline.finished - began) * 1e-9,
                        'final_position_error_m': goal.position,
                        'final_rotation_error_rad': goal.rotation,
                        'final_stiffness_distance': goal.stiffness, 'step_m': switch.step_m,
                        'step_rad': switch.step_rad, 'step_stiffness': switch.step_stiffness},
        'arm': arm.node, 'limits': _limits(run, arm.limits), **_robot_figures(timeline, arm),
        'environment': {'gdmp_ros': __version__, 'python': platform.python_version(),
                        'kernel': platform.release(), 'cpus': os.cpu_count(),
                        'numpy': np.__version__},
    }


def _stream_figures(folder: Path, run: runs.Run, timeline: Timeline) -> dict[str, Any]:
    server, bare = (punctuality_of(_window(folder, name, timeline), PERIOD_NS)
                    for name in ('server', 'bare'))
    return {'rate_hz': server.rate_hz, 'bare_rate_hz': bare.rate_hz, 'ticks': server.ticks,
            'missed': server.missed, 'bare_missed': bare.missed, 'lost': runs.lost(run),
            'lateness_us': _micros(server), 'bare_lateness_us': _micros(bare),
            'scheduler': timeline.scheduler, 'cpu': timeline.cpu}


def _robot_figures(timeline: Timeline, arm: ArmChoice) -> dict[str, Any]:
    """Cycles of a Franka during the motion: commands in time, states lost, CPU time."""
    if arm.kind != 'franka':
        return {}
    shown = [one for one in timeline.diagnosed if IN_TIME in one]
    if not shown:
        raise GdmpError('the arm has published no diagnostics')
    in_time = [float(one[IN_TIME]) for one in shown]
    p50, p99 = (float(number) for number in shown[-1][CPU_TIME].split(','))
    return {'robot': {
        'commands_in_time': float(np.mean(in_time)), 'least_in_100': min(in_time),
        'cycles_lost': int(shown[-1][LOST]) - int(shown[0][LOST]),
        'cycle_cpu_us': {'p50': p50, 'p99': p99}}}


def _micros(figures: Punctuality) -> dict[str, float]:
    return {'p50': figures.p50_us, 'p99': figures.p99_us, 'max': figures.max_us}


def _tracking_figures(run: runs.Run, began: int, finished: int) -> dict[str, float]:
    tracked = run_analysis.tracking(run, began, finished)
    return {'position_rmse_m': run_analysis.rms(tracked.position),
            'rotation_rmse_rad': run_analysis.rms(tracked.rotation),
            'position_max_m': float(tracked.position.max()),
            'rotation_max_rad': float(tracked.rotation.max()),
            'stiffness_rel_error': run_analysis.stiffness_error(run, tracked)}


def _limits(run: runs.Run, joints: JointLimits) -> dict[str, bool]:
    figures = run_analysis.limit_figures(run, joints)
    return {'torque_ok': figures.torque <= 1.0,
            'torque_rate_ok': figures.torque_rate <= 1e-3 * LimitSettings().torque_slew + 1e-9,
            'joint_ok': figures.joint_distance >= 0.0}


def _draw(folder: Path, run: runs.Run, timeline: Timeline, document: dict[str, Any]) -> None:
    lateness = {'trajectory_server': _window(folder, 'server', timeline)[:, 1] * 1e-3,
                document['arm']: _window(folder, 'sim', timeline)[:, 1] * 1e-3,
                'bare sleeping loop': _window(folder, 'bare', timeline)[:, 1] * 1e-3}
    pictures.draw(run, folder, document['goal_switch']['at_s'], timeline.finished, lateness)
    missing = render_to(folder / 'arm.png', run.joints[-1], run.poses[::100, :3])
    if missing:
        print(missing)


def _print_table(document: dict[str, Any]) -> None:
    s, t, g = document['stream'], document['tracking'], document['goal_switch']
    late, bare = s['lateness_us'], s['bare_lateness_us']
    limits = ', '.join(name for name, held in document['limits'].items() if not held)
    robot = document.get('robot')
    of_robot = [] if robot is None else [
        ['commands in time, mean / least share of 100', f'{robot["commands_in_time"]:.3f} / '
         f'{robot["least_in_100"]:.2f}', ''],
        ['CPU of a cycle, p50 / p99 [µs]', ' / '.join(
            f'{robot["cycle_cpu_us"][k]:.0f}' for k in ('p50', 'p99')), '']]
    table('measured', ['', 'value', 'bare loop'], [
        *of_robot,
        ['rate [Hz]', f'{s["rate_hz"]:.1f}', f'{s["bare_rate_hz"]:.1f}'],
        ['ticks missed', f'{s["missed"]} of {s["ticks"]}', s['bare_missed']],
        ['lateness p50 / p99 / max [µs]', ' / '.join(f'{late[k]:.0f}' for k in late),
         ' / '.join(f'{bare[k]:.0f}' for k in bare)],
        ['references lost', s['lost'], ''],
        ['CPU of the server, of a bare publisher [cores]', f'{s["cpu"]["server"]:.2f}',
         f'{s["cpu"]["bare"]:.2f}'],
        ['CPU of the simulation [cores]', f'{s["cpu"]["sim"]:.2f}', ''],
        ['tracking, position / rotation (RMS)',
         f'{t["position_rmse_m"] * 1e3:.1f} mm / {t["rotation_rmse_rad"]:.4f} rad', ''],
        ['goal switched by', f'{g["step_m"]:.2f} m, {g["step_rad"]:.2f} rad, '
                             f'stiffness {g["step_stiffness"]:.2f}', ''],
        ['distance from the new goal', f'{g["final_position_error_m"] * 1e3:.2f} mm, '
                                       f'{g["final_rotation_error_rad"]:.4f} rad, '
                                       f'stiffness {g["final_stiffness_distance"]:.4f}', ''],
        ['limits', f'exceeded: {limits}' if limits else 'all kept', '']])
