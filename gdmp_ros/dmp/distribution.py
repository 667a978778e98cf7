"""
Distribution of the motions that several takes show, around the skill learned from them.

The skill generalises to other starts and goals itself. What varies beyond that is Gaussian in the
weights, and correlated with start and goal. Along the motion all of it is linear in a flat space;
where the space is curved, conditioning is repeated for the remaining error.
"""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
import math
from typing import TYPE_CHECKING
import warnings

import numpy as np

from gdmp_ros.dmp.changes import frame_changes, shifted
from gdmp_ros.dmp.options import SHORTEST_DURATION
from gdmp_ros.dmp.primitive import carry_frame, change_of_frame, frame_of, Primitive
from gdmp_ros.dmp.response import responses
from gdmp_ros.dmp.rollout import Rollout
from gdmp_ros.dmp.variation import Context, Variation
from gdmp_ros.errors import GdmpWarning, ParameterError
from gdmp_ros.manifolds import Manifold
from gdmp_ros.util.numeric import numbers

if TYPE_CHECKING:
    from gdmp_ros.dmp.skill import Skill

#: Repetitions of conditioning on a curved space; on a flat one the first is exact.
REPETITIONS = 100
#: A point counts as met when it is this near; one that stays further away cannot be met.
MET, CANNOT = 1e-10, 1e-6
#: Ends further from those of the takes than this many standard deviations are outside of them.
FARTHEST = 4.0
#: Shares of a step that are tried, until one is an improvement.
SHARES = tuple(0.5 ** k for k in range(8))
#: A hard condition is met up to this part of the prior's variance: it keeps the system regular.
_REGULAR = 1e-14


