"""
Learn from demonstrations with task frames: one motion in each frame, and where which one matters.

In each frame the mean of the takes, each aligned in time with what the skill would do in its
situation, is learned as one demonstration: takes that a frame does not explain differ in it, and
their differences are no noise of a recording. How much a frame counts along the motion is its
precision, (n0 + n) / (n0 σ0² + w S): S is the scatter of n takes in it, n0 and σ0 are a prior, and
w is a weight that leads from the frame of the start to that of the goal with minimum jerk. So a
single take is blended with w, and the takes are heard as they come: n0 is what foretells each take
best from the others. A frame that is neither counts where the takes agree in it more than chance
explains.
"""
from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple
import warnings

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.stats import f as f_distribution

from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.frames import (
    BASE,
    mean_pose,
    nearest_turn,
    placed,
    seen_from,
    tool_poses,
    View,
)
from gdmp_ros.dmp.options import check_range
from gdmp_ros.dmp.rollout import Rollout
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import DataError, GdmpWarning, ParameterError
from gdmp_ros.learning.alignment import align, mean_path
from gdmp_ros.learning.grasps import Grasp, grasp_of
from gdmp_ros.learning.preparation import FitSettings, prepared
from gdmp_ros.manifolds import Manifold, UnitQuaternion
from gdmp_ros.manifolds.poses import compose, IDENTITY, inverse
from gdmp_ros.util.profiles import minimum_jerk

#: Prior of a frame's scatter: equivalent number of takes, and standard deviation as a part of the
#: span. With three takes or more the number is chosen by leaving each take out once.
PRIORS, OF_FEW, PRIOR_DEVIATION = (10.0, 30.0, 100.0, 1000.0), 30.0, 0.1
#: Standard deviation of the smoothing of the scatter, in durations.
SMOOTHING = 0.05
#: Knots of the shares.
KNOTS = 51
#: Alignments of the takes with what the skill would do in their situations.
PASSES = 2
#: They are used if they leave at most this part of the squared differences: a warp always finds
#: something, in takes of different shape and the same timing a third.
NEEDED = 0.5
#: A share below the first number is 0, and from the second one on it counts with its slope: a
#: hundredth of a frame that moved half a metre misses a hole by 5 mm.
LEAST_SHARE, FULL_SHARE = 0.015, 0.03
#: Probability that chance alone makes takes agree so much: a frame that is neither the start's nor
#: the goal's does not count above the first, and counts in full below the second.
CHANCE, NO_CHANCE = 2e-3, 2e-4
#: Part of the prior that is left where the takes surely agree in a frame that it does not know.
LEAST_PRIOR = 0.01
#: Latest progress at which the object of the start is grasped: later the motion has no time left.
LATEST_GRASP = 0.9
#: Fewest and most samples of the mean of several takes.
_FEWEST, _MOST = 200, 1000
#: Iterations of a mean of points in the base.
_ITERATIONS = 4
#: Smallest scatter in a ratio, and beside its largest one.
_TINY, _FLOOR = 1e-18, 1e-4

Learn = Callable[[Demonstration], Skill]


class FrameSettings(NamedTuple):
    """
    What is said about task frames; see `gdmp_ros.dmp.Skill.learn`.

    :ivar start: name of the frame of the start; None for ``start``, else the first one
    :ivar goal: name of the frame of the goal; None for ``goal``, else the last one
    :ivar free_yaw: names of objects that are symmetric about their z axis
    :ivar grasp_at: progress at which the object of the start is grasped
    """

    start: str | None = None
    goal: str | None = None
    free_yaw: tuple[str, ...] = ()
    grasp_at: float | None = None

    @property
    def are_given(self) -> bool:
        """Whether anything is said."""
        return self != FrameSettings()


