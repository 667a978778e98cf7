"""Pictures; the only place that imports matplotlib. Functions that draw take Axes."""
from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.figure import Figure
import numpy as np

from gdmp_ros.dmp import Demonstration, Skill
from gdmp_ros.learning.tuning import BasisError, GoalSwitch
from gdmp_ros.manifolds import Manifold, Product

matplotlib.rcParams.update({'figure.dpi': 110, 'font.size': 9, 'axes.grid': True,
                            'grid.alpha': 0.3, 'axes.spines.top': False,
                            'axes.spines.right': False, 'legend.frameon': False})
#: Distinct in black and white too.
STYLES: tuple[Any, ...] = ('-', '--', ':', '-.', (0, (6, 1, 1, 1, 1, 1)), (0, (1, 3)))
INK = ('#1b4f8a', '#c1440e', '#2e7d32', '#6a3d9a', '#444444', '#b8860b')
#: Ellipsoids are drawn so that the stiffest axis of the picture has this length [m].
ELLIPSOID_M = 0.035


def blank_figure(width: float = 6.4, height: float = 4.0) -> Figure:
    """Make a figure that no window shows."""
    return Figure(figsize=(width, height))


def panels(rows: int = 1, columns: int = 1, size: tuple[float, float] = (6.4, 4.0),
           spatial: bool = False) -> tuple[Figure, Any]:
    """
    Make a figure with a grid of Axes, shape ``(rows, columns)``.

    :param size: of a panel [inch]
    :param spatial: Axes in space
    """
    figure = Figure(figsize=(size[0] * columns, size[1] * rows), layout='constrained')
    return figure, figure.subplots(rows, columns, squeeze=False,
                                   subplot_kw={'projection': '3d'} if spatial else {})


def blank_grid(rows: int, columns: int, size: tuple[float, float]) -> tuple[Figure, Any]:
    """Make a figure with a grid to cut Axes from; ``size`` is that of the whole [inch]."""
    figure = Figure(figsize=size, layout='constrained')
    return figure, figure.add_gridspec(rows, columns)


def below(axes: Any, gap: float = 0.22) -> None:
    """Put the legend under the picture, ``gap`` heights of it away, where it hides nothing."""
    axes.legend(fontsize=7, ncols=4, loc='upper center', bbox_to_anchor=(0.5, -gap))


def sphere(axes: Any) -> None:
    """Draw the unit sphere to look at from outside."""
    u, v = np.mgrid[0:2 * np.pi:37j, 0:np.pi:19j]
    axes.plot_wireframe(np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v), color='0.8',
                        lw=0.4)
    axes.set(xlabel='x [1]', ylabel='y [1]', zlabel='z [1]', xticks=(-1, 0, 1), yticks=(-1, 0, 1),
             zticks=(-1, 0, 1))
    axes.set_aspect('equal')


def ellipses(axes: Any, centres: np.ndarray, matrices: np.ndarray, scale: float,
             **options: Any) -> None:
    """
    Draw ellipses in the plane whose half axes are eigenvalues times ``scale``.

    :param centres: shape ``(count, 2)``
    :param matrices: shape ``(count, 2, 2)``
    :param options: of the lines; a label goes to the first
    """
    angle = np.linspace(0.0, 2.0 * np.pi, 61)
    circle = np.array([np.cos(angle), np.sin(angle)])
    label = options.pop('label', None)
    for i, (centre, matrix) in enumerate(zip(centres, matrices)):
        axes.plot(*(scale * matrix @ circle + centre[:, None]), **options,
                  label=label if i == 0 else None)


def boxes(axes: Any, groups: dict[str, Any], unit: str) -> None:
    """Draw a box plot of each group, by name."""
    axes.boxplot(list(groups.values()), tick_labels=list(groups), widths=0.5,
                 medianprops={'color': 'black'}, flierprops={'ms': 3})
    axes.plot([], [], color='black', label='median, quartiles, 1.5 × their range')
    axes.set_ylabel(unit)
    axes.legend()


def save(figure: Figure, path: str | Path) -> None:
    """Write a figure; its folder is made where it does not exist."""
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, bbox_inches='tight')


def series(axes: Any, times: np.ndarray, values: np.ndarray, names: list[str], label: str) -> None:
    """Draw columns over time, told apart by colour and by line style."""
    for i, name in enumerate(names):
        axes.plot(times, values[:, i], ls=STYLES[i % 6], color=INK[i % 6], label=name, lw=1.3)
    axes.set_xlabel('time [s]')
    axes.set_ylabel(label)
    axes.legend(loc='best', ncols=min(4, len(names)))


def path_with_ellipsoids(axes: Any, positions: np.ndarray, matrices: np.ndarray | None,
                         count: int = 12) -> None:
    """
    Draw a path in space with ellipsoids of its stiffness.

    :param positions: shape ``(T, 3)`` [m]
    :param matrices: shape ``(T, 3, 3)`` [N/m]
    """
    axes.plot(*positions.T, color=INK[0], lw=1.5, label='path')
    axes.scatter(*positions[0], marker='o', color='black', label='start')
    axes.scatter(*positions[-1], marker='*', s=60, color=INK[1], label='end')
    if matrices is not None:
        largest = float(np.linalg.eigvalsh(matrices).max())
        at = np.searchsorted(_arc_length(positions), np.linspace(0.0, 1.0, count))
        for i in np.minimum(at, len(positions) - 1):
            _ellipsoid(axes, positions[i], matrices[i] * ELLIPSOID_M / largest)
        axes.plot([], [], color=INK[2], label=f'stiffness (longest {largest:.0f} N/m)')
    axes.set(xlabel='x [m]', ylabel='y [m]', zlabel='z [m]')
    axes.set_aspect('equal')
    axes.legend(loc='upper left')


