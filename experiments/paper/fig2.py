"""Trajectories on a sphere over both hemispheres, without and with the goal's antipode."""
from __future__ import annotations

from typing import Any

import numpy as np

from experiments.paper.experiment import Data, Settings, Verdict
from gdmp_ros.data import lasa
from gdmp_ros.dmp import Demonstration, Skill
from gdmp_ros.dmp.evaluation import reproduction_error
from gdmp_ros.manifolds import Sphere
from gdmp_ros.util.profiles import minimum_jerk
from gdmp_ros.view import plots

CLAIM = ('On S², an “N” over both hemispheres is reproduced. A “C” through the antipode of its '
         'goal turns back there; split into segments, it is followed through.')
SOURCE = '[GDMP] Fig. 2, Remark 1'
S2 = Sphere(2)
DURATION = 5.0
#: Length of the “C” [rad].
C_RAD = 1.25 * np.pi


def n_shape() -> Demonstration:
    """The handwritten “N” mapped across the equator, 1 rad to both sides."""
    stroke = lasa.strokes('NShape')[0]
    base, right, up = np.eye(3)
    plane = stroke.positions - 0.5 * (stroke.positions.max(axis=0) + stroke.positions.min(axis=0))
    plane /= np.abs(plane[:, 1]).max()
    return Demonstration(stroke.times, np.array([S2.exp(base, x * right + y * up)
                                                 for x, y in plane]), S2)


def c_shape() -> Demonstration:
    """A minimum-jerk motion on a great circle, through the antipode of its end."""
    t = np.linspace(0.0, 1.0, 1000)
    angle = C_RAD * minimum_jerk(t)
    return Demonstration(DURATION * t, np.column_stack([np.cos(angle), np.sin(angle),
                                                        0.0 * angle]), S2)


def _published(shown: Demonstration, n_basis: int) -> Skill:
    return Skill.learn(shown, n_basis, connection='published', split=False, fit='forcing',
                       end='moving')


def run(settings: Settings) -> Data:
    """Reproduce both motions; the “C” as published with 60 and 200 functions, and split."""
    n, c = n_shape(), c_shape()
    learned = {'n': _published(n, 60),
               'n_split': Skill.learn(n, fit='forcing', end='moving'),
               'c_published': _published(c, 60),
               'c_published_200': _published(c, 200),
               'c_split': Skill.learn(c, fit='forcing', end='moving')}
    data = {name: skill.reproduce(0.005).points for name, skill in learned.items()}
    return {**data, 'n_shown': n.points, 'c_shown': c.points,
            'errors': np.array([reproduction_error(learned['n'], n)[0],
                                reproduction_error(learned['n_split'], n)[0],
                                reproduction_error(learned['c_split'], c)[0]]),
            'nearest_to_antipode': np.array([_nearest(n), _nearest(c)]),
            'segments': np.array([len(learned[name].segments) for name in ('n_split', 'c_split')])}


def _nearest(shown: Demonstration) -> float:
    """Distance of a motion from the antipode of its goal [rad]."""
    return float(S2.distance(shown.points, -shown.points[-1]).min())


def travelled(points: np.ndarray) -> float:
    """Signed angle about z from the first to the last point [rad]."""
    return float(np.diff(np.unwrap(np.arctan2(points[:, 1], points[:, 0]))).sum())


def verdict(data: Data) -> Verdict:
    """Whether the “C” turns back without segments and goes through with them."""
    back, through = travelled(data['c_published']), travelled(data['c_split'])
    measured = {
        'n_mean_error_over_span_published': float(data['errors'][0]),
        'n_mean_error_over_span_parallel_split': float(data['errors'][1]),
        'n_nearest_to_antipode_rad': float(data['nearest_to_antipode'][0]),
        'c_angle_published_rad': back, 'c_angle_split_rad': through,
        'c_angle_published_200_functions_rad': travelled(data['c_published_200']),
        'c_shown_rad': C_RAD, 'c_split_mean_error_over_span': float(data['errors'][2]),
        'c_nearest_to_antipode_rad': float(data['nearest_to_antipode'][1]),
        'segments_of_n_and_c': data['segments'].tolist()}
    holds = (data['errors'][0] < 3e-4 and max(data['errors'][1:]) < 1e-4
             and min(data['nearest_to_antipode']) > 1e-3 and abs(through - C_RAD) < 0.01
             and abs(back - (C_RAD - 2.0 * np.pi)) < 0.01)
    return Verdict(bool(holds), measured, 'With 200 basis functions the “C” slips through the '
                   'antipode even without segments: the forcing term is then sharp enough.')


def draw(data: Data) -> dict[str, Any]:
    """Both spheres."""
    figure, axes = plots.panels(1, 3, (4.4, 4.6), spatial=True)
    for panel, shown, ours, title in zip(
            axes[0], ('n_shown', 'c_shown', 'c_shown'), ('n', 'c_published', 'c_split'),
            ('(a) no antipode', '(b) through the antipode, published', '(c) split into segments')):
        plots.sphere(panel)
        goal = data[shown][-1]
        panel.plot(*data[shown].T, '--', color='black', lw=2.2, label='demonstration')
        panel.plot(*data[ours].T, '-', color=plots.INK[1], lw=1.4, label='reproduction')
        panel.scatter(*data[shown][0], marker='o', color='black', label='start')
        panel.scatter(*goal, marker='*', s=90, color=plots.INK[0], label='goal G')
        if ours != 'n':
            panel.scatter(*-goal, marker='x', s=50, color='black', label='antipode −G')
        panel.set_title(title)
        panel.view_init(24, 38 if ours == 'n' else 55)
        panel.legend(loc='upper left', fontsize=7)
    return {'fig2': figure}
