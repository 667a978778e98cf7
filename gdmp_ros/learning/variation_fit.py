"""How takes vary around the skill learned from them, and with their contexts."""
from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from gdmp_ros.dmp.changes import shifted
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.development import Development
from gdmp_ros.dmp.primitive import change_of_frame, frame_of
from gdmp_ros.dmp.rollout import Rollout
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.dmp.variation import (
    ContextModel,
    correlations,
    kriging,
    linear_terms,
    Variation,
    varies,
)
from gdmp_ros.errors import DataError, ParameterError
from gdmp_ros.learning.regression import Smoother, smoother
from gdmp_ros.util.numeric import numbers_or_none

#: Contexts of the takes as users give them: numbers for each name, or one row for each take.
GivenContexts: TypeAlias = Mapping[str, Sequence[float]] | Sequence[Sequence[float]] | np.ndarray
#: Correlation lengths that are tried, as parts of the ranges of the numbers.
LENGTHS = (0.2, 5.0)
#: Noise that is tried, relative to the process. With the last nothing but the trend is left.
NOISES = (1e-6, 1e6)
#: Least part of what the takes show that counts.
ROUNDING = 1e-12
#: Where the search begins: length, noise.
STARTS = ((0.5, 1e-4), (1.5, 1e-4), (1.0, 1.0))
#: Samples of a take.
SAMPLES = 101
#: Shortest wavelength of what varies, and correlation length of what is not known, in durations.
WAVELENGTH, CORRELATION = 0.05, 0.1
#: Directions with a smaller part of the largest standard deviation, each factor in its own unit,
#: are left out.
NEGLIGIBLE = 1e-3
#: Share of takes that ellipsoids of the variation hold; confidence that ends tell of the rest.
SURE = 0.95
#: Most corrections for the curvature of the space, and when they have converged.
CORRECTIONS, CONVERGED = 5, 1e-3


@dataclass(frozen=True)
class Contexts:
    """
    Checked contexts of takes.

    :ivar names: of the numbers
    :ivar numbers: shape ``(takes, m)``
    """

    names: tuple[str, ...]
    numbers: np.ndarray

    @classmethod
    def of(cls, given: GivenContexts, count: int) -> Contexts:
        """
        Check what a user gave.

        :param count: of the takes
        :raises ParameterError: unless there are as many finite numbers for each take
        :raises DataError: if there are too few takes, or a number does not vary
        """
        names = tuple(map(str, given)) if isinstance(given, Mapping) else ()
        numbers = numbers_or_none([given[name] for name in given] if isinstance(given, Mapping)
                                  else given)
        if isinstance(given, Mapping):
            numbers = numbers.T
        if numbers.ndim != 2 or len(numbers) != count or not numbers.size or not np.isfinite(
                numbers).all():
            raise ParameterError(f'contexts have shape {numbers.shape}, expected ({count}, any) '
                                 'finite numbers, one row for each demonstration')
        size = numbers.shape[1]
        if count < size + 3:
            raise DataError(f'{count} takes, expected at least {size + 3} for contexts of {size} '
                            'numbers')
        if not varies(numbers):
            raise DataError('contexts: a number does not vary between the takes, or follows '
                            'from the others')
        return cls(names or tuple(f'c{i + 1}' for i in range(size)), numbers)


