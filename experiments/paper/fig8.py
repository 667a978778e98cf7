"""A planar arm with five joints follows path and manipulability of an arm with three joints."""
from __future__ import annotations

from typing import Any

import numpy as np

from experiments.paper.experiment import Data, Settings, spd_distances, Verdict
from gdmp_ros.control.manipulability import manipulability, PositionGains, PositionTarget
from gdmp_ros.data import lasa
from gdmp_ros.dmp import Demonstration, Rollout, Skill
from gdmp_ros.dmp.evaluation import reproduction_error
from gdmp_ros.manifolds import Euclidean, Product, SymmetricPositiveDefinite
from gdmp_ros.view import plots

CLAIM = ('On R² × SPD(2), a “C” and its manipulability, shown by a planar arm with three joints, '
         'are reproduced; an arm with five joints follows both, the second in its null space.')
SOURCE = '[GDMP] Fig. 8, section 5.4, eqs. (35) to (38)'
SPACE = Product(Euclidean(2), SymmetricPositiveDefinite(2),
                names=('position', 'manipulability'))
#: Links of the two arms, their initial postures, height and centre of the letter [m].
TEACHER, PUPIL = [0.35] * 3, [0.4, 0.3, 0.2, 0.2, 0.2]
TEACHER_POSTURE, PUPIL_POSTURE = [-0.9, 1.3, 0.9], [-1.2, 1.4, 0.2, 1.6, -1.4]
HEIGHT, CENTRE = 0.3, np.array([0.55, 0.0])
STIFFNESS = 800.0 * np.eye(2)
ALPHA, NULL_DAMPING = 600.0, 4.0
SETTLE_S = 3.0
#: Torque rate of the motors, larger than that of a real robot [Nm/s].
TORQUE_SLEW = 20_000.0


def letter() -> Demonstration:
    """The handwritten “C” as a path of the tip [m]."""
    stroke = lasa.strokes('CShape')[0]
    low, high = stroke.positions.min(axis=0), stroke.positions.max(axis=0)
    path = (stroke.positions - 0.5 * (low + high)) * HEIGHT / (high - low)[1]
    return Demonstration(stroke.times - stroke.times[0], path + CENTRE, Euclidean(2))


def teach(path: Skill) -> tuple[np.ndarray, np.ndarray]:
    """Write with the arm of three joints; its times [s] and points on R² × SPD(2)."""
    from gdmp_ros.sim.closed_loop import PositionLoop
    from gdmp_ros.sim.planar import planar_arm
    arm = planar_arm(TEACHER)
    arm.reset(np.array(TEACHER_POSTURE))
    loop = PositionLoop(arm, PositionGains(STIFFNESS, 1.0, null_damping=0.5))
    rollout, still = path.rollout(), np.zeros(2)
    loop.settle(PositionTarget(path.start, still, still), SETTLE_S)
    points = []
    for _ in range(round(path.duration / arm.period)):
        state = rollout.advance(arm.period)
        seen = loop.tick(PositionTarget(state.point, state.velocity, state.acceleration))
        points.append(SPACE.join(seen.position, manipulability(seen.jacobian)))
    return arm.period * np.arange(len(points)), np.array(points)


def follow(skill: Skill, alpha: float) -> tuple[np.ndarray, np.ndarray]:
    """Follow with the arm of five joints; reference and measured points, every tick."""
    from gdmp_ros.sim.closed_loop import PositionLoop
    from gdmp_ros.sim.planar import planar_arm
    arm, rollout = planar_arm(PUPIL), Rollout(skill)
    arm.reset(np.array(PUPIL_POSTURE))
    loop = PositionLoop(arm, PositionGains(STIFFNESS, 1.0, alpha, NULL_DAMPING), TORQUE_SLEW)
    position, matrix = SPACE.split(skill.start)
    loop.settle(PositionTarget(position, np.zeros(2), np.zeros(2), matrix), SETTLE_S)
    wanted, measured = [], []
    for _ in range(round(1.1 * skill.duration / arm.period)):
        state = rollout.advance(arm.period)
        position, matrix = SPACE.split(state.point)
        seen = loop.tick(PositionTarget(position, state.velocity[:2], state.acceleration[:2],
                                        np.ascontiguousarray(matrix)))
        wanted.append(state.point.copy())
        measured.append(SPACE.join(seen.position, manipulability(seen.jacobian)))
    return np.array(wanted), np.array(measured)


