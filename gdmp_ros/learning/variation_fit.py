"""
How takes vary around the skill learned from them.

The skill, moved to the start and goal of each take, explains most of it. The rest is fitted with
weights; start, goal and weights of all takes have a sample covariance. There are fewer takes than
numbers: the covariance is shrunk towards one with equal variances in all directions of a factor,
which counts like as many takes as there are numbers to know.
"""
from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.development import Development
from gdmp_ros.dmp.primitive import carry_frame, Gains, Primitive
from gdmp_ros.dmp.response import LAST, responses, third_derivatives
from gdmp_ros.dmp.rollout import Rollout
from gdmp_ros.dmp.variation import Variation
from gdmp_ros.manifolds.factors import work_array
from gdmp_ros.manifolds.rows import log_in_frame_rows

#: Samples of a take.
SAMPLES = 101
#: Shortest wavelength of what varies, and correlation length of what is not known, in durations.
WAVELENGTH, CORRELATION = 0.05, 0.1
#: Directions with a smaller part of the largest standard deviation, each factor in its own unit,
#: are left out.
NEGLIGIBLE = 1e-3


def variation_of(primitive: Primitive, takes: Sequence[Demonstration]) -> Variation:
    """
    Compute the variation of at least two aligned takes.

    :param primitive: learned from them
    """
    manifold, count = primitive.manifold, len(takes)
    progress = np.linspace(0.0, 1.0, SAMPLES)
    # The skill contains each take: without it the rest would be larger by this.
    unseen = count / (count - 1.0)
    ends = np.array([_ends(primitive, take) for take in takes])
    ends = unseen * (ends - ends.mean(axis=0))
    rest = unseen * np.array([_rest(primitive, take, progress) for take in takes])
    smoother = _smoother(primitive.n_basis, primitive.gains, progress)
    weights = np.einsum('is,ksj->kij', smoother, rest)
    unexplained = rest - np.einsum('si,kij->ksj', _matrix(primitive, progress), weights)
    size = manifold.tangent_size
    share_ends, share_rest = (number / (number + count) for number in (2 * size, size))
    samples = np.hstack([ends, weights.reshape(count, -1)]) / np.sqrt(count - 1.0)
    more = samples.copy()
    more[:, :2 * size] = 0.0
    parts = [np.sqrt(1.0 - share_ends) * samples, np.sqrt(share_ends - share_rest) * more,
             _equal_ends(primitive, np.sqrt(share_ends) * samples[:, :2 * size]),
             np.sqrt(share_rest) * _equal_weights(primitive, rest, smoother, progress)]
    noise = (unexplained ** 2).mean(axis=(0, 1))
    # Weights of late basis functions are larger, because the phase decays.
    effects = np.linalg.norm(_matrix(primitive, progress), axis=0) / np.sqrt(SAMPLES)
    units = _units(primitive, ends, rest)
    scales = np.concatenate([units, units, np.outer(effects, units).reshape(-1)])
    factor = (_compressed(np.vstack(parts) * scales) / scales).T
    # Coordinates on a sphere have a normal component, in which nothing varies.
    tangent = np.array([manifold.to_frame(primitive.frame, manifold.from_frame(
        primitive.frame, unit)) for unit in np.eye(size)]).T
    blocks = factor.reshape(-1, size, factor.shape[1])
    return Variation(np.einsum('ij,kjr->kir', tangent, blocks).reshape(factor.shape), noise)


def _ends(primitive: Primitive, take: Demonstration) -> np.ndarray:
    """Shift of start and goal."""
    manifold = primitive.manifold
    goal_frame = carry_frame(manifold, primitive.frame, primitive.goal)[0]
    return np.concatenate([
        manifold.log_in_frame(frame, manifold.align(point, near))[0] for frame, point, near in (
            (primitive.frame, take.points[0], primitive.start),
            (goal_frame, take.points[-1], primitive.goal))])


def _rest(primitive: Primitive, take: Demonstration, progress: np.ndarray) -> np.ndarray:
    """From the moved skill to the take, in its frames, shape ``(samples, n)``."""
    manifold = primitive.manifold
    start = manifold.align(take.points[0], primitive.start)
    rollout = Rollout(primitive, start=start, goal=take.points[-1], duration=1.0)
    path = rollout.sample(progress).points.reshape(len(progress), -1)
    frames = Development(manifold, path, carry_frame(manifold, primitive.frame, start)[0]).frames
    shown = take.aligned(start).at(take.times[0] + progress * take.duration)
    away, table = np.empty((len(path), manifold.tangent_size)), manifold.factor_table
    log_in_frame_rows(table, frames, shown.reshape(len(progress), -1).copy(), away,
                      np.empty(len(path)), work_array(table))
    return away


def _matrix(primitive: Primitive, progress: np.ndarray) -> np.ndarray:
    return responses(primitive.n_basis, primitive.gains).at(progress)[1][:, 1:]


def _smoother(count: int, gains: Gains, progress: np.ndarray) -> np.ndarray:
    """Matrix from deviations at the samples to weights; after the end there is no deviation."""
    response = responses(count, gains)
    spacing = progress[1]
    held = np.arange(1.0 + spacing, LAST, spacing)
    matrix = response.at(np.concatenate([progress, held]))[1][:, 1:]
    rough = third_derivatives(response.motion[:, 1:])
    normal = spacing * matrix.T @ matrix + (WAVELENGTH / (2.0 * np.pi)) ** 6 * rough.T @ rough
    normal[np.diag_indices(count)] += 1e-12 * np.trace(normal) / count
    return np.asarray(np.linalg.solve(normal, spacing * matrix[:len(progress)].T))


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