def frame_names(demonstrations: Sequence[Demonstration], frames: FrameSettings) -> list[str]:
    """
    The frames that all demonstrations have, that of the start first and that of the goal last.

    :returns: empty if none of the demonstrations has frames
    :raises ParameterError: if a frame that was named is none of them
    :raises DataError: if the demonstrations have no frame in common
    """
    first = list(demonstrations[0].frames)
    common = [name for name in first if all(name in d.frames for d in demonstrations)]
    if not common:
        if frames.are_given:
            said = ', '.join(f'{name} {value!r}' for name, value in frames._asdict().items()
                             if value)
            raise ParameterError(f'{said}: the demonstrations have no frames')
        if any(d.frames for d in demonstrations):
            raise DataError('frames: the demonstrations have no frame in common: '
                            + '; '.join(', '.join(d.frames) or 'none' for d in demonstrations))
        return []
    for name in (frames.start, frames.goal):
        if name is not None and name not in (*common, BASE):
            raise ParameterError(f'frame {name!r}: expected one of {", ".join(common)}, which all '
                                 'demonstrations have')
    left = sorted({name for d in demonstrations for name in d.frames} - set(common))
    if left:
        warnings.warn(f'frames {", ".join(left)}: not in all demonstrations, and not used',
                      GdmpWarning, stacklevel=5)
    return _in_order(common, frames.start, frames.goal)


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
                    frames: FrameSettings, settings: FitSettings, learn: Learn) -> Skill:
    """
    Learn a skill with task frames.

    :param names: see `frame_names`
    :param learn: learns a plain skill from one demonstration
    :raises ParameterError: for what frames are not combined with
    :raises DataError: if an object is grasped in some of the takes only
    """
    for name in frames.free_yaw:
        if name not in names:
            raise ParameterError(f'free_yaw: frame {name!r}, expected one of {", ".join(names)}')
    for what, given in (('contexts', settings.contexts is not None),
                        ("end='moving'", settings.end == 'moving'),
                        ('demonstration_weights', settings.demonstration_weights is not None)):
        if given:
            raise ParameterError(f'{what}: not together with task frames')
    poses = [[_poses(given, name) for name in names] for given in demonstrations]
    for k in (names.index(name) for name in frames.free_yaw):
        near = np.atleast_2d(poses[0][k])[0]
        for own in poses:
            own[k] = _turned(own[k], near)
    takes = [_Take(demo, given.times, own)
             for demo, given, own in zip(prepared(demonstrations, None), demonstrations, poses)]
    grasped = [_rest_where_grasped(takes, k, name) for k, name in enumerate(names)]
    if frames.grasp_at is not None:
        grasped[0] = check_range('grasp_at', frames.grasp_at, 0.0, LATEST_GRASP)
    leaves = min(grasped[0] or 0.0, LATEST_GRASP)
    count = int(np.clip(max(len(take.demo.times) for take in takes), _FEWEST, _MOST))
    progress = np.linspace(0.0, 1.0, count)
    own_progress = [progress] * len(takes)
    found = _found(takes, own_progress, leaves)
    if len(takes) > 1 and settings.align:
        as_timed = found.left(takes, own_progress)
        for _ in range(PASSES):
            expected = [found.expected(i, take.demo) for i, take in enumerate(takes)]
            alignment = align([take.demo for take in takes], expected=expected)
            own = [np.interp(progress, alignment.progress, warp) for warp in alignment.warps]
            warped = _found(takes, own, leaves)
            if warped.left(takes, own) > NEEDED * as_timed:
                break
            found, own_progress = warped, own
    found = found.with_prior(_best_prior(takes, own_progress, leaves))
    shown = ([takes[0].seen_from(k) for k in range(len(names))] if len(takes) == 1 else
             [Demonstration(float(np.mean([take.demo.duration for take in takes])) * progress,
                            found.manifold.unflat(mean), found.manifold) for mean in found.means])
    views = [View(name, mean_pose(found.poses[:, -1, k]), found.shares[:, k], learn(one),
                  name in frames.free_yaw, grasped[k])
             for k, (name, one) in enumerate(zip(names, shown))]
    return _as_shown(views, learn, settings)


def _poses(demonstration: Demonstration, name: str) -> np.ndarray:
    """Poses of a frame, shape (7,) or (samples, 7)."""
    if name == BASE and name not in demonstration.frames:
        return IDENTITY
    return np.asarray(demonstration.frames[name])


def _turned(poses: np.ndarray, near: np.ndarray) -> np.ndarray:
    """Poses of a symmetric object, turned about its axis: the first near a pose, then in turn."""
    rows = np.array(np.atleast_2d(poses))
    for row in rows:
        row[:] = near = nearest_turn(row, near)
    return rows.reshape(poses.shape)