class Distribution:
    """
    Mean, covariance, samples and conditions; see `gdmp_ros.dmp.Skill.distribution`.

    The progress s is from 0 to 1 everywhere.
    """

    def __init__(self, skill: Skill, variation: Variation):
        self._skill, self._variation = skill, variation
        self._manifold: Manifold = skill.manifold

    def mean(self, s: float) -> np.ndarray:
        """
        Point of the skill itself, shape ``point_shape``.

        :raises ParameterError: unless s is from 0 to 1
        """
        return _point(self._skill, _checked(s))[0]

    def covariance(self, s: float) -> np.ndarray:
        """
        Covariance of the points, in the canonical frame at the mean (`Manifold.frame`).

        In squares of the units of the factors: m², and half-angles [rad²] of unit quaternions. The
        noise of a sample is part of it.

        For few takes it is shrunk towards equal variances in all directions of a factor, so that
        its tubes hold for takes that were not seen.

        :returns: shape ``(n, n)``
        :raises ParameterError: unless s is from 0 to 1
        """
        point, frame = _point(self._skill, _checked(s))
        rows = self._rows(s) @ self._variation.whole_factor
        result = rows @ rows.T + np.diag(self._variation.noise)
        turn = change_of_frame(self._manifold, frame, self._manifold.frame(point))
        return np.asarray(turn @ result @ turn.T)

    def sample(self, rng: np.random.Generator) -> Skill:
        """
        Draw a skill: other start, goal, motion and duration, as another take might show.

        The noise of samples, which is part of `covariance`, is left out: a skill is smooth.
        """
        factor = self._variation.whole_factor
        drawn = shifted(self._skill, factor @ rng.standard_normal(factor.shape[1]))
        duration = drawn.duration * math.exp(self.timing * rng.standard_normal())
        return replace(drawn, duration=max(duration, SHORTEST_DURATION))

    @property
    def timing(self) -> float:
        """Standard deviation of the logarithm of the duration: timing is not space."""
        return self._variation.timing

    def condition(self, points: Sequence[tuple[float, np.ndarray]
                                         | tuple[float, np.ndarray, np.ndarray]] = (),
                  context: Context | None = None) -> Skill:
        """
        Return the most likely skill that passes through points; its distribution is what remains.

        At s = 0 the start and at s = 1 the goal is meant. A skill learned with contexts is the one
        for a context first, and then passes through the points. What remains has no context.

        :param points: progress and point of each; with a covariance in the canonical frame at the
            point, shape ``(n, n)``, the point is only likely, without one it is met
        :param context: as given to `Skill.learn`: a number for each name, or numbers of shape
            ``(m,)``; outside of what the takes show a `GdmpWarning` says so
        :raises ManifoldError: if a point is not on the manifold
        :raises ParameterError: if s is out of range or occurs twice, a covariance is none, the
            context has other names or another size, or a point cannot be met
        """
        if context is not None:
            known = self._in_context(context)
            around = known.distribution if len(points) else None
            return known if around is None else around.condition(points)
        target = self._wanted(points)
        factor = self._variation.whole_factor
        rows = np.vstack([self._rows(s, ends=True) for s, _, _ in target]) @ factor
        plain = replace(self._skill, variation=None)
        latent, moved = np.zeros(factor.shape[1]), plain
        offset, noise = self._remaining(moved, target)
        cost = _cost(rows, noise, offset, latent)
        for _ in range(REPETITIONS):
            # The gain refers to the mean: what has been shifted already counts as remaining.
            gain = _gain(rows, noise)
            step = gain @ (offset + rows @ latent) - latent
            for share in SHARES:
                tried = latent + share * step
                after = shifted(plain, factor @ tried)
                left_over, noise_then = self._remaining(after, target)
                cost_then = _cost(rows, noise_then, left_over, tried)
                if cost_then < cost:
                    break
            else:
                break
            latent, moved, offset, noise, cost = tried, after, left_over, noise_then, cost_then
            if np.abs(offset).max() <= MET:
                break
        self._check_met(target, offset)
        left = np.eye(factor.shape[1]) - gain @ rows
        values, vectors = np.linalg.eigh(0.5 * (left + left.T))
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        rest = replace(self._variation, factor=factor @ root, contexts=None)
        shift = factor @ latent
        if all(s in (0.0, 1.0) for s, _, _ in target):
            shift[2 * self._manifold.tangent_size:] *= self._believed(shift)
        return shifted(replace(self._skill, variation=rest), shift)

    def _believed(self, shift: np.ndarray) -> float:
        """
        How much of the change that other ends ask for is made, from 0 to 1.

        What the takes tell of ends far outside of theirs is a guess: the skill is moved there, and
        changes no more than for ends as far as theirs may be.
        """
        size = 2 * self._manifold.tangent_size
        ends = self._variation.whole_factor[:size]
        away = float(np.linalg.norm(np.linalg.lstsq(ends, shift[:size], rcond=1e-9)[0]))
        if away <= FARTHEST:
            return 1.0
        warnings.warn(f'start and goal are {away:.0f} standard deviations from those of the '
                      f'takes: the skill is moved there, with {FARTHEST / away:.0%} of the change '
                      'that the takes tell', GdmpWarning, stacklevel=4)
        return FARTHEST / away

    def _remaining(self, moved: Skill, desired: list[tuple[float, np.ndarray, np.ndarray]]
                   ) -> tuple[np.ndarray, np.ndarray]:
        """
        From the motion after a shift to the points; and their covariances, as one matrix.

        In the frames before the shift, which the variation refers to.
        """
        manifold, offset = self._manifold, []
        size = manifold.tangent_size
        noise = np.zeros((size * len(desired), size * len(desired)))
        at_start, at_goal = frame_changes(self._skill, moved)
        for number, (s, point, covariance) in enumerate(desired):
            if s in (0.0, 1.0):
                present = moved.start if s == 0.0 else moved.goal
                frame = frame_of(moved, present)
            else:
                present, frame = _point(moved, s)
            target = manifold.align(point, present)
            back = (at_goal if s == 1.0 else at_start).T
            offset.append(back @ manifold.log_in_frame(frame, target)[0])
            if covariance.any():
                carried = carry_frame(manifold, frame, target)[0]
                turn = back @ change_of_frame(manifold, manifold.frame(target), carried)
                part = slice(number * size, (number + 1) * size)
                noise[part, part] = turn @ covariance @ turn.T
        return np.concatenate(offset), noise

    def _check_met(self, desired: list[tuple[float, np.ndarray, np.ndarray]],
                   offset: np.ndarray) -> None:
        for (s, _, covariance), away in zip(desired, np.split(offset, len(desired))):
            distance = float(np.linalg.norm(away))
            if not covariance.any() and not distance <= CANNOT:
                raise ParameterError(f'condition at s = {s:g}: no motion of this distribution '
                                     f'was found that passes through the point; {distance:.2g} '
                                     'is left. Give a covariance, or take Skill.through')

    def _in_context(self, context: Context) -> Skill:
        """The skill for a context, with the variation of takes in it."""
        variation, model = self._variation, self._variation.contexts
        if model is None:
            raise ParameterError('context: the skill was learned without contexts')
        numbers = model.numbers(context)
        if why := model.outside(numbers):
            warnings.warn(f'context: {why}; the skill for it is a guess', GdmpWarning,
                          stacklevel=4)
        shift, longer = model.shift(numbers)
        rest = replace(variation, factor=model.growth(numbers) * variation.factor, contexts=None)
        moved = shifted(replace(self._skill, variation=rest), shift)
        return replace(moved, duration=max(longer * moved.duration, SHORTEST_DURATION))

    # Coordinates

    def _rows(self, s: float, ends: bool = False) -> np.ndarray:
        """Effect of start, goal and weights on the point at s, shape ``(n, (2 + n_basis) n)``."""
        size, count = self._manifold.tangent_size, self._skill.n_basis
        if ends and s in (0.0, 1.0):
            shares = np.zeros(2 + count)
            shares[int(s)] = 1.0
        else:
            goal, motion = responses(count, self._skill.gains).at(np.array([s]))
            shares = np.concatenate([1.0 - goal, goal, motion[0, 1:]])
        return np.kron(shares, np.eye(size))

    def _wanted(self, points: Sequence[tuple]) -> list[tuple[float, np.ndarray, np.ndarray]]:
        manifold, result = self._manifold, []
        size = manifold.tangent_size
        for number, condition in enumerate(points):
            if len(condition) not in (2, 3):
                raise ParameterError(f'condition {number}: expected (s, point) or '
                                     f'(s, point, covariance), got {len(condition)} parts')
            s, point = _checked(condition[0]), manifold.check_point(condition[1])
            noise = (np.zeros((size, size)) if len(condition) == 2
                     else numbers('covariance', condition[2]))
            if (noise.shape != (size, size) or not np.isfinite(noise).all()
                    or np.linalg.eigvalsh(noise).min() < -1e-12):
                raise ParameterError(f'condition {number}: the covariance is no positive '
                                     f'semidefinite matrix of shape {(size, size)}')
            result.append((s, point, noise))
        progress = [s for s, _, _ in result]
        if not result or len(set(progress)) < len(progress):
            raise ParameterError('conditions: expected at least one, each at another s, got '
                                 f'{progress}')
        return result