class ContextFit:
    """
    Universal kriging of what takes show, with lengths and noise of the largest likelihood.

    :ivar left: what is left of each take if the others explain it, shape ``(takes, any)``
    """

    def __init__(self, contexts: Contexts, demo: np.ndarray, scales: np.ndarray,
                 take_weights: np.ndarray):
        """
        :param demo: numbers of each take, shape ``(takes, any)``
        :param scales: that make these numbers comparable
        :param take_weights: 1 on average
        """
        self._contexts, self._shown, self._weights = contexts, demo, take_weights
        self._linear = linear_terms(contexts.numbers, contexts.numbers)
        self._range = np.ptp(contexts.numbers, axis=0)
        # Distances between the takes are all that the choice needs: a square matrix has them.
        left, values, _ = np.linalg.svd(demo * scales, full_matrices=False)
        self._compact = left * values
        self._lengths, self._noise = self._chosen()
        self._maps = kriging(self._covariance(self._lengths, self._noise), self._linear)
        self.left = (self._maps.bend @ demo) / np.diag(self._maps.bend)[:, None]

    def model(self, rows: Callable[[np.ndarray], np.ndarray], lengths: np.ndarray
              ) -> tuple[ContextModel, np.ndarray]:
        """
        The model of the takes, and what it leaves of the logarithms of their durations.

        :param rows: coordinates of a primitive, of numbers that a take shows, both row by row
        :param lengths: logarithms of the takes' durations, divided by that of the primitive
        """
        trend, bend = (rows(part @ self._shown).T for part in (self._maps.trend, self._maps.bend))
        near = correlations(self._contexts.numbers, self._contexts.numbers, self._lengths)
        explained = self._linear @ trend.T + near @ bend.T
        roots = np.sqrt(self._weights)[:, None]
        offset = roots * (explained - np.average(explained, axis=0, weights=self._weights))
        _, values, right = np.linalg.svd(offset / np.sqrt(len(offset) - 1.0), full_matrices=False)
        kept = values > 1e-9 * values[0]
        # The few durations say no more than a trend.
        timing = np.linalg.lstsq(roots * self._linear, roots[:, 0] * lengths, rcond=None)[0]
        return ContextModel(self._contexts.names, self._contexts.numbers, self._lengths,
                            self._noise / self._weights, trend, bend,
                            (values[kept, None] * right[kept]).T, timing
                            ), lengths - self._linear @ timing

    def _covariance(self, lengths: np.ndarray, noise: float) -> np.ndarray:
        near = correlations(self._contexts.numbers, self._contexts.numbers, lengths)
        near[np.diag_indices(len(near))] += noise / self._weights
        return near

    def _unlikelihood(self, logarithms: np.ndarray) -> float:
        """Restricted likelihood, times -2; all numbers share one variance of the process."""
        length, noise = np.exp(logarithms)
        near = self._covariance(length * self._range, noise)
        maps = kriging(near, self._linear)
        energy = np.einsum('kc,kl,lc->', self._compact, maps.bend, self._compact)
        # Takes that a trend explains exactly leave nothing but rounding.
        energy = max(float(energy), ROUNDING * float((self._compact ** 2).sum()) + 1e-300)
        free = len(near) - self._linear.shape[1]
        return float(free * np.log(energy) + np.linalg.slogdet(near)[1]
                     - np.linalg.slogdet(maps.trend_covariance)[1])

    def _chosen(self) -> tuple[np.ndarray, float]:
        """One length for all numbers: one for each would be chosen from too few takes."""
        from scipy.optimize import minimize  # slow to import
        result = min((minimize(self._unlikelihood, np.log(start), method='L-BFGS-B',
                               bounds=np.log([LENGTHS, NOISES])) for start in STARTS),
                     key=lambda item: float(item.fun))
        length, noise = np.exp(result.x)
        return length * self._range, float(noise)


def variation_of(primitive: Skill, takes: Sequence[Demonstration],
                 take_weights: np.ndarray, contexts: Contexts | None) -> Variation:
    """
    Compute the variation of at least two aligned takes.

    :param primitive: learned from them
    :param take_weights: of the takes, 1 on average
    :param contexts: of the takes, if they were shown with contexts
    """
    manifold, count = primitive.manifold, len(takes)
    progress = np.linspace(0.0, 1.0, SAMPLES)
    maps = smoother(primitive.n_basis, primitive.gains, progress, WAVELENGTH)
    # Second moments are then weighted means.
    roots = np.sqrt(take_weights)[:, None]
    ends = np.array([_ends(primitive, take) for take in takes])
    rest = np.array([_rest(primitive, take, end, progress, maps)
                     for take, end in zip(takes, ends)])
    lengths = np.log([take.duration / primitive.duration for take in takes])
    model = None
    if contexts is None:
        # The skill contains each take: without it the rest would be larger by this.
        unseen = roots * count / (count - 1.0)
        ends = ends - np.average(ends, axis=0, weights=take_weights)
        lengths = lengths - np.average(lengths, weights=take_weights)
    else:
        fit, rows = _context_fit(primitive, contexts, take_weights, maps, ends, rest)
        model, lengths = fit.model(rows, lengths)
        ends, rest = fit.left[:, :ends.shape[1]], fit.left[:, ends.shape[1]:].reshape(rest.shape)
        unseen = roots
    ends, rest = unseen * ends, unseen[:, None] * rest
    weights = np.einsum('is,ksj->kij', maps.weights, rest)
    unexplained = rest - np.einsum('si,kij->ksj', maps.motion, weights)
    size = manifold.tangent_size
    share_ends, share_rest = (number / (number + count) for number in (2 * size, size))
    samples = np.hstack([ends, weights.reshape(count, -1)]) / np.sqrt(count - 1.0)
    alone, more = samples.copy(), samples.copy()
    alone[:, 2 * size:] = more[:, :2 * size] = 0.0
    usual_ends = _equal_ends(primitive, samples[:, :2 * size])
    units = _units(primitive, ends, rest)
    told = _told_by_ends(samples[:, :2 * size], (rest * units).reshape(count, -1), share_ends,
                         usual_ends[:, :2 * size])
    kept = np.sqrt(1.0 - share_ends)
    parts = [np.sqrt(told) * kept * samples, np.sqrt(1.0 - told) * kept * alone,
             np.sqrt(share_ends - share_rest + (1.0 - told) * kept ** 2) * more,
             np.sqrt(share_ends) * usual_ends,
             np.sqrt(share_rest) * _equal_weights(primitive, rest, maps.weights, progress)]
    noise = (unexplained ** 2).mean(axis=(0, 1))
    # Weights of late basis functions are larger, because the phase decays.
    effects = np.linalg.norm(maps.motion, axis=0) / np.sqrt(SAMPLES)
    scales = np.concatenate([units, units, np.outer(effects, units).reshape(-1)])
    wider = np.sqrt(_few(primitive, share_rest, count - (1 if model is None else 1 + len(
        model.names))))
    factor = (_compressed(np.vstack(parts) * scales) / scales).T * np.tile(
        wider, 2 + primitive.n_basis)[:, None]
    # Coordinates on a sphere have a normal component, in which nothing varies.
    tangent = change_of_frame(manifold, primitive.frame, primitive.frame)
    blocks = factor.reshape(-1, size, factor.shape[1])
    timing = np.sqrt(take_weights @ lengths ** 2 / (count - 1.0))
    return Variation(np.einsum('ij,kjr->kir', tangent, blocks).reshape(factor.shape),
                     wider ** 2 * noise, float(timing), model)


