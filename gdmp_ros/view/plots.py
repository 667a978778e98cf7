"""Figures with matplotlib, the only place that imports it. Functions that draw take Axes."""
from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
import numpy as np

from gdmp_ros.view import style

matplotlib.rcParams.update({'figure.dpi': 110, 'font.size': 9, 'axes.grid': True,
                            'grid.alpha': 0.3, 'axes.spines.top': False,
                            'axes.spines.right': False, 'legend.frameon': False})
#: Lines are distinct in black and white too.
STYLES: tuple[Any, ...] = ('-', '--', ':', '-.', (0, (6, 1, 1, 1, 1, 1)), (0, (1, 3)))
INK = style.INK
#: Most ticks of an axis in space: in perspective the labels of more lie on each other.
SPATIAL_TICKS = 4
#: Letters of a legend that fit into one line above a panel.
LEGEND = 40


def blank_figure(width: float = 6.4, height: float = 4.0) -> Figure:
    """Make a figure without a window."""
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
    """Make a figure with a grid for Axes; ``size`` is that of the figure [inch]."""
    figure = Figure(figsize=size, layout='constrained')
    return figure, figure.add_gridspec(rows, columns)


def below(axes: Any, gap: float = 0.22) -> None:
    """Put the legend below the Axes, at a distance of ``gap`` heights."""
    axes.legend(fontsize=7, ncols=4, loc='upper center', bbox_to_anchor=(0.5, -gap))


def sphere(axes: Any) -> None:
    """Draw the unit sphere."""
    u, v = np.mgrid[0:2 * np.pi:37j, 0:np.pi:19j]
    axes.plot_wireframe(np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v), color='0.8',
                        lw=0.4)
    axes.set(xlabel='x [1]', ylabel='y [1]', zlabel='z [1]', xticks=(-1, 0, 1), yticks=(-1, 0, 1),
             zticks=(-1, 0, 1))
    axes.set_aspect('equal')


def ellipses(axes: Any, centres: np.ndarray, matrices: np.ndarray, scale: float,
             **options: Any) -> None:
    """
    Draw ellipses whose half-axes are the eigenvalues times ``scale``.

    :param centres: shape ``(count, 2)``
    :param matrices: shape ``(count, 2, 2)``
    :param options: of the lines; a label is given to the first
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
    """Write a figure; its folder is created if it does not exist."""
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, bbox_inches='tight')


def series(axes: Any, times: np.ndarray, values: np.ndarray, names: list[str], label: str) -> None:
    """Draw columns over time, with different colours and line styles."""
    for i, name in enumerate(names):
        # After six, the colours come again with other line styles.
        axes.plot(times, values[:, i], ls=STYLES[(i + i // 6) % 6], color=INK[i % 6], label=name,
                  lw=1.3)
    axes.set_xlabel('time [s]')
    axes.set_ylabel(label)
    # Above the panel, where it covers no curve.
    axes.legend(loc='lower left', bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2,
                ncols=min(6, len(names)) if sum(map(len, names)) < LEGEND else 2)


def bands(axes: Any, times: np.ndarray, limits: np.ndarray) -> None:
    """
    Draw bands in the colours of `series`.

    :param limits: lower and upper, shape ``(2, T, columns)``
    """
    for i in range(limits.shape[2]):
        axes.fill_between(times, limits[0, :, i], limits[1, :, i], color=INK[i % 6], alpha=0.15,
                          lw=0.0)


def path_with_ellipsoids(axes: Any, positions: np.ndarray, matrices: np.ndarray | None) -> None:
    """
    Draw a path in space with ellipsoids of its stiffness.

    :param positions: shape ``(T, 3)`` [m]
    :param matrices: shape ``(T, 3, 3)`` [N/m]
    """
    axes.plot(*positions.T, color=INK[0], lw=1.5, label='path')
    axes.scatter(*positions[0], marker='o', color='black', label='start')
    axes.scatter(*positions[-1], marker='*', s=60, color=INK[1], label='end')
    if matrices is not None:
        ellipsoids, largest = style.of_stiffness(positions, matrices)
        for centre, matrix in zip(*ellipsoids):
            _ellipsoid(axes, centre, matrix)
        axes.plot([], [], color=INK[2], label=f'stiffness (longest {largest:.0f} N/m)')
    axes.set(xlabel='x [m]', ylabel='y [m]', zlabel='z [m]')
    axes.set_aspect('equal')
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_major_locator(MaxNLocator(SPATIAL_TICKS))
        axis.labelpad = 8.0
    axes.legend(loc='lower left', bbox_to_anchor=(0.0, 1.0))


def _ellipsoid(axes: Any, centre: np.ndarray, shape: np.ndarray) -> None:
    u, v = np.mgrid[0:2 * np.pi:17j, 0:np.pi:9j]
    ball = np.stack([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)])
    surface = np.einsum('ij,juv->iuv', shape, ball) + centre[:, None, None]
    axes.plot_wireframe(*surface, color=INK[2], lw=0.35, alpha=0.6)
