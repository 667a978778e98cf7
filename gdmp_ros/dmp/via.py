"""Via points: passing through given points at given times, by adjusting weights in closed form."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.signal import lfilter

from gdmp_ros.dmp.development import distances
from gdmp_ros.dmp.forcing import basis, design_matrix
from gdmp_ros.dmp.rollout import Rollout
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import ParameterError
from gdmp_ros.manifolds import operations as ops

#: Samples of the response to a weight over a duration.
_GRID = 2000
#: Corrections on a curved manifold at most; where the manifold is flat the first one is exact.
_ROUNDS = 20
#: A point is passed when every factor is this near.
_NEAR = 1e-7


def through(skill: Skill, points: Sequence[tuple[float, np.ndarray]],
            factors: Sequence[str] | None = None) -> Skill:
    """
    Give ``skill`` with weights that lead it through points, from its own start to its own goal.

    The motion answers linearly to its weights (a critically damped filter of the forcing term), so
    the smallest change, in the squared acceleration it adds, that moves the motion onto the points
    and leaves its end alone is the solution of one linear system. On a curved manifold the answer
    is linear only nearly, and the system is solved again for what is left.

    :param points: progress s and point of each, 0 < s < 1
    :param factors: names of the factors that have to pass; all by default
    :raises ManifoldError: if a point is not on the manifold
    :raises ParameterError: if s is out of range, a name unknown, or a point cannot be met
    """
    manifold = skill.manifold
    moments = np.array([s for s, _ in points], dtype=np.float64)
    if len(moments) == 0 or not ((moments > 0.0) & (moments < 1.0)).all() or (
            len(set(moments.tolist())) < len(moments)):
        raise ParameterError('via points: expected different progress between 0 and 1, got '
                             f'{moments.tolist()}')
    wanted = [manifold.check_point(point) for _, point in points]
    chosen, columns = _columns(skill, factors)
    # The end is a point to pass, too: where the motion ends now.
    moments = np.append(moments, 1.0)
    wanted.append(skill.reproduce(skill.duration).points[-1])
    response = _responses(skill, moments)
    for _ in range(_ROUNDS):
        missing, away = _missing(skill, moments, wanted)
        if away[:, chosen].max() <= _NEAR:
            return skill
        weights = np.array(skill.weights)
        weights[:, columns] += response @ missing[:, columns]
        skill = replace(skill, weights=weights)
    missing, away = _missing(skill, moments, wanted)
    if not away[:, chosen].max() <= 1e-3:
        at = int(np.argmax(away[:, chosen].max(axis=1)))
        raise ParameterError(f'via point at s = {moments[at]:g} stays {away[at].max():.3g} away: '
                             'it is too far from the motion, or too near another one in time')
    return skill


def _columns(skill: Skill, factors: Sequence[str] | None) -> tuple[list[int], np.ndarray]:
    """Numbers of the factors that have to pass, and of their coordinates."""
    names = list(skill.manifold.names)
    for name in factors or ():
        if name not in names:
            raise ParameterError(f'via points: no factor is called {name!r}, there are '
                                 f'{", ".join(names)}')
    chosen = [i for i, name in enumerate(names) if factors is None or name in factors]
    slices = skill.manifold.tangent_slices
    return chosen, np.r_[tuple(slices[i] for i in chosen)]


def _responses(skill: Skill, moments: np.ndarray) -> np.ndarray:
    """Change of the weights for a unit displacement at each moment, shape (weights, moments)."""
    count, rate = skill.n_basis, 0.5 * skill.gains.alpha_z
    grid = np.linspace(0.0, 1.0, _GRID + 1)
    forcing = np.empty((len(grid), count))
    design_matrix(basis(count, skill.gains.alpha_x), skill.gains.alpha_x, grid, forcing)
    # α_z = 4 β_z: both poles of the system lie at -α_z / 2.
    decay = np.exp(-rate / _GRID)
    once = lfilter([1.0 - decay], [1.0, -decay], forcing, axis=0)
    answer = lfilter([1.0 - decay], [1.0, -decay], once, axis=0)
    velocity = np.gradient(answer, grid, axis=0)
    acceleration = np.gradient(velocity, grid, axis=0)
    cost = acceleration.T @ acceleration / len(grid)
    cost[np.diag_indices(count)] += 1e-9 * np.trace(cost) / count
    at = [np.array([np.interp(s, grid, column) for column in answer.T]) for s in moments]
    rows = np.array([*at, velocity[-1] / rate])
    solved = np.linalg.solve(cost, rows.T)
    gain = np.linalg.lstsq(rows @ solved, np.eye(len(rows))[:, :len(moments)], rcond=1e-13)[0]
    return np.asarray(solved @ gain)


def _missing(skill: Skill, moments: np.ndarray,
             wanted: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """What is missing at each moment, in the coordinates of the weights, and by factor."""
    manifold, rollout = skill.manifold, Rollout(skill, duration=1.0)
    missing = np.empty((len(moments), manifold.tangent_size))
    points = np.empty((2, len(moments), manifold.point_size))
    elapsed = 0.0
    for i in np.argsort(moments):
        state = rollout.advance(moments[i] - elapsed)
        elapsed = moments[i]
        target = manifold.align(wanted[i], state.point)
        points[0, i], points[1, i] = state.point.reshape(-1), target.reshape(-1)
        if skill.connection == 'parallel':
            manifold._apply(ops.FRAME_LOG, rollout.frame_now(), manifold._flat(target),
                            missing[i])
        else:
            missing[i] = manifold.log(state.point, target)
    return missing, distances(manifold, points[0], points[1])
