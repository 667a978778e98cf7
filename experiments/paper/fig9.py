"""A spring with a rotating stiffness pulls a mass along a path; its goal is switched."""
from __future__ import annotations

from typing import Any

import numpy as np

from experiments.paper.experiment import Data, Settings, spd_distances, Verdict
from gdmp_ros.control.manipulability import PositionGains, PositionTarget
from gdmp_ros.data import lasa
from gdmp_ros.dmp import Demonstration, Rollout, Skill
from gdmp_ros.manifolds import Euclidean, Product, SymmetricPositiveDefinite
from gdmp_ros.util.profiles import minimum_jerk
from gdmp_ros.view import plots

CLAIM = ('On R² × SPD(2), a rotating stiffness profile pulls a mass along its path. After a '
         'switch of the stiffness goal the profile converges to it, and the spring force does '
         'not jump.')
SOURCE = '[GDMP] Fig. 9, section 5.5'
SPACE = Product(Euclidean(2), SymmetricPositiveDefinite(2), names=('position', 'stiffness'))
#: As printed [N/m]. The printed end (588.2443) is not this matrix rotated by 90°.
START = np.array([[622.9934, 39.9577], [39.9577, 79.5444]])
NEW_GOAL = np.diag([200.0, 200.0])
#: Mass [kg], size of the path [m], its duration and the end of the run [s], switch.
MASS, EXTENT, DURATION, END, SWITCH = 1.0, 0.4, 4.0, 7.0, 0.5
PERIOD = 1e-3


def shown() -> Demonstration:
    """The handwritten “S”; the stiffness ``Rᵀ K R`` rotates by minimum jerk."""
    stroke = lasa.strokes('Sshape')[0]
    path = stroke.positions * EXTENT / np.ptp(stroke.positions, axis=0).max()
    t = np.linspace(0.0, 1.0, len(path))
    points = []
    for position, angle in zip(path, 0.5 * np.pi * minimum_jerk(t)):
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        points.append(SPACE.join(position, turn.T @ START @ turn))
    return Demonstration(DURATION * t, np.array(points), SPACE)


def execute(skill: Skill, goal: np.ndarray | None) -> Data:
    """Pull the mass; reference, position of the mass, force of the spring [N]."""
    from gdmp_ros.sim.closed_loop import PositionLoop
    from gdmp_ros.sim.planar import point_mass
    arm, rollout = point_mass(MASS), Rollout(skill)
    position, _ = SPACE.split(skill.start)
    arm.reset(position)
    loop = PositionLoop(arm, PositionGains(START), torque_slew=np.inf)
    wanted, measured, force = [], [], []
    for tick in range(round(END / PERIOD)):
        if goal is not None and tick == round(SWITCH * DURATION / PERIOD):
            rollout.retarget(SPACE.join(SPACE.split(rollout.goal)[0], goal))
        state = rollout.advance(PERIOD)
        position, stiffness = SPACE.split(state.point)
        loop.gains = PositionGains(np.ascontiguousarray(stiffness), singularity=0.0,
                                   null_damping=0.0)
        # No feed-forward: the spring alone pulls the mass.
        seen = loop.tick(PositionTarget(position, state.velocity[:2], np.zeros(2)))
        wanted.append(state.point.copy())
        measured.append(seen.position)
        force.append(stiffness @ (position - seen.position))
    return {'wanted': np.array(wanted), 'measured': np.array(measured), 'force': np.array(force)}


def run(settings: Settings) -> Data:
    """Pull the mass without and with the switch."""
    demonstration = shown()
    skill = Skill.learn(demonstration, fit='forcing', end='moving')
    data: Data = {'shown_times': demonstration.times, 'shown': np.array(demonstration.points),
                  'times': PERIOD * np.arange(round(END / PERIOD))}
    for name, goal in (('straight', None), ('switched', NEW_GOAL)):
        data.update({f'{name}_{key}': value for key, value in execute(skill, goal).items()})
    return data


def goal_distances(points: np.ndarray, goal: np.ndarray) -> np.ndarray:
    """Geodesic distance of the stiffness from a goal."""
    matrices = points[:, 2:].reshape(-1, 2, 2)
    return spd_distances(matrices, np.broadcast_to(goal, matrices.shape))