def _few(primitive: Skill, share: float, free: int) -> np.ndarray:
    """
    By how much variances grow because they were estimated from few takes, for each coordinate.

    With it the ellipsoid in which 95 % of a normal distribution lie holds 95 % of takes that were
    not seen: those are distributed as Student's t.

    :param share: of the variance that is the same in all directions of a factor
    :param free: degrees of freedom of the takes
    """
    from scipy.special import chdtri, fdtri
    result = np.empty(primitive.manifold.tangent_size)
    for columns in primitive.manifold.tangent_slices:
        size = columns.stop - columns.start
        # Variance of a mixture of the estimate in a direction and the mean over all of them.
        own, others = 1.0 - share + share / size, share / size
        freedom = free / (own ** 2 + (size - 1) * others ** 2)
        result[columns] = size * fdtri(size, freedom, SURE) / chdtri(size, 1.0 - SURE)
    return result


def _context_fit(primitive: Skill, contexts: Contexts, take_weights: np.ndarray,
                 maps: Smoother, ends: np.ndarray, rest: np.ndarray
                 ) -> tuple[ContextFit, Callable[[np.ndarray], np.ndarray]]:
    """What the contexts of takes explain; and how to get rows of a factor from ends and rest."""
    count, size = rest.shape[0], rest.shape[2]
    units = _units(primitive, ends, rest)
    scales = np.concatenate([units, units, np.tile(units, SAMPLES) / np.sqrt(SAMPLES)])
    fit = ContextFit(contexts, np.hstack([ends, rest.reshape(count, -1)]), scales, take_weights)

    def rows(numbers: np.ndarray) -> np.ndarray:
        motions = numbers[:, 2 * size:].reshape(len(numbers), SAMPLES, size)
        weights = np.einsum('is,ksj->kij', maps.weights, motions).reshape(len(numbers), -1)
        return np.hstack([numbers[:, :2 * size], weights])

    return fit, rows


def _ends(primitive: Skill, take: Demonstration) -> np.ndarray:
    """Shift of start and goal."""
    manifold = primitive.manifold
    goal_frame = frame_of(primitive, primitive.goal)
    return np.concatenate([
        manifold.log_in_frame(frame, manifold.align(point, near))[0] for frame, point, near in (
            (primitive.frame, take.points[0], primitive.start),
            (goal_frame, take.points[-1], primitive.goal))])


def _rest(primitive: Skill, take: Demonstration, ends: np.ndarray, progress: np.ndarray,
          maps: Smoother) -> np.ndarray:
    """
    From the moved skill to the take, in its frames, shape ``(samples, n)``.

    Where the space is curved it is corrected for what the weights do not do linearly; with the
    published connection, which has no frames along the motion, it is not.
    """
    manifold = primitive.manifold
    rest = np.zeros((len(progress), manifold.tangent_size))
    for _ in range(CORRECTIONS if primitive.connection == 'parallel' else 1):
        weights = maps.weights @ rest
        moved = shifted(primitive, np.concatenate([ends, weights.reshape(-1)]))
        path = Rollout(moved, duration=1.0).sample(progress).points.reshape(len(progress), -1)
        demo = take.aligned(moved.start).at(take.times[0] + progress * take.duration)
        # Coordinates of the weights are those in the frame carried from the skill's own start.
        frame = frame_of(primitive, moved.start)
        offset = Development(manifold, path, frame).ways_to(demo.reshape(len(progress), -1))
        before, rest = rest, maps.motion @ weights + offset
        if np.abs(rest - before).max() <= CONVERGED * (np.abs(rest).max() + 1e-12):
            break
    return rest


