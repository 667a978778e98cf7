"""Two arms carry a tray with a ball, and the goal of one of them is switched; without ROS."""
from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from gdmp_ros.dmp.coupling import Coupling
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import DataError, ParameterError
from gdmp_ros.manifolds import Euclidean, Product, UnitQuaternion
from gdmp_ros.manifolds.quaternion import rotate_by_vector
from gdmp_ros.playback.player import Player
from gdmp_ros.sim.two_arms import (
    ball_is_on_tray,
    hold_tray,
    pose_on_stand,
    SIDES,
    tilt,
    tool_poses,
)
from gdmp_ros.util.files import write_json, write_text
from gdmp_ros.util.profiles import smoothstep
from gdmp_ros.util.terminal import progress, table
from gdmp_ros.view import plots
from gdmp_ros.view.films import render_to

#: Duration of what is shown [s], its samples, and the noise of each arm's recording [m, rad].
SHOWN_S, SAMPLES, NOISE = 4.0, 401, (5e-4, 1e-3)
#: Way of the tray [m]: forward, aside and back, up; and its turn about the vertical [rad].
FORWARD, ASIDE, UP, TURN = 0.08, 0.06, 0.12, -0.2
#: The goal of the first arm is switched at this progress: by this [m], and this turn [rad].
SWITCH_AT, STEP, STEP_TURN = 0.5, np.array([0.02, 0.06, -0.09]), 0.25
#: Largest deviations of references and arms from the relation [m, rad].
REFERENCE_LIMITS, MEASURED_LIMITS = (1e-4, 5e-4), (1e-3, 5e-3)
#: Ticks between two pictures of the film.
PICTURE_EVERY = 40
_FACTORS = ('position', 'orientation')


def taught_skills(rng: np.random.Generator) -> list[Skill]:
    """A skill of each arm, learned from its own noisy recording of the same carrying."""
    rest, times = pose_on_stand(), np.linspace(0.0, SHOWN_S, SAMPLES)
    poses = []
    for time in times:
        u = smoothstep(time / SHOWN_S)
        tray = rest.copy()
        tray[:3] += [FORWARD * u, ASIDE * np.sin(np.pi * u), UP * np.sin(0.5 * np.pi * u)]
        rotate_by_vector(rest[3:], np.array([0.0, 0.0, TURN * u]), tray[3:])
        poses.append(tool_poses(tray))
    manifold = Product(Euclidean(3), UnitQuaternion(), names=_FACTORS)
    skills = []
    for side in range(len(SIDES)):
        points = np.array(poses)[:, 7 * side:7 * side + 7]
        points[:, :3] += NOISE[0] * rng.standard_normal((SAMPLES, 3))
        for point in points:
            rotate_by_vector(point[3:].copy(), NOISE[1] * rng.standard_normal(3), point[3:])
        skills.append(Skill.learn(Demonstration(times, points, manifold)))
    return skills


def coupling_of(skill: Skill, rest: np.ndarray) -> Coupling:
    """The tools keep the relation in which they hold the tray."""
    first, second = (tuple(f'{side}_{factor}' for factor in _FACTORS) for side in SIDES)
    return Coupling.at('pose', first, second, skill.manifold, tool_poses(rest))