def verdict(data: Data) -> Verdict:
    """Both goals reached, inside the cone, without a jump of the force."""
    goal = data['shown'][-1, 2:].reshape(2, 2)
    to_goal = float(goal_distances(data['straight_wanted'][-1:], goal)[0])
    to_new = float(goal_distances(data['switched_wanted'][-1:], NEW_GOAL)[0])
    smallest = min(np.linalg.eigvalsh(data[f'{name}_wanted'][:, 2:].reshape(-1, 2, 2)).min()
                   for name in ('straight', 'switched'))
    away = np.linalg.norm(data['switched_wanted'][:, :2] - data['switched_measured'], axis=1)
    jump = np.linalg.norm(np.diff(data['switched_force'], axis=0), axis=1)
    largest = np.linalg.norm(data['switched_force'], axis=1).max()
    measured = {'stiffness_distance_to_goal': to_goal, 'stiffness_distance_to_new_goal': to_new,
                'smallest_eigenvalue_N/m': float(smallest),
                'spring_force_largest_N': float(largest),
                'spring_force_largest_change_in_1_ms_N': float(jump.max()),
                'mass_from_reference_largest_m': float(away.max()),
                'mass_at_the_end_m': float(away[-1])}
    holds = (to_goal < 0.0025 and to_new < 0.0025 and smallest > 0.0 and away[-1] < 5e-4
             and away.max() < 0.02
             and jump.max() < 0.05 * largest)
    return Verdict(bool(holds), measured)


#: Length of an ellipse's half axis per N/m: over the path [m], over time [s].
_OVER_PATH, _OVER_TIME = 5e-5, 6e-4


def draw(data: Data) -> dict[str, Any]:
    """Ellipses over the path and over time, and the spring force."""
    figure, grid = plots.blank_grid(5, 2, (11.0, 8.0))
    path, forces, time = (figure.add_subplot(cell) for cell in (grid[:3, 0], grid[:3, 1],
                                                                grid[3:, :]))
    _profiles(path, time, data)
    _switch(path, time, data)
    path.plot(*data['shown'][:, :2].T, color='black', lw=1.0, label='path')
    path.plot(*data['switched_measured'].T, ':', color='black', lw=1.0, label='mass')
    path.set(xlabel='x [m]', ylabel='y [m]', aspect='equal', title='0.05 m per 1000 N/m')
    time.set(xlabel='time [s]', ylabel='K, 0.6 s per 1000 N/m [s]', aspect='equal',
             title='over time')
    plots.series(forces, data['times'], np.column_stack(
        [data['switched_force'], data['straight_force']]),
                 ['x', 'y', 'x, not switched', 'y, not switched'], 'spring force [N]')
    path.legend(fontsize=7, loc='upper center', bbox_to_anchor=(0.5, 0.75))
    plots.below(time)
    return {'fig9': figure}


def _profiles(path: Any, time: Any, data: Data) -> None:
    """Twelve ellipses of the demonstration and of the switched reproduction."""
    end = data['shown_times'][-1]
    for name, label, style in (
            ('shown', 'demonstration', {'color': '0.6', 'lw': 2.6}),
            ('switched_wanted', 'G-DMP, goal switched', {'color': plots.INK[2], 'lw': 1.3})):
        seconds = data['shown_times'] if name == 'shown' else data['times']
        at = np.minimum(np.searchsorted(seconds, np.linspace(0.0, end, 12)), len(seconds) - 1)
        chosen = data[name][at]
        matrices = chosen[:, 2:].reshape(-1, 2, 2)
        plots.ellipses(path, chosen[:, :2], matrices, _OVER_PATH, label=label, **style)
        plots.ellipses(time, np.column_stack([seconds[at], 0.0 * at]), matrices, _OVER_TIME,
                       label=label, **style)


def _switch(path: Any, time: Any, data: Data) -> None:
    """The ellipses at the switch and at the end."""
    moments = ((round(SWITCH * DURATION / PERIOD), SWITCH * DURATION, plots.INK[0], '--',
                'when the goal is switched'),
               (-1, data['shown_times'][-1], plots.INK[1], '-.', 'new goal'))
    for row, seconds, colour, line, label in moments:
        point = data['switched_wanted'][row]
        for panel, scale, centre in ((path, _OVER_PATH, point[:2]),
                                     (time, _OVER_TIME, np.array([seconds, 0.0]))):
            plots.ellipses(panel, centre[None], point[2:].reshape(1, 2, 2), scale, color=colour,
                           ls=line, lw=2.0, label=label)
