"""
How takes vary around the skill learned from them.

The skill, moved to the start and goal of each take, explains most of it. The rest is fitted with
weights; start, goal and weights of all takes have a sample covariance. There are fewer takes than
numbers: the covariance is shrunk towards one with equal variances in all directions of a factor,
which counts like as many takes as there are numbers to know.
"""
from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.development import Development
from gdmp_ros.dmp.ends import shifted
from gdmp_ros.dmp.primitive import change_of_frame, frame_of, Primitive
from gdmp_ros.dmp.rollout import Rollout
from gdmp_ros.dmp.variation import Variation
from gdmp_ros.learning.context_fit import ContextFit, Contexts
from gdmp_ros.learning.smoothing import Smoother, smoother

#: Samples of a take.
SAMPLES = 101
#: Shortest wavelength of what varies, and correlation length of what is not known, in durations.
WAVELENGTH, CORRELATION = 0.05, 0.1
#: Directions with a smaller part of the largest standard deviation, each factor in its own unit,
#: are left out.
NEGLIGIBLE = 1e-3
#: Most corrections for the curvature of the space, and when they have converged.
CORRECTIONS, CONVERGED = 5, 1e-3


def variation_of(primitive: Primitive, takes: Sequence[Demonstration],
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
    rest = np.array([_rest(primitive, take, one, progress, maps)
                     for take, one in zip(takes, ends)])
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
    more = samples.copy()
    more[:, :2 * size] = 0.0
    parts = [np.sqrt(1.0 - share_ends) * samples, np.sqrt(share_ends - share_rest) * more,
             _equal_ends(primitive, np.sqrt(share_ends) * samples[:, :2 * size]),
             np.sqrt(share_rest) * _equal_weights(primitive, rest, maps.weights, progress)]
    noise = (unexplained ** 2).mean(axis=(0, 1))
    # Weights of late basis functions are larger, because the phase decays.
    effects = np.linalg.norm(maps.motion, axis=0) / np.sqrt(SAMPLES)
    units = _units(primitive, ends, rest)
    scales = np.concatenate([units, units, np.outer(effects, units).reshape(-1)])
    factor = (_compressed(np.vstack(parts) * scales) / scales).T
    # Coordinates on a sphere have a normal component, in which nothing varies.
    tangent = change_of_frame(manifold, primitive.frame, primitive.frame)
    blocks = factor.reshape(-1, size, factor.shape[1])
    timing = np.sqrt(take_weights @ lengths ** 2 / (count - 1.0))
    return Variation(np.einsum('ij,kjr->kir', tangent, blocks).reshape(factor.shape), noise,
                     float(timing), model)


def _context_fit(primitive: Primitive, contexts: Contexts, take_weights: np.ndarray,
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


def _ends(primitive: Primitive, take: Demonstration) -> np.ndarray:
    """Shift of start and goal."""
    manifold = primitive.manifold
    goal_frame = frame_of(primitive, primitive.goal)
    return np.concatenate([
        manifold.log_in_frame(frame, manifold.align(point, near))[0] for frame, point, near in (
            (primitive.frame, take.points[0], primitive.start),
            (goal_frame, take.points[-1], primitive.goal))])


def _rest(primitive: Primitive, take: Demonstration, ends: np.ndarray, progress: np.ndarray,
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
        shown = take.aligned(moved.start).at(take.times[0] + progress * take.duration)
        # Coordinates of the weights are those in the frame carried from the skill's own start.
        frame = frame_of(primitive, moved.start)
        away = Development(manifold, path, frame).ways_to(shown.reshape(len(progress), -1))
        before, rest = rest, maps.motion @ weights + away
        if np.abs(rest - before).max() <= CONVERGED * (np.abs(rest).max() + 1e-12):
            break
    return rest


def _equal_ends(primitive: Primitive, samples: np.ndarray) -> np.ndarray:
    """Rows of a factor: start and goal vary alike in all directions of a factor."""
    size, count = primitive.manifold.tangent_size, primitive.n_basis
    variances = (samples ** 2).sum(axis=0).reshape(2, size)
    for factor, columns in zip(primitive.manifold.factors, primitive.manifold.tangent_slices):
        # Takes that all end at the same point still say nothing below its tolerance.
        variances[:, columns] = (variances[:, columns].mean(axis=1, keepdims=True)
                                 + factor.goal_tolerance ** 2)
    return np.hstack([np.diag(np.sqrt(variances.reshape(-1))), np.zeros((2 * size, count * size))])


def _equal_weights(primitive: Primitive, rest: np.ndarray, smoother: np.ndarray,
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


def _units(primitive: Primitive, ends: np.ndarray, rest: np.ndarray) -> np.ndarray:
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
