"""Via points: weights changed in closed form so that a motion passes through given points."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
import warnings

import numpy as np

from gdmp_ros.dmp.primitive import P, Primitive
from gdmp_ros.dmp.response import responses
from gdmp_ros.dmp.rollout import Rollout
from gdmp_ros.errors import GdmpWarning, ParameterError
from gdmp_ros.util.numeric import numbers

#: Most corrections on a curved manifold; on a flat one the first is exact.
_MAX_ITERATIONS = 20
#: Via points that make the largest acceleration this many times larger are reported.
COSTLY = 2.0
#: Samples of a motion for its largest acceleration.
_SAMPLES = 400
#: A via point counts as passed when every factor is this near.
_TOLERANCE = 1e-7


def through(skill: P, points: Sequence[tuple[float, np.ndarray]],
            factors: Sequence[str] | None = None) -> P:
    """
    Return ``skill`` with weights that make it pass through points between its start and goal.

    The motion is linear in its weights (a critically damped filter of the forcing term). The
    change that passes through the points, keeps the end and adds the least squared acceleration is
    therefore the solution of one linear system. On a curved manifold the motion is only nearly
    linear, and the system is solved again for the remaining error. Via points of earlier calls
    are kept, but one at the same progress is replaced.

    :param points: progress s and point of each, 0 < s < 1
    :param factors: names of the factors that have to pass; all by default
    :raises ManifoldError: if a point is not on the manifold
    :raises ParameterError: if s is out of range, a name unknown, or a point cannot be met; for a
        rhythmic skill
    """
    skill.check_plain('via points')
    skill.check_ends('via points')
    manifold = skill.manifold
    moments = numbers('progress of via points', [s for s, _ in points])
    if moments.ndim != 1 or len(moments) == 0 or not ((moments > 0.0) & (moments < 1.0)).all() or (
            len(set(moments.tolist())) < len(moments)):
        raise ParameterError('via points: expected different progress between 0 and 1, got '
                             f'{moments.tolist()}')
    target = [manifold.check_point(point) for _, point in points]
    chosen, columns = _columns(skill, factors)
    # Earlier via points and the present end of the motion are via points too.
    kept = [s for s in skill.via if not np.isclose(s, moments, atol=1e-9).any()]
    via = tuple(sorted([*kept, *moments.tolist()]))
    present = Rollout(skill).sample(skill.duration * np.array([*kept, 1.0])).points
    moments = np.concatenate([moments, kept, [1.0]])
    target.extend(present)
    skill = replace(skill, via=via)
    response = _responses(skill, moments)
    for _ in range(_MAX_ITERATIONS):
        error, distances = _remaining(skill, moments, target)
        if distances[:, chosen].max() <= _TOLERANCE:
            break
        weights = np.array(skill.weights)
        weights[:, columns] += response @ error[:, columns]
        skill = replace(skill, weights=weights)
    error, distances = _remaining(skill, moments, target)
    if not distances[:, chosen].max() <= 1e-3:
        at = int(np.argmax(distances[:, chosen].max(axis=1)))
        raise ParameterError(f'via point at s = {moments[at]:g} stays {distances[at].max():.3g} '
                             'away: it is too far from the motion, or too close to another one in '
                             'time')
    return skill


def _largest_acceleration(skill: Primitive) -> float:
    """Largest norm of the acceleration, of all coordinates together."""
    rollout, step = Rollout(skill), skill.duration / _SAMPLES
    states = [rollout.advance(step) for _ in range(_SAMPLES)]
    return max(float(skill.manifold.norm(state.point, state.acceleration)) for state in states)


def warn_of_cost(before: Primitive, after: Primitive) -> None:
    """Report via points that make the largest acceleration much larger, with a `GdmpWarning`."""
    least, most = _largest_acceleration(before), _largest_acceleration(after)
    if most > COSTLY * least:
        warnings.warn(f'via points: the largest acceleration grows from {least:.3g} to '
                      f'{most:.3g}, {most / least:.1f} times; a point nearer to the motion, or '
                      'further in time from the others, costs less', GdmpWarning, stacklevel=3)


def _columns(skill: Primitive, factors: Sequence[str] | None) -> tuple[list[int], np.ndarray]:
    """Indices of the factors that have to pass, and of their coordinates."""
    names = list(skill.manifold.names)
    for name in factors or ():
        if name not in names:
            raise ParameterError(f'via points: no factor is called {name!r}, there are '
                                 f'{", ".join(names)}')
    chosen = [i for i, name in enumerate(names) if factors is None or name in factors]
    slices = skill.manifold.tangent_slices
    return chosen, np.r_[tuple(slices[i] for i in chosen)]


def _responses(skill: Primitive, moments: np.ndarray) -> np.ndarray:
    """Change of the weights for a unit displacement at each moment, shape (weights, moments)."""
    count, response = skill.n_basis, responses(skill.n_basis, skill.gains)
    during = response.progress <= 1.0
    motion = response.motion[during, 1:]
    velocity = np.gradient(motion, response.progress[1], axis=0)
    acceleration = np.gradient(velocity, response.progress[1], axis=0)
    cost = acceleration.T @ acceleration / len(motion)
    cost[np.diag_indices(count)] += 1e-9 * np.trace(cost) / count
    _, at = response.at(moments)
    # At the end velocity counts too; α_z = 4 β_z: both poles lie at -α_z / 2.
    rows = np.vstack([at[:, 1:], velocity[-1] / (0.5 * skill.gains.alpha_z)])
    solved = np.linalg.solve(cost, rows.T)
    gain = np.linalg.lstsq(rows @ solved, np.eye(len(rows))[:, :len(moments)], rcond=1e-13)[0]
    return np.asarray(solved @ gain)


def _remaining(skill: Primitive, moments: np.ndarray,
               desired: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Remaining error at each moment: in the coordinates of the weights, and by factor."""
    manifold, rollout = skill.manifold, Rollout(skill, duration=1.0)
    error = np.empty((len(moments), manifold.tangent_size))
    points = np.empty((2, len(moments), manifold.point_size))
    elapsed = 0.0
    for i in np.argsort(moments):
        state = rollout.advance(moments[i] - elapsed)
        elapsed = moments[i]
        target = manifold.align(desired[i], state.point)
        points[0, i], points[1, i] = state.point.reshape(-1), target.reshape(-1)
        if skill.connection == 'parallel':
            error[i], _ = manifold.log_in_frame(rollout.current_frame(), target)
        else:
            error[i] = manifold.log(state.point, target)
    return error, manifold.factor_distances(points[0], points[1])
