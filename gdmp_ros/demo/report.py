"""What the demonstration reports: figures of stream, tracking, goal and robot, and pictures."""
from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
import os
from pathlib import Path
import platform
from typing import Any

from matplotlib.figure import Figure
import numpy as np

from gdmp_ros import __version__
from gdmp_ros.control.settings import LimitSettings
from gdmp_ros.data import runs
from gdmp_ros.data.runs import Run, tracking
from gdmp_ros.errors import GdmpError
from gdmp_ros.realtime.statistics import Punctuality, punctuality_of, skipped
from gdmp_ros.ros.arm_choice import ArmChoice
from gdmp_ros.ros.messages import CPU_TIME, IN_TIME, LOST
from gdmp_ros.util.terminal import table
from gdmp_ros.view import plots

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
    goal = runs.goal_error(run, timeline.finished, switch.pose, switch.stiffness)
    return {
        'stream': _stream_figures(folder, run, timeline),
        'arm_ticks': _arm_ticks(folder, timeline, arm.tick_ns),
        'tracking': _tracking_figures(run, began, timeline.finished),
        'goal_switch': {'at_s': (timeline.switched - began) * 1e-9,
                        'finished_s': (timeline.finished - began) * 1e-9,
                        'final_position_error_m': goal.position,
                        'final_rotation_error_rad': goal.rotation,
                        'final_stiffness_distance': goal.stiffness, 'step_m': switch.step_m,
                        'step_rad': switch.step_rad, 'step_stiffness': switch.step_stiffness},
        'arm': arm.node, 'limits': _limits(run, arm), **_robot_figures(timeline, arm),
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


def _arm_ticks(folder: Path, timeline: Timeline, period_ns: int) -> dict[str, Any]:
    """Ticks of the arm, and deadlines without one, made up later or not."""
    ticks = window(folder, 'sim', timeline)
    figures = punctuality_of(ticks, period_ns)
    return {'count': figures.ticks, 'lost': figures.missed,
            'lost_in_a_row': int(skipped(ticks[:, 0], period_ns).max(initial=0)),
            'lost_share': figures.missed / max(figures.ticks + figures.missed, 1)}


def _robot_figures(timeline: Timeline, arm: ArmChoice) -> dict[str, Any]:
    """Cycles of a Franka during the motion: commands in time, states lost, CPU time."""
    if arm.kind != 'franka':
        return {}
    diagnoses = [item for item in timeline.diagnosed if IN_TIME in item]
    if not diagnoses:
        raise GdmpError('the arm has published no diagnostics')
    in_time = [float(state[IN_TIME]) for state in diagnoses]
    p50, p99 = (float(number) for number in diagnoses[-1][CPU_TIME].split(','))
    return {'robot': {
        'commands_in_time': float(np.mean(in_time)), 'least_in_100': min(in_time),
        'cycles_lost': int(diagnoses[-1][LOST]) - int(diagnoses[0][LOST]),
        'cycle_cpu_us': {'p50': p50, 'p99': p99}}}


def _micros(figures: Punctuality) -> dict[str, float]:
    return {'p50': figures.p50_us, 'p99': figures.p99_us, 'max': figures.max_us}


def _tracking_figures(run: runs.Run, began: int, finished: int) -> dict[str, float]:
    tracked = runs.tracking(run, began, finished)
    return {'position_rmse_m': runs.rms(tracked.position),
            'rotation_rmse_rad': runs.rms(tracked.rotation),
            'position_max_m': float(tracked.position.max()),
            'rotation_max_rad': float(tracked.rotation.max()),
            'stiffness_rel_error': runs.stiffness_error(run, tracked)}


def _limits(run: runs.Run, arm: ArmChoice) -> dict[str, bool]:
    figures = runs.limit_figures(run, arm.limits)
    kept = {'torque_ok': figures.torque <= 1.0, 'joint_ok': figures.joint_distance >= 0.0}
    if not arm.robots:  # of an arm that takes positions the torques are those of a virtual one
        kept['torque_rate_ok'] = bool(
            figures.torque_rate <= 1e-3 * LimitSettings().torque_slew + 1e-9)
    return kept


def print_table(document: dict[str, Any]) -> None:
    """Show what `report` found."""
    s, t, g = document['stream'], document['tracking'], document['goal_switch']
    late, bare = s['lateness_us'], s['bare_lateness_us']
    limits = ', '.join(name for name, held in document['limits'].items() if not held)
    robot, ticks = document.get('robot'), document['arm_ticks']
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
        ['ticks lost by the arm', f'{ticks["lost"]} of {ticks["count"]}', ''],
        ['CPU of the simulation [cores]', f'{s["cpu"]["sim"]:.2f}', ''],
        ['tracking, position / rotation (RMS)',
         f'{t["position_rmse_m"] * 1e3:.1f} mm / {t["rotation_rmse_rad"]:.4f} rad', ''],
        ['goal switched by', f'{g["step_m"]:.2f} m, {g["step_rad"]:.2f} rad, '
                             f'stiffness {g["step_stiffness"]:.2f}', ''],
        ['distance from the new goal', f'{g["final_position_error_m"] * 1e3:.2f} mm, '
                                       f'{g["final_rotation_error_rad"]:.4f} rad, '
                                       f'stiffness {g["final_stiffness_distance"]:.4f}', ''],
        ['limits', f'exceeded: {limits}' if limits else 'all kept', '']])


