"""Interactive figures of a report; the only place that imports plotly."""
from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
import plotly.graph_objects as go
from plotly.offline import get_plotlyjs
from plotly.subplots import make_subplots

from gdmp_ros.data.recordings import Recording
from gdmp_ros.data.runs import Event, lateness, Limited, Run, Tracking
from gdmp_ros.view.style import (
    ELLIPSOIDS,
    Ellipsoids,
    evenly,
    INK,
    of_stiffness,
    of_takes,
    stiffness_of,
)

#: Poses of a skill and their covariances (`gdmp_ros.playback.prediction.likely_path`).
Likely: TypeAlias = tuple[np.ndarray, np.ndarray]
#: Largest number of points of a curve.
MAX_POINTS = 3000
#: Height of a panel [px].
PANEL_PX = 220
DASH = ('solid', 'dash', 'dot', 'dashdot', 'longdash', 'longdashdot')


def library() -> str:
    """Source of the drawing library, to be included in the page."""
    return str(get_plotlyjs())


def html(figure: go.Figure, name: str) -> str:
    """HTML of a figure."""
    return str(figure.to_html(full_html=False, include_plotlyjs=False, div_id=name,
                              config={'displaylogo': False, 'responsive': True}))


def _thin(count: int) -> np.ndarray:
    return np.unique(np.linspace(0, count - 1, min(count, MAX_POINTS)).round().astype(int))


def _path(positions: np.ndarray, name: str, ink: str, dash: str = 'solid') -> go.Scatter3d:
    x, y, z = positions[_thin(len(positions))].T
    return go.Scatter3d(x=x, y=y, z=z, mode='lines', name=name,
                        line={'color': ink, 'width': 4, 'dash': dash})


def _rings(ellipsoids: Ellipsoids, name: str, ink: str) -> go.Scatter3d:
    """Three rings of each ellipsoid."""
    angle = np.linspace(0.0, 2.0 * np.pi, 25)
    ring = np.column_stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)])
    unit = np.vstack([np.vstack([np.roll(ring, k, axis=1), np.full((1, 3), np.nan)])
                      for k in range(3)])
    x, y, z = np.vstack([position + unit @ matrix.T for position, matrix in zip(*ellipsoids)]).T
    return go.Scatter3d(x=x, y=y, z=z, mode='lines', name=name,
                        line={'color': ink, 'width': 1.5}, connectgaps=False)


def _stiffness(positions: np.ndarray, matrices: np.ndarray) -> go.Scatter3d:
    ellipsoids, largest = of_stiffness(positions, matrices)
    return _rings(ellipsoids, f'stiffness (longest {largest:.0f} N/m)', INK[2])


def _tube(poses: np.ndarray, covariances: np.ndarray) -> list[go.Scatter3d]:
    """Path of the skill, and ellipsoids in which 95 % of takes lie."""
    at = evenly(poses[:, :3], ELLIPSOIDS)
    return [_path(poses[:, :3], 'skill', INK[3], 'dot'),
            _rings(of_takes(poses[at, :3], covariances[at, :3, :3]), '95 % of takes', INK[3])]


def _point(position: np.ndarray, name: str, symbol: str) -> go.Scatter3d:
    return go.Scatter3d(x=position[:1], y=position[1:2], z=position[2:3], mode='markers',
                        name=name, marker={'size': 5, 'color': '#111', 'symbol': symbol})


def _space(traces: Sequence[Any]) -> go.Figure:
    figure = go.Figure(list(traces))
    # Orthographic and from afar: the whole box is in the picture, whatever its shape.
    figure.update_layout(scene={'xaxis_title': 'x [m]', 'yaxis_title': 'y [m]',
                                'zaxis_title': 'z [m]', 'aspectmode': 'data',
                                'camera': {'projection': {'type': 'orthographic'},
                                           'eye': {'x': 1.5, 'y': 1.5, 'z': 1.0}}},
                         height=620, margin={'l': 0, 'r': 0, 't': 20, 'b': 0},
                         legend={'orientation': 'h', 'y': 1.0, 'yanchor': 'bottom'})
    return figure


def _over_time(rows: Sequence[tuple[str, Sequence[tuple[str, np.ndarray, np.ndarray]]]],
               marks: Sequence[Event] = (), active: Sequence[Limited] = ()) -> go.Figure:
    """
    Panels with a common time axis.

    :param marks: vertical lines with the numbers of the events, from 1 on
    :param active: limits, in a panel of their own
    """
    count = len(rows) + bool(active)
    figure = make_subplots(rows=count, cols=1, shared_xaxes=True,
                           vertical_spacing=70 / (PANEL_PX * count))
    for number, (label, curves) in enumerate(rows, 1):
        for k, (name, times, values) in enumerate(curves):
            # The only curve of a panel is named by the axis.
            alone = len(curves) == 1
            kept = _thin(len(times))
            figure.add_trace(go.Scatter(
                x=times[kept], y=values[kept], name=name, mode='lines', showlegend=not alone,
                line={'color': INK[k % 6], 'dash': DASH[k % 6], 'width': 1.5}), number, 1)
        figure.update_yaxes(title_text=label, row=number, col=1)
    for item in active:
        figure.add_trace(_bars(item), count, 1)
    if active:
        figure.update_yaxes(title_text='limits', automargin=True, row=count, col=1)
    for number, mark in enumerate(marks, 1):
        figure.add_vline(x=mark.time, line={'color': '#999', 'width': 1, 'dash': 'dot'})
        figure.add_annotation(x=mark.time, y=1.0, yref='paper', yanchor='bottom', xref='x',
                              text=str(number), showarrow=False)
    figure.update_xaxes(title_text='time [s]', showticklabels=True)
    figure.update_layout(height=110 + PANEL_PX * count, plot_bgcolor='#fafafa',
                         margin={'l': 70, 'r': 20, 't': 30, 'b': 80},
                         legend={'orientation': 'h', 'y': -50 / (PANEL_PX * count)})
    return figure


