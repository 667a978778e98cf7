"""What the demonstration reports: figures of stream, tracking, goal and robot."""
from __future__ import annotations

from dataclasses import dataclass
import os
from pathlib import Path
import platform
from typing import Any

import numpy as np

from gdmp_ros import __version__
from gdmp_ros.control.measurement import JointLimits
from gdmp_ros.control.settings import LimitSettings
from gdmp_ros.data import run_analysis, runs
from gdmp_ros.errors import GdmpError
from gdmp_ros.realtime.statistics import Punctuality, punctuality_of
from gdmp_ros.ros.arm_choice import ArmChoice
from gdmp_ros.ros.messages import CPU_TIME, IN_TIME, LOST
from gdmp_ros.util.terminal import table

PERIOD_NS = 1_000_000


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


def window(folder: Path, name: str, timeline: Timeline) -> np.ndarray:
    """Deadline and lateness of the ticks of a process in the time that is evaluated [ns]."""
    ticks = np.load(folder / f'{name}.npy')
    inside = (ticks[:, 0] >= timeline.window[0]) & (ticks[:, 0] <= timeline.window[1])
    # A loop that follows the clock of a robot has other deadlines: all of its ticks count.
    return np.asarray(ticks[inside] if inside.any() else ticks)


def report(folder: Path, run: runs.Run, timeline: Timeline, switch: Switch, arm: ArmChoice
           ) -> dict[str, Any]:
    """
    Content of ``report.json``.

    :raises GdmpError: if the arm has told nothing of itself
    """
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
    server, bare = (punctuality_of(window(folder, name, timeline), PERIOD_NS)
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


def print_table(document: dict[str, Any]) -> None:
    """Show what `report` found."""
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