def run(settings: Settings) -> Data:
    """Teach, learn, follow with and without the null-space term."""
    times, shown = teach(Skill.learn(letter(), fit='forcing', end='moving'))
    # Recorded at 250 Hz.
    demonstration = Demonstration(times[::4], shown[::4], SPACE)
    skill = Skill.learn(demonstration, fit='forcing', end='moving')
    wanted, measured = follow(skill, ALPHA)
    _, without = follow(skill, 0.0)
    return {'times': 1e-3 * np.arange(len(wanted)), 'shown_times': times[::4], 'shown': shown[::4],
            'wanted': wanted, 'measured': measured, 'without': without,
            'reproduction_error': np.array(reproduction_error(skill, demonstration)[0])}


def distances(wanted: np.ndarray, measured: np.ndarray) -> np.ndarray:
    """Geodesic distance of the manipulabilities, every 10 ms."""
    return spd_distances(*(points[::10, 2:].reshape(-1, 2, 2) for points in (wanted, measured)))


def verdict(data: Data) -> Verdict:
    """Errors of the path, and of the manipulability with and without the term."""
    away = np.linalg.norm(data['wanted'][:, :2] - data['measured'][:, :2], axis=1)
    near, far = (float(distances(data['wanted'], data[name]).mean())
                 for name in ('measured', 'without'))
    measured = {'reproduction_error_over_span': float(data['reproduction_error']),
                'tracking_position_rms_m': float(np.sqrt(np.mean(away ** 2))),
                'tracking_position_largest_m': float(away.max()),
                'manipulability_distance_mean': near,
                'manipulability_distance_without_null_space_term': far}
    holds = (measured['reproduction_error_over_span'] < 1e-3 and away.max() < 0.01
             and near < 0.3 * far)
    return Verdict(bool(holds), measured)


def draw(data: Data) -> dict[str, Any]:
    """Ellipses over the path and over time, the cone, and the distance."""
    figure, grid = plots.blank_grid(5, 2, (11.0, 8.0))
    kinds: Any = (('shown', 'demonstration (3 joints)', {'color': '0.6', 'lw': 3.0}),
                  ('wanted', 'G-DMP', {'color': plots.INK[2], 'lw': 1.4}),
                  ('measured', 'arm (5 joints)', {'color': 'black', 'lw': 0.9, 'ls': '--'}))
    path, time = figure.add_subplot(grid[:3, 0]), figure.add_subplot(grid[3:, 0])
    for name, label, style in kinds:
        points = data[name]
        seconds = data['shown_times'] if name == 'shown' else data['times']
        at = np.searchsorted(seconds, np.linspace(0.0, data['shown_times'][-1], 13))
        chosen = points[np.minimum(at, len(points) - 1)]
        matrices = chosen[:, 2:].reshape(-1, 2, 2)
        path.plot(*points[:, :2].T, **style)
        plots.ellipses(path, chosen[:, :2], matrices, 0.08, label=label, **style)
        centres = np.column_stack([np.linspace(0.0, data['shown_times'][-1], 13), np.zeros(13)])
        plots.ellipses(time, centres, matrices, 0.35, label=label, **style)
    path.set(xlabel='x [m]', ylabel='y [m]', aspect='equal', title='over the path (0.08 m per m²)')
    time.set(xlabel='time [s]', ylabel='Υ, 0.35 s per m² [s]', aspect='equal',
             title='over time')
    cone(figure.add_subplot(grid[:3, 1], projection='3d'), data, kinds)
    panel = figure.add_subplot(grid[3:, 1])
    for name, label, line in (('measured', 'with the null-space term', '-'),
                              ('without', 'without', '--')):
        panel.plot(data['times'][::10], distances(data['wanted'], data[name]), line,
                   color='black', label=label)
    panel.set(xlabel='time [s]', ylabel='manipulability distance [1]')
    panel.set_ylim(bottom=0.0)
    panel.legend(fontsize=7)
    path.legend(fontsize=7, loc='center right')
    plots.below(time, 0.5)
    return {'fig8': figure}


def cone(axes: Any, data: Data, kinds: Any) -> None:
    """Draw the curves in the cone of positive definite matrices."""
    largest = max(float(data['shown'][:, [2, 5]].max()), 0.1) * 1.2
    a, angle = np.mgrid[0:largest / 2:7j, 0:2 * np.pi:37j]
    # [[a + b, c], [c, a - b]] is on the boundary where b² + c² = a².
    axes.plot_wireframe(a * (1 + np.cos(angle)), a * (1 - np.cos(angle)), a * np.sin(angle),
                        color='0.75', lw=0.4, label='boundary')
    for name, label, style in kinds:
        points = data[name]
        axes.plot(points[:, 2], points[:, 5], points[:, 3], label=label, **style)
    axes.set(xlabel='Υ11 [m²]', ylabel='Υ22 [m²]', zlabel='Υ12 [m²]', title='in the cone',
             xlim=(0, largest), ylim=(0, largest), zlim=(-largest / 2, largest / 2))
    axes.legend(fontsize=7)