def _bars(limited: Limited) -> go.Scatter:
    """The times at which a limit was active, as bars."""
    gaps = np.full_like(limited.begins, np.nan)
    times = np.column_stack([limited.begins, limited.ends, gaps]).reshape(-1)
    colour = INK[0] if limited.limit.smooths else INK[1]
    return go.Scatter(x=times, y=[limited.limit.name] * len(times), mode='lines',
                      name=limited.limit.name, showlegend=False,
                      line={'color': colour, 'width': 7})


def _eigenvalues(matrices: np.ndarray, times: np.ndarray, name: str
                 ) -> list[tuple[str, np.ndarray, np.ndarray]]:
    values = np.linalg.eigvalsh(matrices)
    return [(f'{name} {word}', times, values[:, k])
            for word, k in (('smallest', 0), ('largest', -1))]


def run_in_space(run: Run, likely: Likely | None = None) -> go.Figure:
    """Paths of reference and arm, with the stiffness of the reference, and likely takes."""
    kept = run.moving if run.moving.any() else slice(None)
    moving = run.references[kept]
    matrices = run.reference_stiffness[kept].reshape(-1, 6, 6)[:, :3, :3]
    return _space([_path(moving[:, :3], 'reference', INK[0], 'dash'),
                   _path(run.poses[:, :3], 'arm', INK[1]),
                   _stiffness(moving[:, :3], matrices),
                   *(_tube(*likely) if likely else []),
                   _point(moving[0, :3], 'start', 'circle'),
                   _point(moving[-1, :3], 'end', 'diamond')])


def run_over_time(run: Run, tracked: Tracking,
                  marks: Sequence[Event], active: Sequence[Limited]) -> go.Figure:
    """Errors, stiffness, speed, energy, lateness and active limits."""
    origin = run.state_stamps[0]
    times = (run.state_stamps - origin) * 1e-9
    sent = (run.reference_stamps - origin) * 1e-9
    states = times[tracked.states]
    kept, less = _thin(len(times)), _thin(len(sent))

    def blocks(rows: np.ndarray) -> np.ndarray:
        return np.asarray(rows.reshape(-1, 6, 6)[:, :3, :3])
    return _over_time([
        ('position error [mm]', [('position', states, 1e3 * tracked.position)]),
        ('rotation error [rad]', [('rotation', states, tracked.rotation)]),
        ('stiffness [N/m]', [
            *_eigenvalues(blocks(run.reference_stiffness[less]), sent[less], 'reference,'),
            *_eigenvalues(blocks(run.stiffness[kept]), times[kept], 'applied,')]),
        ('speed [m/s]', [('tool', times, np.linalg.norm(run.twists[:, :3], axis=1))]),
        ('energy tank [J]', [('tank', times, run.tank)]),
        ('lateness [µs]', [('reference', sent, 1e6 * lateness(run))])], marks, active)


def demonstration_in_space(recording: Recording, likely: Likely | None = None) -> go.Figure:
    """The demonstrated path, with its stiffness if it has one, and likely takes."""
    demo = recording.demonstration
    points = demo.points
    traces = [_path(points[:, :3], 'demonstration', INK[0]),
              _point(points[0, :3], 'start', 'circle'),
              _point(points[-1, :3], 'end', 'diamond')]
    matrices = stiffness_of(demo.manifold, points)
    if matrices is not None:
        traces.insert(1, _stiffness(points[:, :3], matrices))
    return _space(traces + (_tube(*likely) if likely else []))


def demonstration_over_time(recording: Recording, likely: Likely | None = None) -> go.Figure:
    """Position, orientation, speed and stiffness; limits of 95 % of takes."""
    demo = recording.demonstration
    times, points = demo.times, demo.points
    speed = np.linalg.norm(np.gradient(points[:, :3], times, axis=0), axis=1)
    rows = [('position [m]', [(name, times, points[:, k]) for k, name in enumerate('xyz')]),
            ('quaternion', [(name, times, points[:, 3 + k])
                            for k, name in enumerate(('qw', 'qx', 'qy', 'qz'))]),
            ('speed [m/s]', [('tool', times, speed)])]
    if likely is not None:
        poses, covariances = likely
        at = np.linspace(times[0], times[-1], len(poses))
        offset = 1.96 * np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
        rows[:1] = [(f'{name} [m]', [
            ('demonstration', times, points[:, k]),
            *((f'95 % of takes, {word}', at, poses[:, k] + sign * offset[:, k])
              for word, sign in (('least', -1.0), ('most', 1.0)))])
            for k, name in enumerate('xyz')]
    matrices = stiffness_of(demo.manifold, points)
    if matrices is not None:
        rows.append(('stiffness [N/m]', _eigenvalues(matrices, times, 'demonstrated,')))
    return _over_time(rows)