def _rest_where_grasped(takes: list[_Take], k: int, name: str) -> float | None:
    """
    Let a frame that the tool carries rest where the object was grasped.

    :returns: progress of the earliest grasp; None if it was not grasped
    :raises DataError: if it was grasped in some of the takes only
    """
    grasps = [take.grasp(k) for take in takes]
    found = [grasp for grasp in grasps if grasp is not None]
    if not found:
        return None
    if len(found) < len(takes):
        missing = [str(i) for i, grasp in enumerate(grasps) if grasp is None]
        raise DataError(f'frame {name}: the tool carries the object in some demonstrations, but '
                        f'not in number {", ".join(missing)} (from 0)')
    progress = min(take.rest(k, grasp) for take, grasp in zip(takes, found))
    warnings.warn(f'frame {name}: the tool holds the object from {100.0 * progress:.0f} % of the '
                  'motion on; its frame rests where it was grasped', GdmpWarning, stacklevel=6)
    return progress


class _Take:
    """A demonstration, and the poses of all frames while it was shown."""

    def __init__(self, demo: Demonstration, times: np.ndarray, poses: list[np.ndarray]):
        """:param times: of the poses of frames that moved"""
        self.demo, self._times, self._poses = demo, times, poses

    def _poses_at(self, k: int, times: np.ndarray) -> np.ndarray:
        given = self._poses[k]
        if given.ndim == 1:
            return np.tile(given, (len(times), 1))
        poses = np.stack([np.interp(times, self._times, column) for column in given.T], axis=1)
        poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
        return poses

    def grasp(self, k: int) -> Grasp | None:
        """When the object of frame ``k`` was grasped; None if it was not, or did not move."""
        given = self._poses[k]
        if given.ndim == 1:
            return None
        tool = tool_poses(self.demo.manifold, self.demo.at(self._times))
        return None if tool is None else grasp_of(self._times, given, np.array(
            [compose(inverse(frame), pose) for frame, pose in zip(given, tool)]))

    def rest(self, k: int, grasp: Grasp) -> float:
        """Let frame ``k`` rest from a grasp on; the progress of the grasp."""
        poses = np.array(self._poses[k])
        after = self._times >= grasp.time
        poses[after] = grasp.pose
        poses[:, 3:] = UnitQuaternion().continuous(poses[:, 3:])
        self._poses[k] = poses
        return float((grasp.time - self.demo.times[0]) / self.demo.duration)

    def seen_from(self, k: int) -> Demonstration:
        """The demonstration as seen from frame ``k``."""
        demo = self.demo
        return Demonstration(demo.times, seen_from(
            demo.manifold, self._poses_at(k, demo.times), demo.points), demo.manifold)

    def at(self, progress: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Flat points seen from each frame, shape (K, samples, p), and poses (samples, K, 7)."""
        demo = self.demo
        times = demo.times[0] + progress * demo.duration
        poses = np.stack([self._poses_at(k, times) for k in range(len(self._poses))], axis=1)
        points = demo.at(times)
        return np.array([seen_from(demo.manifold, poses[:, k], points).reshape(len(times), -1)
                         for k in range(len(self._poses))]), poses


class _Found(NamedTuple):
    """
    What was learned of several takes at equal progress.

    :ivar paths: of the takes in each frame, flat, shape (takes, K, samples, p)
    :ivar means: of the takes, shape (K, samples, p)
    :ivar poses: of the frames, shape (takes, samples, K, 7)
    :ivar scatter: of the takes around the means, shape (samples, K, F)
    :ivar deviation: of the prior, for each factor
    :ivar shares: shape (knots, K, F)
    :ivar leaves: progress until which the frame of the start alone counts
    """

    manifold: Manifold
    paths: np.ndarray
    means: np.ndarray
    poses: np.ndarray
    scatter: np.ndarray
    deviation: np.ndarray
    shares: np.ndarray
    leaves: float

    def with_prior(self, prior: float) -> _Found:
        """The same with the shares that follow from one of `PRIORS`."""
        manifold, count = self.manifold, len(self.paths)
        late = minimum_jerk(np.clip((np.linspace(0.0, 1.0, KNOTS) - self.leaves)
                                    / (1.0 - self.leaves), 0.0, 1.0))[:, None]
        precision = _precisions(self.scatter, self.deviation, count, prior, late)
        if count > 1 and len(self.means) > 2:
            ends = precision[:, [0, -1]] / precision[:, [0, -1]].sum(axis=1, keepdims=True)
            two = self._replace(means=self.means[[0, -1]], poses=self.poses[:, :, [0, -1]])
            dims = np.array([factor.dim for factor in manifold.factors])
            rest = _smoothed(sum(manifold.factor_distances(
                two.fused(i, ends), manifold.flat(placed(manifold, self.poses[i, :, 0], path[0])))
                ** 2 for i, path in enumerate(self.paths)) / dims)
            precision = _precisions(self.scatter, self.deviation, count, prior, late,
                                    _agreed(self.scatter, rest, dims, count))
        return self._replace(shares=_without_traces(precision))

    def fused(self, take: int, shares: np.ndarray) -> np.ndarray:
        """The means, fused where the frames are in a take; flat points."""
        manifold, knots = self.manifold, np.linspace(0.0, 1.0, len(shares))
        s = np.linspace(0.0, 1.0, self.means.shape[1])
        here = np.array([placed(manifold, self.poses[take, :, k], mean)
                         for k, mean in enumerate(self.means)])
        here = np.array([manifold.flat(manifold.continuous(manifold.unflat(np.concatenate(
            [here[0, :1], path]))))[1:] for path in here])
        widths = [part.stop - part.start for part in manifold.tangent_slices]
        share = np.array([[np.interp(s, knots, column) for column in one.T]
                          for one in np.moveaxis(shares, 1, 0)])
        share = np.repeat(np.moveaxis(share, 1, 2), widths, axis=2)
        point = manifold.unflat(here[-1])
        for _ in range(_ITERATIONS):
            way = sum(part * manifold.log_anyway(point, manifold.unflat(path))[0]
                      for part, path in zip(share, here))
            point = manifold.exp(point, way)
        return manifold.flat(point)

    def left(self, takes: list[_Take], progress: list[np.ndarray]) -> float:
        """Sum of the squared distances of the takes from what the skill would do."""
        total = 0.0
        for i, (take, own) in enumerate(zip(takes, progress)):
            points = take.demo.at(take.demo.times[0] + own * take.demo.duration)
            total += float(np.sum(self.manifold.factor_distances(
                self.fused(i, self.shares), self.manifold.flat(points)) ** 2))
        return total

    def expected(self, take: int, demo: Demonstration) -> Demonstration:
        """What the skill would do in the situation of a take."""
        path = self.fused(take, self.shares)
        return Demonstration(np.linspace(demo.times[0], demo.times[-1], len(path)),
                             self.manifold.unflat(path), self.manifold)


def _best_prior(takes: list[_Take], progress: list[np.ndarray], leaves: float) -> float:
    """The prior with which the skill of all takes but one is nearest to that one."""
    if len(takes) < 3:
        return OF_FEW
    errors = np.zeros(len(PRIORS))
    for i, (out, own) in enumerate(zip(takes, progress)):
        rest = [k for k in range(len(takes)) if k != i]
        _, poses = out.at(own)
        found = _found([takes[k] for k in rest], [progress[k] for k in rest], leaves)
        for j, prior in enumerate(PRIORS):
            errors[j] += found.with_prior(prior)._replace(poses=poses[None]).left([out], [own])
    return PRIORS[int(np.argmin(errors))]


def _found(takes: list[_Take], progress: list[np.ndarray], leaves: float) -> _Found:
    """
    Means, and shares of the frames.

    :param progress: of each take's own time at equal progress of the motion
    :param leaves: see `_Found`
    """
    manifold, count = takes[0].demo.manifold, len(takes)
    sampled = [take.at(own) for take, own in zip(takes, progress)]
    paths = np.array([points for points, _ in sampled])
    for k in range(paths.shape[1]):  # of ±q, the one that is near that of the first take
        for i in range(count):
            joined = np.concatenate([paths[0, k, :1], paths[i, k]])
            paths[i, k] = manifold.flat(manifold.continuous(manifold.unflat(joined)))[1:]
    means = np.array([mean_path(manifold, paths[:, k], paths[0, k])
                      for k in range(paths.shape[1])])
    dims = np.array([factor.dim for factor in manifold.factors])
    scatter = np.stack([_smoothed(sum(manifold.factor_distances(mean, path) ** 2
                                      for path in paths[:, k]) / dims)
                        for k, mean in enumerate(means)], axis=1)
    span = np.mean([manifold.factor_distances(np.ascontiguousarray(np.broadcast_to(
        path[0], path.shape)), path).max(axis=0) for path in paths[:, 0]], axis=0)
    deviation = np.maximum(PRIOR_DEVIATION * span,
                           [factor.goal_tolerance for factor in manifold.factors])
    return _Found(manifold, paths, means, np.array([poses for _, poses in sampled]), scatter,
                  deviation, np.empty(0), leaves).with_prior(OF_FEW)


def _smoothed(along: np.ndarray) -> np.ndarray:
    """
    Geometric mean over neighbouring moments.

    The arithmetic one would hide a moment at which an object decides behind those beside it.
    """
    floor = _FLOOR * along.max(axis=0) + _TINY
    return np.asarray(np.exp(gaussian_filter1d(
        np.log(along + floor), SMOOTHING * (len(along) - 1), axis=0, mode='nearest')))


def _precisions(scatter: np.ndarray, deviation: np.ndarray, takes: int, prior_takes: float,
                late: np.ndarray, agreed: np.ndarray | None = None) -> np.ndarray:
    """
    Precision of each frame along the motion.

    :param scatter: shape (samples, K, F)
    :param deviation: of the prior, for each factor
    :param late: weight of the frame of the goal, that of the start has the rest, shape (knots, 1)
    :param agreed: how surely the takes agree in the frames between, shape (knots, K - 2, F): these
        count with it, and the prior, which does not know them, without it
    :returns: shape (knots, K, F)
    """
    scatter = _at_knots(scatter)
    last, result = scatter.shape[1] - 1, np.zeros_like(scatter)
    prior = np.full_like(scatter[:, 0], prior_takes)
    if agreed is not None:
        prior *= 1.0 - (1.0 - LEAST_PRIOR) * agreed.max(axis=1)
    for k in range(last + 1):
        weight = 1.0 - late if k == 0 else late if k == last else np.ones_like(late)
        result[:, k] = weight * (prior + takes) / (prior * deviation ** 2
                                                   + weight * scatter[:, k])
    result[:, 1:last] *= 0.0 if agreed is None else agreed
    return result


def _at_knots(along: np.ndarray) -> np.ndarray:
    return np.asarray(along[np.linspace(0, len(along) - 1, KNOTS).round().astype(int)])


def _agreed(scatter: np.ndarray, rest: np.ndarray, dims: np.ndarray, takes: int) -> np.ndarray:
    """
    How surely the takes agree in the frames between: 0 where chance explains it, up to 1.

    :param rest: what the frames of start and goal leave of the takes, squared, as ``scatter``
    :returns: shape (knots, K - 2, F)
    """
    scatter, rest, freedom = _at_knots(scatter), _at_knots(rest), (takes - 1) * dims
    zero, full = (np.log(f_distribution.isf(p, freedom, freedom)) for p in (CHANCE, NO_CHANCE))
    # By the logarithm, in which the distribution of a ratio is symmetric.
    ratio = np.log(np.maximum(rest[:, None], _TINY) / np.maximum(scatter[:, 1:-1], _TINY))
    return np.asarray(minimum_jerk(np.clip((ratio - zero) / (full - zero), 0.0, 1.0)))


def _without_traces(precision: np.ndarray) -> np.ndarray:
    """
    Shares: normalised precisions, less a little, so that traces of a frame are exactly 0.

    The slope is continuous: cutting them off would cost acceleration.
    """
    shares = precision / precision.sum(axis=1, keepdims=True)
    u = np.clip((shares - LEAST_SHARE) / (FULL_SHARE - LEAST_SHARE), 0.0, 1.0)
    shares = ((FULL_SHARE - LEAST_SHARE) * u ** 3 * (1.0 - 0.5 * u)
              + np.maximum(shares - FULL_SHARE, 0.0))
    return np.asarray(shares / shares.sum(axis=1, keepdims=True))


def _as_shown(views: list[View], learn: Learn, settings: FitSettings) -> Skill:
    """The skill: the motion with the frames where they were shown, and the views."""
    first: Skill = views[0].skill
    model = replace(first, views=tuple(views)).with_frames({})
    times = np.linspace(0.0, model.duration, _MOST)
    shown = learn(Demonstration(times, Rollout(model).sample(times).points, model.manifold))
    return replace(shown, views=tuple(views), provenance=settings.provenance)
