"""
Learn from demonstrations with task frames: one motion in each frame, and where which one matters.

In each frame the mean of the takes, aligned in time for all frames together, is learned as one
demonstration: takes that a frame does not explain differ in it, and their differences are no noise
of a recording. How much a frame counts along the motion is its precision, (n0 + n) /
(n0 σ0² + w S): S is the scatter of n takes in it, n0 and σ0 are a prior, and w is a weight that
leads from the frame of the start to that of the goal with minimum jerk. So a single take is
blended with w, and the takes are heard as they come. A frame that is neither counts where the
takes agree in it more than chance explains.
"""
from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
import warnings

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.stats import f as f_distribution

from gdmp_ros.dmp.demonstration import as_list, Demonstration
from gdmp_ros.dmp.frames import BASE, base_pose, mean_pose, placed, seen_from, View
from gdmp_ros.dmp.rollout import Rollout
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import DataError, GdmpWarning, ParameterError
from gdmp_ros.learning.alignment import align, mean_path
from gdmp_ros.learning.preparation import FitSettings, prepared
from gdmp_ros.manifolds import Manifold, Product
from gdmp_ros.util.profiles import minimum_jerk

#: The prior of a frame's scatter: so many takes, with this deviation, as a part of the span.
PRIOR_TAKES, PRIOR_DEVIATION = 10.0, 0.1
#: Standard deviation of the smoothing of the scatter, in durations.
SMOOTHING = 0.05
#: Knots of the shares, and samples of the scatter.
KNOTS, SAMPLES = 51, 101
#: A share below the first number is 0, above the second one as it is: a hundredth of a frame that
#: moved half a metre misses a hole by 5 mm.
LEAST_SHARE, FULL_SHARE = 0.02, 0.05
#: Probability that chance alone makes takes agree so much: a frame that is neither the start's nor
#: the goal's does not count above the first, and counts in full below the second.
CHANCE, NO_CHANCE = 2e-3, 2e-4
#: Fewest and most samples of the mean of several takes.
_FEWEST, _MOST = 200, 1000

Learn = Callable[[Demonstration], Skill]


def frame_names(demonstrations: Sequence[Demonstration], start: str | None, goal: str | None
                ) -> list[str]:
    """
    The frames that all demonstrations have, that of the start first and that of the goal last.

    :param start: name of the frame of the start; by default ``start``, else the first one
    :param goal: name of the frame of the goal; by default ``goal``, else the last one
    :returns: empty if none of the demonstrations has frames
    :raises ParameterError: if a frame that was named is none of them
    :raises DataError: if the demonstrations have no frame in common
    """
    first = list(demonstrations[0].frames)
    common = [name for name in first if all(name in d.frames for d in demonstrations)]
    if not common:
        if start is not None or goal is not None:
            raise ParameterError(f'frame {start or goal!r}: the demonstrations have no frames')
        if any(d.frames for d in demonstrations):
            raise DataError('frames: the demonstrations have no frame in common: '
                            + '; '.join(', '.join(d.frames) or 'none' for d in demonstrations))
        return []
    for name in (start, goal):
        if name is not None and name not in (*common, BASE):
            raise ParameterError(f'frame {name!r}: expected one of {", ".join(common)}, the frames '
                                 'that all demonstrations have')
    left = sorted({name for d in demonstrations for name in d.frames} - set(common))
    if left:
        warnings.warn(f'frames {", ".join(left)}: not in all demonstrations, and not used',
                      GdmpWarning, stacklevel=5)
    return _in_order(common, start, goal)


def _in_order(common: list[str], start: str | None, goal: str | None) -> list[str]:
    told = start is None and goal is None and len(common) > 1
    if goal is None:
        free = [name for name in common if name != start]
        goal = 'goal' if 'goal' in free else free[-1] if free else BASE
    if start is None:
        free = [name for name in common if name != goal]
        start = 'start' if 'start' in free else free[0] if free else BASE
    if start == goal:
        raise ParameterError(f'frames: {start!r} is named for the start and for the goal')
    if told and (start, goal) != ('start', 'goal'):
        warnings.warn(f'frames: {start!r} is taken for that of the start, {goal!r} for that of '
                      'the goal; name them with start_frame and goal_frame', GdmpWarning,
                      stacklevel=6)
    return [start, *(name for name in common if name not in (start, goal)), goal]