def run_tray(folder: Path) -> int:
    """
    Carry the tray with coupled arms, and with arms that move each for itself.

    :returns: exit code: 0 if the coupled arms keep the relation and the ball stays on the tray
    :raises GdmpError: if the folder cannot be written
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ParameterError(f'{folder}: cannot be created: {error.strerror}') from None
    for path in (*folder.glob('*.png'), *folder.glob('*.webp'), folder / 'report.json'):
        path.unlink(missing_ok=True)
    print('learning one skill for each arm, from its own recording', flush=True)
    left, right = taught_skills(np.random.default_rng(1))
    joined = Skill.joined(left, right, SIDES)
    coupling = coupling_of(joined, pose_on_stand())
    coupled = joined.coupled(coupling)
    coupled.save(folder / 'skill.json')
    figures: dict[str, Any] = {'task': 'tray', 'goal_switched_by_m': float(np.linalg.norm(STEP))}
    courses = {}
    for name, skill in (('coupled', coupled), ('each for itself', joined)):
        key = name.replace(' ', '_')
        figures[key], courses[name] = carry(skill, coupling, folder, key)
    together = figures['coupled']
    figures['succeeded'] = bool(
        together['ball_on_tray'] and together['finished'] and _within(
            together['reference_deviation'], REFERENCE_LIMITS) and _within(
            together['measured_deviation'], MEASURED_LIMITS))
    write_json(folder / 'report.json', figures)
    _draw(folder / 'deviation.png', courses)
    _print(figures)
    print(f'report, pictures and films: {folder}')
    return 0 if figures['succeeded'] else 1


def carry(skill: Skill, coupling: Coupling, folder: Path | None = None, name: str = ''
          ) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """
    Execute a skill with the tray, and switch the goal of the first arm half way.

    :param coupling: against which references and arms are compared
    :param folder: for a film; None for none
    :returns: figures, and what is drawn over time
    """
    arms = hold_tray()
    goal = skill.goal[:7].copy()
    goal[:3] += STEP
    rotate_by_vector(goal[3:].copy(), np.array([0.0, 0.0, STEP_TURN]), goal[3:])
    switched = False

    def switch(done: float, player: Player) -> None:
        nonlocal switched
        if done >= SWITCH_AT and not switched:
            switched = True
            player.go_to(goal, side=0)
    rows, pictures = [], []
    with progress(f'carrying, {name.replace("_", " ")}', round(1.2 * SHOWN_S)) as done:
        for number, moment in enumerate(arms.execute(skill, switch)):
            rows.append([*(coupling.deviation(skill.manifold, points) for points in (
                moment.reference, moment.measured)), tilt(arms.world), ball_is_on_tray(arms.world),
                _squeeze(moment.measured, [tick.wrench for tick in moment.ticks])])
            if number % PICTURE_EVERY == 0:
                pictures.append(arms.world.data.qpos.copy())
                done(1e-3 * PICTURE_EVERY)
    reference, measured, tilts, on_tray, squeeze = (np.array(row) for row in zip(*rows))
    player = arms.player
    finished = player is not None and player.rollout is not None and player.rollout.finished
    if folder is not None:
        _film(folder, name, arms.world.xml, np.array(pictures))
    figures = {'reference_deviation': reference.max(axis=0).tolist(),
               'measured_deviation': measured.max(axis=0).tolist(),
               'tilt_rad': float(tilts.max()), 'ball_on_tray': bool(on_tray.all()),
               'squeeze_n': float(squeeze.max()), 'finished': bool(finished)}
    return figures, {'reference': reference, 'measured': measured, 'tilt': tilts}


def _squeeze(poses: np.ndarray, wrenches: list[np.ndarray]) -> float:
    """Force between the arms along the line from tool to tool [N]."""
    line = poses[7:10] - poses[:3]
    return float(abs((wrenches[1][:3] - wrenches[0][:3]) @ line) / (2.0 * np.linalg.norm(line)))


def _within(values: list[float], limits: tuple[float, float]) -> bool:
    return all(value <= limit for value, limit in zip(values, limits))


def _film(folder: Path, name: str, xml: str, positions: np.ndarray) -> None:
    print('drawing the film', flush=True)
    model = folder / 'world.xml'
    try:
        write_text(model, xml)
        missing = render_to(folder / f'{name}.webp', positions, np.empty((0, 3)), model,
                            1e-3 * PICTURE_EVERY, whole=True)
        missing = missing or render_to(folder / f'{name}.png', positions[-1], np.empty((0, 3)),
                                       model, whole=True)
    except OSError as error:
        raise DataError(f'{model}: cannot write: {error.strerror}') from None
    if missing:
        print(missing)


def _draw(path: Path, courses: dict[str, dict[str, np.ndarray]]) -> None:
    figure, grid = plots.panels(3, 1, (7.0, 2.2))
    rows = (('measured', 0, 1e3, 'position in the first tool [mm]'),
            ('measured', 1, 1.0, 'rotation [rad]'), ('tilt', None, 1.0, 'tilt of the tray [rad]'))
    for axes, (key, column, scale, label) in zip(grid[:, 0], rows):
        for i, (name, course) in enumerate(courses.items()):
            values = course[key] if column is None else course[key][:, column]
            axes.plot(1e-3 * np.arange(len(values)), scale * values, plots.STYLES[i],
                      color=plots.INK[i], label=name)
        axes.set(yscale='log', ylabel=label)
    grid[0, 0].set_title('deviation of the arms from the relation of their tools')
    grid[-1, 0].set_xlabel('time [s]')
    grid[0, 0].legend()
    plots.save(figure, path)


def _print(figures: dict[str, Any]) -> None:
    table('two arms carry a tray; the goal of the left one is switched on the way',
          ['', 'references [mm, rad]', 'arms [mm, rad]', 'tilt [rad]', 'between the arms [N]',
           'ball'],
          [[name, *(f'{1e3 * figures[key][what][0]:.3g}, {figures[key][what][1]:.2g}'
                    for what in ('reference_deviation', 'measured_deviation')),
            f'{figures[key]["tilt_rad"]:.3f}', f'{figures[key]["squeeze_n"]:.0f}',
            'on the tray' if figures[key]['ball_on_tray'] else 'fell']
           for name, key in (('coupled', 'coupled'), ('each for itself', 'each_for_itself'))])
