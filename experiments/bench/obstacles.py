"""Obstacles: ways, the bend, potentials of Ginesi et al., and points of movement_primitives."""
from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from experiments import timing
from experiments.baselines.potentials import Potentials
from experiments.obstacles import random_scene
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.learning.detour import BlockedError, detour
from gdmp_ros.scene import Scene
from gdmp_ros.scene.route import clearances, Tool
from gdmp_ros.util.optional_imports import extra, optional_import
from gdmp_ros.util.parallel import Journal, map_tasks

TITLE = 'a ball of 40 mm past 1 to 8 volumes, one of which blocks its path (80 random scenes)'
#: Scenes, radius of the tool [m], and step of the peers [s].
SCENES, RADIUS, DT = 80, 0.04, 0.01
#: Gains of the potentials; the best of them is reported. The stiffness of the peer's primitive is
#: 156, that of the source's 1050, with a gain of 10.
GAINS = (0.1, 1.0, 10.0)
#: Twice the duration: a motion that is deflected comes late.
LONGER = 2.0


class Way(NamedTuple):
    """
    What one method did in one scene.

    :ivar reached: whether it ended within 10 mm of the goal
    :ivar least: least distance of the tool from a volume [m]; inf if it did not begin
    :ivar longer: length of its path, divided by that of the plain one
    :ivar acceleration: largest [m/s²]
    """

    reached: bool
    least: float
    longer: float
    acceleration: float


def _judged(skill: Skill, scene: Scene, points: np.ndarray, dt: float) -> Way:
    plain = skill.rollout().sample(np.linspace(0.0, skill.duration, 301)).points[:, :3]
    left, _ = clearances(scene.packed(), Tool.ball(RADIUS), points, np.array([1.0, 0, 0, 0]), 0.0)

    def length(path: np.ndarray) -> float:
        return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
    return Way(bool(np.linalg.norm(points[-1] - skill.goal[:3]) < 0.01), float(left.min()),
               length(points) / length(plain),
               float(np.linalg.norm(np.diff(points, 2, axis=0), axis=1).max() / dt ** 2))


def _led(skill: Skill, scene: Scene) -> Way:
    try:
        found = detour(skill, scene, Tool.ball(RADIUS)).skill
    except BlockedError:
        return Way(False, np.inf, np.nan, 0.0)
    return _judged(skill, scene, found.reproduce(DT).points[:, :3], DT)


def _bent(skill: Skill, scene: Scene) -> Way:
    rollout = skill.rollout()
    rollout.set_obstacles(scene, keep=RADIUS)
    times = np.arange(0.0, LONGER * skill.duration, DT)
    return _judged(skill, scene, rollout.sample(times).points[:, :3], DT)


def _of_peer(term: Callable[[Scene], Any]) -> Callable[[Skill, Scene], Way]:
    """A primitive of movement_primitives with a coupling term."""
    def way(skill: Skill, scene: Scene) -> Way:
        with optional_import(extra('bench')):
            from movement_primitives.dmp import DMP
        shown = skill.reproduce(DT)
        points = shown.points[:, :3].copy()
        dmp = DMP(3, execution_time=skill.duration, dt=DT, n_weights_per_dim=50)
        dmp.imitate(shown.times, points)
        dmp.configure(start_y=points[0], goal_y=points[-1])
        position, velocity, path, coupling = points[0].copy(), np.zeros(3), [], term(scene)
        for _ in range(round(LONGER * skill.duration / DT)):
            position, velocity = dmp.step(position, velocity, coupling_term=coupling)
            path.append(position.copy())
            if not np.abs(position).max() < 100.0:
                break
        return _judged(skill, scene, np.array(path), DT)
    return way


class _Points:
    """movement_primitives' term for points, one in the middle of each volume."""

    def __init__(self, scene: Scene):
        with optional_import(extra('bench')):
            from movement_primitives.dmp import CouplingTermObstacleAvoidance3D
        self._terms = [CouplingTermObstacleAvoidance3D(volume.pose[:3]) for volume in scene]

    def coupling(self, y: np.ndarray, yd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Sum of the terms."""
        return np.zeros(3), np.sum([term.coupling(y, yd)[1] for term in self._terms], axis=0)


def _methods() -> dict[str, Callable[[Skill, Scene], Way]]:
    result = {'a way is searched': _led, 'bend': _bent,
              'points (movement_primitives)': _of_peer(_Points)}
    for gain in GAINS:
        result[f'static potential, {gain:g}'] = _of_peer(partial(
            Potentials, around=RADIUS, gain=gain))
        for decay, power in ((0.5, 2.0), (1.0, 1.0)):
            result[f'dynamic potential, {gain:g}, eta {decay:g}, beta {power:g}'] = _of_peer(
                partial(Potentials, around=RADIUS, gain=gain, decay=decay, power=power))
    return result


def _try(number: int) -> dict[str, list[float]]:
    skill, scene = random_scene(np.random.default_rng([45, number]), Tool.ball(RADIUS))
    return {name: [float(value) for value in way(skill, scene)]
            for name, way in _methods().items()}


def run(settings: timing.TimingSettings) -> dict[str, Any]:
    """Try all methods in the same scenes."""
    tasks = {str(number): number for number in range(SCENES)}
    done = map_tasks('scenes', _try, tasks, settings.jobs, settings.dask,
                     Journal(settings.resume, 'bench obstacles'))
    result: dict[str, Any] = {}
    for name in _methods():
        ways = [Way(bool(row[0]), *row[1:]) for row in (done[key][name] for key in tasks)]
        good = [way for way in ways if way.reached and way.least > 0.0]
        result[name] = {
            'reached_without_contact': len(good) / len(ways),
            'contact': sum(way.least <= 0.0 for way in ways) / len(ways),
            'reached': sum(way.reached for way in ways) / len(ways),
            'longer': float(np.median([way.longer for way in good])) if good else np.nan,
            'acceleration': float(np.median([way.acceleration for way in good])) if good
            else np.nan}
    return {'scenes': SCENES, 'methods': result}


def rows(document: dict[str, Any]) -> list[list[str]]:
    """Table: heading, then lines; of each potential its best gains."""
    found = document['methods']
    best = {name: max((other for other in found if other.startswith(name)),
                      key=lambda other: found[other]['reached_without_contact'])
            for name in ('static potential', 'dynamic potential')}
    shown = [name for name in found if 'potential' not in name or name in best.values()]
    return [['method', 'reached without contact', 'contact', 'reached', 'length', 'm/s²'],
            *([name, *(f'{100.0 * found[name][key]:.0f} %' for key in (
                'reached_without_contact', 'contact', 'reached')),
               f'{found[name]["longer"]:.2f}', f'{found[name]["acceleration"]:.1f}']
              for name in shown)]