def draw(run: Run, folder: Path, switch_s: float, ends_ns: int,
         lateness: Mapping[str, np.ndarray]) -> None:
    """Write path, tracking, stiffness and lateness pictures."""
    plots.save(_path(run), folder / 'path.png')
    plots.save(_tracking(run, switch_s, ends_ns), folder / 'tracking.png')
    plots.save(_stiffness(run, switch_s), folder / 'stiffness.png')
    plots.save(_lateness(lateness), folder / 'lateness.png')


def _began(run: Run) -> int:
    """Stamp of the first reference that moves [ns]."""
    return int(run.reference_stamps[int(np.argmax(run.moving))])


def _seconds(run: Run, stamps: np.ndarray) -> np.ndarray:
    return np.asarray((stamps - _began(run)) * 1e-9)


def _path(run: Run) -> Figure:
    figure = Figure(figsize=(7, 6), layout='constrained')
    axes = figure.add_subplot(projection='3d')
    matrices = run.stiffness.reshape(-1, 6, 6)[:, :3, :3]
    plots.path_with_ellipsoids(axes, run.poses[::5, :3], matrices[::5])
    axes.plot(*run.references[::20, :3].T, '--', color=plots.INK[1], lw=1.0, label='reference')
    axes.legend(loc='upper left')
    return figure


def _tracking(run: Run, switch_s: float, ends_ns: int) -> Figure:
    tracked = tracking(run, _began(run), ends_ns)
    times = _seconds(run, run.state_stamps[tracked.states])
    figure = Figure(figsize=(8, 5), layout='constrained')
    rows = ((tracked.position * 1e3, 'position error [mm]'), (tracked.rotation, 'rotation [rad]'))
    for i, (values, label) in enumerate(rows):
        axes = figure.add_subplot(2, 1, i + 1)
        axes.plot(times, values, color=plots.INK[0], lw=1.2, label='arm − reference')
        _mark_switch(axes, switch_s)
        axes.set(xlabel='time since the motion began [s]', ylabel=label)
        axes.legend()
    return figure


def _stiffness(run: Run, switch_s: float) -> Figure:
    figure = Figure(figsize=(8, 3.2), layout='constrained')
    axes = figure.add_subplot()
    times = _seconds(run, run.state_stamps)
    values = np.linalg.eigvalsh(run.stiffness.reshape(-1, 6, 6)[::10, :3, :3])
    plots.series(axes, times[::10], values, ['smallest', 'middle', 'largest'],
                 'applied stiffness, eigenvalues [N/m]')
    _mark_switch(axes, switch_s)
    axes.set_xlabel('time since the motion began [s]')
    axes.legend()
    return figure


def _mark_switch(axes: object, switch_s: float) -> None:
    axes.axvline(switch_s, color='black', ls=':', lw=1.0,  # type: ignore[attr-defined]
                 label='goal switch')


def _lateness(lateness: Mapping[str, np.ndarray]) -> Figure:
    figure = Figure(figsize=(7, 3.6), layout='constrained')
    axes = figure.add_subplot()
    for i, (name, values) in enumerate(lateness.items()):
        ordered = np.sort(np.maximum(values, 1.0))
        share = 1.0 - np.arange(len(ordered)) / len(ordered)
        axes.plot(ordered, share, ls=plots.STYLES[i], color=plots.INK[i], lw=1.4, label=name)
    axes.set(xscale='log', yscale='log', xlabel='lateness of a tick [µs]',
             ylabel='share of ticks at least this late')
    axes.legend()
    return figure
