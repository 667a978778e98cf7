"""
Noise on demonstrations: what it does to the motion, within it and for 2 s after.

From rest to rest, 0.37 m in 5 s with a bend; the like on S³ and SPD(3). Mean of three draws.
"""
from __future__ import annotations

from typing import Any

import numpy as np

from experiments import timing
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.rollout import Rollout
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.manifolds.euclidean import Euclidean
from gdmp_ros.manifolds.manifold import Manifold
from gdmp_ros.manifolds.quaternion import UnitQuaternion
from gdmp_ros.manifolds.spd import SymmetricPositiveDefinite
from gdmp_ros.util.profiles import minimum_jerk

TITLE = 'noise on demonstrations: errors in units of 1e-3 (mm on R³)'
RATES, LEVELS, DRAWS = (100.0, 1000.0), (0.0, 1e-5, 1e-4, 1e-3), 3
DURATION, AFTER = 5.0, 2.0
MANIFOLDS: tuple[Manifold, ...] = (Euclidean(3), UnitQuaternion(), SymmetricPositiveDefinite(3))


def _path(manifold: Manifold, times: np.ndarray) -> np.ndarray:
    """Points of the motion; it rests after its end."""
    blend = minimum_jerk(np.clip(times / DURATION, 0.0, 1.0))
    directions = np.zeros((2, manifold.tangent_size))
    directions[0, 0], directions[1, 1] = 0.35, 0.1
    base = manifold.random_point(np.random.default_rng(2))
    frame = manifold.frame(base)
    return np.array([manifold.exp(base, manifold.from_frame(
        frame, b * directions[0] + np.sin(np.pi * b) * directions[1])) for b in blend])


def _shown(manifold: Manifold, rate: float, level: float, rng: np.random.Generator
           ) -> Demonstration:
    times = np.linspace(0.0, DURATION, round(DURATION * rate) + 1)
    points = [manifold.exp(point, manifold.from_frame(
        manifold.frame(point), level * rng.standard_normal(manifold.tangent_size)))
              for point in _path(manifold, times)]
    return Demonstration(times, np.array(points), manifold)


def one_row(manifold: Manifold, rate: float, level: float) -> dict[str, Any]:
    """Largest errors within and after the motion, peak acceleration, start velocity."""
    times = np.arange(0.0, DURATION + AFTER, 2e-3)
    true = _path(manifold, times).reshape(len(times), -1)
    found = []
    for draw in range(DRAWS):
        skill = Skill.learn(_shown(manifold, rate, level, np.random.default_rng(draw)))
        rollout = Rollout(skill)
        states = [rollout.advance(0.0 if number == 0 else 2e-3) for number in range(len(times))]
        path = np.array([state.point.reshape(-1) for state in states])
        away = manifold.factor_distances(true, path).max(axis=1)
        peak = max(manifold.norm(state.point, state.acceleration) for state in states)
        begins = manifold.norm(states[0].point, states[0].velocity)
        within = times <= DURATION
        found.append([away[within].max(), away[~within].max(), peak, begins])
    mean = np.mean(found, axis=0)
    return {'manifold': repr(manifold), 'rate_hz': rate, 'noise': level,
            **{name: float(value) for name, value in zip(
                ('within', 'after', 'peak_acceleration', 'start_velocity'), mean)}}


def run(settings: timing.TimingSettings) -> dict[str, Any]:
    """Figures; the keys are those of the file."""
    return {'rows': [one_row(manifold, rate, level) for manifold in MANIFOLDS
                     for rate in RATES for level in LEVELS]}


def rows(document: dict[str, Any]) -> list[list[str]]:
    """Table: heading, then lines."""
    lines = []
    for one in document['rows']:
        clean = next(other for other in document['rows'] if other['noise'] == 0.0
                     and (other['manifold'], other['rate_hz']) == (one['manifold'],
                                                                   one['rate_hz']))
        lines.append([one['manifold'], f'{one["rate_hz"]:.0f}', f'{1e3 * one["noise"]:g}',
                      f'{1e3 * one["within"]:.3f}', f'{1e3 * one["after"]:.3f}',
                      f'{one["peak_acceleration"] / clean["peak_acceleration"]:.2f} ×',
                      f'{1e3 * one["start_velocity"]:.2f}'])
    return [['manifold', 'rate [Hz]', 'noise', 'error within', 'error after',
             'peak acceleration / clean', 'start velocity'], *lines]