def learn_in_frames(demonstrations: Sequence[Demonstration], names: list[str],
                    settings: FitSettings, learn: Learn) -> Skill:
    """
    Learn a skill with task frames.

    :param names: see `frame_names`
    :param learn: learns a plain skill from one demonstration
    :raises ParameterError: for what frames are not combined with
    """
    for what, given in (('contexts', settings.contexts), ("end='moving'", settings.end == 'moving'),
                        ('demonstration_weights', settings.demonstration_weights)):
        if given:
            raise ParameterError(f'{what}: not together with task frames')
    demos = as_list(demonstrations)
    manifold, count = demos[0].manifold, len(names)
    takes = prepared([_seen_from_all(d, names) for d in demos], settings.smoothing)
    paths, mean = _on_common_time(takes, settings.align)
    duration = float(np.mean([take.duration for take in takes]))
    columns = np.split(np.arange(mean.shape[-1]), count)
    skills = []
    for part in columns:
        shown = (Demonstration(takes[0].times, takes[0].flat_points[:, part].reshape(
            -1, *manifold.point_shape), manifold) if len(takes) == 1
                 else Demonstration(np.linspace(0.0, duration, len(mean)), mean[:, part].reshape(
                     -1, *manifold.point_shape), manifold))
        skills.append(learn(shown))
    grid = np.linspace(0, len(mean) - 1, SAMPLES).round().astype(int)
    scatter, spans = _scatter(takes[0].manifold, paths[:, grid], mean[grid])
    spans = spans.reshape(count, -1).mean(axis=0)
    scatter = scatter.reshape(SAMPLES, count, -1)
    poses = [[_pose(d, name) for name in names] for d in demos]
    shares = _shares(scatter, np.maximum(PRIOR_DEVIATION * spans, [
        factor.goal_tolerance for factor in manifold.factors]), len(takes))
    if count > 2 and len(takes) > 1:
        rest = _unexplained(manifold, [columns[0], columns[-1]], [poses_of_take[::count - 1]
                            for poses_of_take in poses], paths[:, grid], mean[grid],
                            shares[:, [0, -1]])
        shares = _with_others(scatter, rest, shares, manifold, len(takes))
    shares = _without_traces(shares)
    views = [View(name, mean_pose([one[k] for one in poses]), shares[:, k], skill)
             for k, (name, skill) in enumerate(zip(names, skills))]
    return _as_shown(views, skills[0], learn, settings)


def _pose(demonstration: Demonstration, name: str) -> np.ndarray:
    """Pose of a frame, of one that moved at the end."""
    if name == BASE and name not in demonstration.frames:
        return base_pose()
    pose = np.asarray(demonstration.frames[name])
    return pose if pose.ndim == 1 else pose[-1]


def _seen_from_all(demonstration: Demonstration, names: list[str]) -> Demonstration:
    """A demonstration as seen from all frames, on a product with one part for each."""
    manifold, points = demonstration.manifold, []
    for name in names:
        pose = (base_pose() if name == BASE and name not in demonstration.frames
                else np.asarray(demonstration.frames[name]))
        points.append(seen_from(manifold, pose, demonstration.points).reshape(
            len(demonstration.times), -1))
    product = Product(*[factor for _ in names for factor in manifold.factors],
                      names=[f'{name}: {factor}' for name in names for factor in manifold.names])
    return Demonstration(demonstration.times, np.hstack(points), product)


def _on_common_time(takes: list[Demonstration], warped: bool) -> tuple[np.ndarray, np.ndarray]:
    """
    Paths of the takes at equal progress, and their mean.

    :returns: shapes (takes, samples, point_size) and (samples, point_size)
    """
    count = int(np.clip(max(len(take.times) for take in takes), _FEWEST, _MOST))
    progress = np.linspace(0.0, 1.0, count)
    own = [progress] * len(takes)
    if warped and len(takes) > 1:
        alignment = align(takes, moved=False)
        own = [np.interp(progress, alignment.progress, warp) for warp in alignment.warps]
    first = takes[0].points[0]
    paths = np.array([take.aligned(first).at(take.times[0] + moments * take.duration)
                      for take, moments in zip(takes, own)])
    return paths, mean_path(takes[0].manifold, paths, paths[0])


def _scatter(manifold: Manifold, paths: np.ndarray, mean: np.ndarray
             ) -> tuple[np.ndarray, np.ndarray]:
    """
    Sum of the squared distances of the takes from their mean, for each factor, per dimension.

    :returns: shapes (samples, factors) and, the span of each factor, (factors,)
    """
    dims = np.array([factor.dim for factor in manifold.factors])
    squares = sum(manifold.factor_distances(mean, path) ** 2 for path in paths) / dims
    spans = np.mean([manifold.factor_distances(np.ascontiguousarray(np.broadcast_to(
        path[0], path.shape)), path).max(axis=0) for path in paths], axis=0)
    return _smoothed(squares), spans


def _smoothed(along: np.ndarray) -> np.ndarray:
    return np.asarray(gaussian_filter1d(along, SMOOTHING * (len(along) - 1), axis=0,
                                        mode='nearest'))