def _told_by_ends(ends: np.ndarray, rest: np.ndarray, share: float, usual: np.ndarray) -> float:
    """
    How much of what start and goal seem to tell of the rest they surely do, from 0 to 1.

    Each take is left out once, and predicted from its ends by the others. With few takes, or if
    all end at the same point, nothing may be sure: the skill is then only moved to its ends.

    :param ends: of each take, rows of a factor, shape ``(takes, any)``
    :param rest: of each take, in comparable units, shape ``(takes, any)``
    :param share: of equal variances of the ends, in their covariance
    :param usual: root of these variances, square
    """
    from scipy.special import stdtrit
    count = len(ends)
    if count < 3:
        return 0.0
    along, across = np.zeros(count), np.zeros(count)
    for left_out in range(count):
        others = np.arange(count) != left_out
        # Around the mean of the others: a common mean would let each take predict itself.
        known, known_rest = (part[others] - part[others].mean(axis=0) for part in (ends, rest))
        scale = (count - 1.0) / (count - 2.0)
        own = (1.0 - share) * scale * known.T @ known + share * usual @ usual.T
        tells = np.linalg.lstsq(own, ends[left_out] - ends[others].mean(axis=0), rcond=None)[0]
        predicted = (1.0 - share) * scale * (known @ tells) @ known_rest
        along[left_out] = predicted @ (rest[left_out] - rest[others].mean(axis=0))
        across[left_out] = predicted @ predicted
    if not across.any():
        return 0.0
    # As much as is sure: the lower confidence limit of a regression on what is predicted, with
    # the error of a jackknife (HC3): takes differ in how much they say. Slope and mean take
    # a degree of freedom each.
    slope, parts = along.sum() / across.sum(), across / across.sum()
    error = np.linalg.norm((along - slope * across) / np.maximum(1.0 - parts, 1e-9)
                           ) / across.sum()
    return float(np.clip(slope - stdtrit(max(count - 2.0, 1.0), SURE) * error, 0.0, 1.0))


def _equal_ends(primitive: Skill, samples: np.ndarray) -> np.ndarray:
    """Rows of a factor: start and goal vary alike in all directions of a factor."""
    size, count = primitive.manifold.tangent_size, primitive.n_basis
    variances = (samples ** 2).sum(axis=0).reshape(2, size)
    for factor, columns in zip(primitive.manifold.factors, primitive.manifold.tangent_slices):
        # Takes that all end at the same point still say nothing below its tolerance.
        variances[:, columns] = (variances[:, columns].mean(axis=1, keepdims=True)
                                 + factor.goal_tolerance ** 2)
    return np.hstack([np.diag(np.sqrt(variances.reshape(-1))), np.zeros((2 * size, count * size))])


def _equal_weights(primitive: Skill, rest: np.ndarray, smoother: np.ndarray,
                   progress: np.ndarray) -> np.ndarray:
    """Rows of a factor: deviations as large as the takes', alike in all directions of a factor."""
    size, count = primitive.manifold.tangent_size, primitive.n_basis
    near = np.exp(-0.5 * (np.subtract.outer(progress, progress) / CORRELATION) ** 2)
    values, vectors = np.linalg.eigh(near)
    root = (vectors * np.sqrt(np.maximum(values, 0.0)))[:, values > 1e-6 * values[-1]]
    deviation = (rest ** 2).sum(axis=0) / (len(rest) - 1.0)
    result = []
    for columns in primitive.manifold.tangent_slices:
        scale = np.sqrt(deviation[:, columns].mean(axis=1))
        shape = smoother @ (scale[:, None] * root)
        for coordinate in range(columns.start, columns.stop):
            rows = np.zeros((shape.shape[1], 2 * size + count * size))
            rows[:, 2 * size + coordinate::size] = shape.T
            result.append(rows)
    return np.vstack(result)


def _units(primitive: Skill, ends: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """For each coordinate, one over the deviation of its factor."""
    result = np.empty(primitive.manifold.tangent_size)
    for factor, columns in zip(primitive.manifold.factors, primitive.manifold.tangent_slices):
        both = np.square(rest[:, :, columns]).mean() + np.square(
            ends.reshape(len(ends), 2, -1)[:, :, columns]).mean()
        result[columns] = 1.0 / (np.sqrt(both) + factor.goal_tolerance)
    return result


def _compressed(rows: np.ndarray) -> np.ndarray:
    """Fewer rows with nearly the same products of columns."""
    _, values, right = np.linalg.svd(rows, full_matrices=False)
    kept = max(1, int((values > NEGLIGIBLE * values[0]).sum()))
    return np.asarray(values[:kept, None] * right[:kept])
