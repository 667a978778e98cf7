"""Pictures of the demonstration."""
from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from matplotlib.figure import Figure
import numpy as np

from gdmp_ros.data.run_analysis import tracking
from gdmp_ros.data.runs import Run
from gdmp_ros.view import plots


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