def _checked(s: float) -> float:
    if not (isinstance(s, (int, float, np.number)) and 0.0 <= s <= 1.0):
        raise ParameterError(f's is {s!r}, expected a number from 0 to 1')
    return float(s)


def _point(skill: Primitive, s: float) -> tuple[np.ndarray, np.ndarray]:
    """Point of the motion at s, and the frame transported along the motion."""
    rollout = Rollout(skill, duration=1.0)
    point = rollout.advance(s).point.copy()
    if skill.connection == 'parallel':
        return point, rollout.current_frame()
    return point, frame_of(skill, point)


def _cost(rows: np.ndarray, noise: np.ndarray, offset: np.ndarray, latent: np.ndarray) -> float:
    """Twice the negative logarithm of the probability; infinite if the motion is not finite."""
    matrix = noise + _REGULAR * np.trace(rows @ rows.T + noise) / len(noise) * np.eye(len(noise))
    if not np.isfinite(offset).all():
        return math.inf
    return float(offset @ np.linalg.lstsq(matrix, offset, rcond=None)[0] + latent @ latent)


def _gain(rows: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Gain of a Gaussian with identity covariance, observed through rows."""
    result = rows @ rows.T + noise
    result[np.diag_indices_from(result)] += _REGULAR * np.trace(result) / len(result)
    return np.asarray(np.linalg.lstsq(result, rows, rcond=1e-15)[0].T)