def _precision(scatter: np.ndarray, deviation: np.ndarray, takes: int, weight: np.ndarray
               ) -> np.ndarray:
    return np.asarray(weight * (PRIOR_TAKES + takes)
                      / (PRIOR_TAKES * deviation ** 2 + weight * scatter))


def _shares(scatter: np.ndarray, deviation: np.ndarray, takes: int) -> np.ndarray:
    """
    Shares of the frames of start and goal; the others have their precision without a gate.

    :param scatter: shape (samples, frames, factors)
    :returns: precisions, shape (knots, frames, factors)
    """
    s = np.linspace(0.0, 1.0, KNOTS)
    late = minimum_jerk(s)[:, None]
    at = np.linspace(0, len(scatter) - 1, KNOTS).round().astype(int)
    result = np.empty((KNOTS, *scatter.shape[1:]))
    for k in range(scatter.shape[1]):
        weight = (1.0 - late if k == 0 else late if k == scatter.shape[1] - 1
                  else np.ones_like(late))
        result[:, k] = _precision(scatter[at, k], deviation, takes, weight)
    if takes == 1:
        result[:, 1:-1] = 0.0
    return result


def _unexplained(manifold: Manifold, columns: list[np.ndarray], poses: list[list[np.ndarray]],
                 paths: np.ndarray, mean: np.ndarray, precision: np.ndarray) -> np.ndarray:
    """
    Squared distances of the takes from what the frames of start and goal make of their means.

    :param columns: of the two frames in the points
    :param poses: of the two frames, for each take
    :param precision: of the two, shape (knots, 2, factors)
    :returns: smoothed, per dimension, shape (samples, factors)
    """
    share = precision[:, 1] / precision.sum(axis=1)
    s = np.linspace(0.0, 1.0, len(mean))
    late = np.stack([np.interp(s, np.linspace(0.0, 1.0, KNOTS), one) for one in share.T], axis=1)
    widths = [part.stop - part.start for part in manifold.tangent_slices]
    scale = np.repeat(late, widths, axis=1)
    dims = np.array([factor.dim for factor in manifold.factors])
    total = np.zeros((len(mean), len(dims)))
    for path, (first, last) in zip(paths, poses):
        here = [placed(manifold, pose, mean[:, part].reshape(-1, *manifold.point_shape))
                for pose, part in zip((first, last), columns)]
        way, _ = manifold.log_anyway(*here)
        fused = manifold.exp(here[0], scale * way)
        shown = placed(manifold, first, path[:, columns[0]].reshape(-1, *manifold.point_shape))
        total += manifold.factor_distances(fused.reshape(len(mean), -1),
                                           shown.reshape(len(mean), -1)) ** 2 / dims
    return _smoothed(total)


def _with_others(scatter: np.ndarray, rest: np.ndarray, precision: np.ndarray, manifold: Manifold,
                 takes: int) -> np.ndarray:
    """Precisions, those of the other frames only where chance does not explain their agreement."""
    result, at = precision.copy(), np.linspace(0, len(rest) - 1, KNOTS).round().astype(int)
    for f, factor in enumerate(manifold.factors):
        freedom = (takes - 1) * factor.dim
        zero, full = (float(f_distribution.isf(p, freedom, freedom)) for p in (CHANCE, NO_CHANCE))
        for k in range(1, precision.shape[1] - 1):
            ratio = rest[at, f] / np.maximum(scatter[at, k, f], 1e-300)
            # By the logarithm, on which the distribution of a ratio is symmetric.
            u = (np.log(np.maximum(ratio, 1e-300)) - np.log(zero)) / (np.log(full) - np.log(zero))
            result[:, k, f] *= minimum_jerk(np.clip(u, 0.0, 1.0))
    return result


def _without_traces(precision: np.ndarray) -> np.ndarray:
    """Shares: normalised precisions, without those that are too small to matter."""
    shares = precision / precision.sum(axis=1, keepdims=True)
    shares *= minimum_jerk(np.clip((shares - LEAST_SHARE) / (FULL_SHARE - LEAST_SHARE), 0.0, 1.0))
    return np.asarray(shares / shares.sum(axis=1, keepdims=True))


def _as_shown(views: list[View], first: Skill, learn: Learn, settings: FitSettings) -> Skill:
    """The skill: the motion with the frames where they were shown, and the views."""
    begins, ends = (placed(view.skill.manifold, view.pose, np.array([point]))[0]
                    for view, point in ((views[0], views[0].skill.start),
                                        (views[-1], views[-1].skill.goal)))
    model = replace(first, views=tuple(views), start=begins, frame=first.manifold.frame(begins),
                    goal=ends)
    times = np.linspace(0.0, model.duration, _MOST)
    shown = learn(Demonstration(times, Rollout(model).sample(times).points, model.manifold))
    return replace(shown, views=tuple(views), provenance=settings.provenance)