def _arc_length(positions: np.ndarray) -> np.ndarray:
    steps = np.linalg.norm(np.diff(positions, axis=0, prepend=positions[:1]), axis=1)
    total = np.cumsum(steps)
    return np.asarray(total / max(total[-1], 1e-12))


def _ellipsoid(axes: Any, centre: np.ndarray, shape: np.ndarray) -> None:
    u, v = np.mgrid[0:2 * np.pi:17j, 0:np.pi:9j]
    ball = np.stack([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)])
    surface = np.einsum('ij,juv->iuv', shape, ball) + centre[:, None, None]
    axes.plot_wireframe(*surface, color=INK[2], lw=0.35, alpha=0.6)


def takes_figure(shown: Sequence[Demonstration], names: Sequence[str],
                 differs: Sequence[bool]) -> Figure:
    """Draw takes of one motion from above, from the side and over time; odd ones dashed."""
    figure, axes = panels(1, 3, (4.2, 3.6))
    above, side, timed = axes[0]
    for i, (take, name, odd) in enumerate(zip(shown, names, differs)):
        style = {'color': INK[i % len(INK)], 'ls': '--' if odd else '-', 'lw': 1.3, 'label': name}
        x, y, z = take.points[:, :3].T
        above.plot(x, y, **style)
        side.plot(x, z, **style)
        timed.plot(take.times, np.linalg.norm(take.points[:, :3] - take.points[0, :3], axis=1),
                   **style)
    above.set(xlabel='x [m]', ylabel='y [m]', title='from above')
    side.set(xlabel='x [m]', ylabel='z [m]', title='from the side')
    timed.set(xlabel='time [s]', ylabel='distance from the start [m]', title='over time')
    for each in (above, side):
        each.set_aspect('equal', 'datalim')
    timed.legend(fontsize=7)
    return figure


def tuning_figure(errors: Sequence[BasisError], count: int, switches: Sequence[GoalSwitch],
                  gain: float) -> Figure:
    """Draw what was tried: errors by basis functions, goal switches by gain."""
    figure, axes = panels(1, 2, (4.6, 3.4))
    left, right = axes[0]
    counts = [one.functions for one in errors]
    left.loglog(counts[:-1], [one.detail for one in errors[:-1]], '^:', color=INK[2],
                label='from the finest')
    left.loglog(counts, [one.shown for one in errors], 'o-', color=INK[0],
                label='from what was shown')
    left.loglog(counts, [one.unseen for one in errors], 's--', color=INK[1],
                label='from one left out')
    left.axvline(count, color='0.5', lw=0.8, label=f'enough: {count}')
    left.set(xlabel='basis functions [1]', ylabel='mean distance / span [1]')
    left.legend()
    gains = [one.gain for one in switches]
    right.plot(gains, [one.acceleration for one in switches], 'o-', color=INK[0],
               label='adds acceleration [its own]')
    right.plot(gains, [one.reached for one in switches], 's--', color=INK[1],
               label='new goal reached after [durations]')
    right.axvline(gain, color='0.5', lw=0.8, label=f'calm: {gain:g}')
    right.set(xlabel='goal gain alpha_g [1]', ylim=(0.0, None))
    right.legend()
    return figure


def skill_figure(skill: Skill) -> Figure:
    """Draw a roll-out: every factor over time, and the path where there is one in space."""
    trajectory = skill.reproduce(skill.duration / 500)
    manifold = skill.manifold
    points: list[tuple[np.ndarray, ...]] = [
        manifold.split(p) if isinstance(manifold, Product) else (p,) for p in trajectory.points]
    count = len(manifold.factors)
    spatial = manifold.factors[0].kind == 'euclidean' and manifold.factors[0].m == 3
    figure = Figure(figsize=(11 if spatial else 7, 2.4 * count + 0.6), layout='constrained')
    grid = figure.add_gridspec(count, 2 if spatial else 1)
    for i, (name, factor) in enumerate(zip(manifold.names, manifold.factors)):
        values = np.array([p[i].reshape(-1) for p in points])
        names = _component_names(factor)
        keep = _independent(factor)
        series(figure.add_subplot(grid[i, 0]), trajectory.times, values[:, keep], names,
               f'{name}{_unit(name)}')
    if spatial:
        matrices = None
        if count > 2 and manifold.factors[2].kind == 'spd':
            matrices = np.array([p[2][:3, :3] for p in points])
        axes = figure.add_subplot(grid[:, 1], projection='3d')
        path_with_ellipsoids(axes, np.array([p[0] for p in points]), matrices)
    return figure


def _unit(name: str) -> str:
    return {'position': ' [m]', 'stiffness': ' [N/m, Nm/rad]'}.get(name, '')


def _independent(factor: Manifold) -> list[int]:
    """Numbers of a flat point that say something of their own."""
    if factor.kind == 'spd':
        return [i * factor.m + j for i in range(factor.m) for j in range(i, factor.m)]
    return list(range(factor.point_size))


def _component_names(factor: Manifold) -> list[str]:
    kind, m = factor.kind, factor.m
    if kind == 'quaternion':
        return ['w', 'x', 'y', 'z']
    if kind == 'spd':
        return [f'{i + 1}{j + 1}' for i in range(m) for j in range(i, m)]
    if kind == 'rotation':
        return [f'{i + 1}{j + 1}' for i in range(m) for j in range(m)]
    size = factor.point_size
    return list('xyz'[:size]) if size <= 3 else [str(i + 1) for i in range(size)]
