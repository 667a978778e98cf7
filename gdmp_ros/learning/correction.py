"""
Correction of a skill by pushes: where the tool was pushed to, the path should have been.

A push is a measurement of the path, and the rest of the path is a measurement too: nobody pushed
there. The weights are conditioned on both, with smoothness as the prior. The variation of takes
would be another prior, but it would move the rest of the path.
"""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
import math
from typing import NamedTuple
import warnings

import numpy as np

from gdmp_ros.dmp.changes import between, with_functions
from gdmp_ros.dmp.development import Development
from gdmp_ros.dmp.primitive import frame_of
from gdmp_ros.dmp.rollout import Rollout
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import DataError, GdmpWarning, ParameterError
from gdmp_ros.learning.regression import smoother
from gdmp_ros.manifolds.quaternion import UnitQuaternion
from gdmp_ros.util.profiles import minimum_jerk

#: A deviation counts as a push if it is this large [m, rad] …
LEAST_M, LEAST_RAD = 0.01, 0.1
#: … and this many times as large as in the best quarter of the motion: arms do not follow exactly,
#: and a hand may hold the tool most of the time.
UNUSUAL, BEST = 3.0, 0.25
#: Largest acceleration that a correction should add on its way in and out [m/s², rad/s²].
GENTLE = 1.0
#: Part of its largest deviation from which a push is a measurement of the path; below, the hand
#: comes or goes.
HELD = 0.9
#: Shortest and longest way in and out, in durations.
SHORTEST, LONGEST = 0.03, 0.2
#: Basis functions that can describe a local correction.
FUNCTIONS = 100
#: A push that lasts longer than to this progress moves the goal.
AT_GOAL = 0.98
#: Longest time by which an arm follows late [s].
LONGEST_LAG_S = 0.2
#: Samples of progress.
SAMPLES = 401
#: Shortest wavelength of a correction, in durations.
WAVELENGTH = 0.04
#: Repetitions for the curvature of the space.
REPETITIONS = 3
#: Fewest samples of a motion.
FEWEST = 10


@dataclass(frozen=True)
class FollowedMotion:
    """
    How an arm followed a motion.

    :ivar progress: of the samples, not decreasing, shape ``(T,)``
    :ivar references: poses (x, y, z, qw, qx, qy, qz), shape ``(T, 7)``
    :ivar measured: the same
    """

    progress: np.ndarray
    references: np.ndarray
    measured: np.ndarray

    def __post_init__(self) -> None:
        count = len(self.progress)
        if count < FEWEST or self.references.shape != (count, 7) or (
                self.measured.shape != (count, 7)):
            raise DataError(f'followed motion: {count} samples of shapes {self.references.shape} '
                            f'and {self.measured.shape}, expected at least {FEWEST} poses')


class Push(NamedTuple):
    """
    A part of the motion in which the tool was pushed away.

    :ivar quantity: ``position`` or ``orientation``
    :ivar begin: progress
    :ivar end: progress
    :ivar largest: deviation [m, rad]
    :ivar at: progress of the largest deviation
    :ivar way: progress that the correction takes to come in, and to go out
    """

    quantity: str
    begin: float
    end: float
    largest: float
    at: float
    way: float


class Correction(NamedTuple):
    """
    A corrected primitive and what it was made of.

    :ivar progress: of the paths, shape ``(S,)``
    :ivar before: flat points of the path, shape ``(S, point_size)``
    :ivar after: the same with the correction
    """

    primitive: Skill
    pushes: list[Push]
    progress: np.ndarray
    before: np.ndarray
    after: np.ndarray


def correction(primitive: Skill, followed: FollowedMotion, *, least: float = LEAST_M,
               least_rotation: float = LEAST_RAD) -> Correction:
    """
    Correct a primitive of the tool where an arm was pushed.

    The motion may have had another start, goal and tempo: deviations from its reference count.

    :param least: smallest deviation that counts [m]
    :param least_rotation: the same [rad]
    :raises DataError: if there is no push
    :raises ParameterError: if the primitive is rhythmic, or not one of the tool
    """
    primitive.check_plain('a correction')
    primitive.check_ends('corrections')
    factors = primitive.manifold.factors
    if not (len(factors) > 1 and factors[0].is_flat and factors[0].size == 3
            and isinstance(factors[1], UnitQuaternion)):
        raise ParameterError(f'corrections are for skills of the tool, this one is on '
                             f'{primitive.manifold!r}')
    if not (math.isfinite(least) and least > 0.0 and math.isfinite(least_rotation)
            and least_rotation > 0.0):
        raise ParameterError(f'smallest deviations are {least!r} m and {least_rotation!r} rad, '
                             'expected numbers > 0')
    progress = np.linspace(0.0, 1.0, SAMPLES)
    ran = _ran(followed, progress)
    offset = _deviations(_without_lag(followed, primitive.duration), progress)
    # Of what was not run nothing is known.
    offset[~ran] = 0.0
    pushes = [push for quantity, part, limit in (('position', offset[:, :3], least),
                                                 ('orientation', offset[:, 3:], least_rotation))
              for push in _pushes(quantity, part, limit, ran, primitive.duration)]
    if not pushes:
        most = np.linalg.norm(offset[:, :3], axis=1).max()
        raise DataError(f'no push was found: the arm was at most {1e3 * most:.1f} mm from its '
                        f'reference, a push is at least {1e3 * least:.1f} mm and {UNUSUAL:g} '
                        'times what is usual in the best quarter of the motion')
    _tell_parts(ran, pushes, progress)
    before = _path(primitive, progress)
    shifts = _shifts(offset, pushes, progress)
    changed = with_functions(primitive, FUNCTIONS)
    if any(push.end >= AT_GOAL for push in pushes):
        goal = _moved(primitive.goal.reshape(1, -1), shifts[-1:])
        changed = between(changed, goal=goal.reshape(primitive.manifold.point_shape))
    changed = _fitted(changed, _moved(before, shifts), progress)
    return Correction(changed, pushes, progress, before, _path(changed, progress))


def _deviations(followed: FollowedMotion, progress: np.ndarray) -> np.ndarray:
    """Position [m] in the base, rotation vector [rad] in the tool, shape ``(S, 6)``."""
    rotation = UnitQuaternion()
    references, measured = followed.references, followed.measured
    offset = np.empty((len(measured), 6))
    offset[:, :3] = measured[:, :3] - references[:, :3]
    for row, (reference, pose) in enumerate(zip(references, measured)):
        # Half-angles in the canonical frame, which moves with the tool.
        frame = rotation.frame(reference[3:])
        offset[row, 3:] = 2.0 * rotation.log_in_frame(
            frame, rotation.align(pose[3:], reference[3:]))[0]
    # While the phase stands still several samples have the same progress.
    steps, place = np.unique(followed.progress, return_inverse=True)
    mean = np.zeros((len(steps), 6))
    np.add.at(mean, place, offset)
    mean /= np.bincount(place)[:, None]
    return np.column_stack([np.interp(progress, steps, column) for column in mean.T])


def _ran(followed: FollowedMotion, progress: np.ndarray) -> np.ndarray:
    """Which progress was run."""
    first, last = followed.progress[0], followed.progress[-1]
    near = progress[1]
    return np.asarray((progress >= first - near) & (progress <= last + near))


def _tell_parts(ran: np.ndarray, pushes: Sequence[Push], progress: np.ndarray) -> None:
    if not ran.all():
        warnings.warn(f'the motion was run from {progress[ran][0]:.0%} to '
                      f'{progress[ran][-1]:.0%}: the rest stays as it is', GdmpWarning,
                      stacklevel=3)
    for push in pushes:
        if push.begin < push.way:
            warnings.warn(f'a push begins at {push.begin:.0%} of the motion: from its start the '
                          f'correction needs until {push.way:.0%} to come in smoothly',
                          GdmpWarning, stacklevel=3)


def _without_lag(followed: FollowedMotion, duration: float) -> FollowedMotion:
    """
    The same with references that are as late as the arm is.

    An arm that follows late is behind its reference along the path. The lag is the median of what
    the samples tell, each as much as the reference moves there: a push is in a smaller part.
    """
    progress, first = np.unique(followed.progress, return_index=True)
    if len(progress) < FEWEST:
        return followed
    path = followed.references[first]
    away = followed.measured[first, :3] - path[:, :3]
    slope = np.gradient(path[:, :3], progress, axis=0)
    weight = (slope ** 2).sum(axis=1)
    moving = weight > 1e-4 * weight.max()
    if not moving.any() or weight.max() == 0.0:
        return followed
    behind = -(away * slope).sum(axis=1)[moving] / weight[moving]
    order = np.argsort(behind)
    share = np.cumsum(np.sqrt(weight[moving])[order])
    lag = float(behind[order][np.searchsorted(share, 0.5 * share[-1])])
    lag = min(max(lag, 0.0), LONGEST_LAG_S / duration)
    late = followed.progress - lag
    references = np.column_stack([np.interp(late, progress, column) for column in path.T])
    references[:, 3:] /= np.linalg.norm(references[:, 3:], axis=1)[:, None]
    return replace(followed, references=references)


def _pushes(quantity: str, offset: np.ndarray, least: float, ran: np.ndarray,
            duration: float) -> list[Push]:
    size, progress = np.linalg.norm(offset, axis=1), np.linspace(0.0, 1.0, SAMPLES)
    limit = max(least, UNUSUAL * float(np.quantile(size[ran], BEST)))
    edges = np.diff(np.concatenate([[0], (size > limit).astype(int), [0]]))
    result = []
    for first, last in zip(np.flatnonzero(edges > 0), np.flatnonzero(edges < 0) - 1):
        at = first + int(np.argmax(size[first:last + 1]))
        # A minimum-jerk way over d in T needs at most 5.77 d / T².
        length = math.sqrt(5.77 * size[at] / GENTLE) / duration
        result.append(Push(quantity, float(progress[first]), float(progress[last]),
                           float(size[at]), float(progress[at]),
                           min(max(length, SHORTEST), LONGEST)))
    return result


def _shifts(offset: np.ndarray, pushes: Sequence[Push], progress: np.ndarray) -> np.ndarray:
    """Shift of the path in the coordinates of `_deviations`."""
    return np.hstack([_shift(offset[:, columns], [
        push for push in pushes if push.quantity == quantity], progress)
        for quantity, columns in (('position', slice(0, 3)), ('orientation', slice(3, 6)))])


def _moved(points: np.ndarray, shifts: np.ndarray) -> np.ndarray:
    """Flat points with shifts, row by row."""
    moved, rotation = points.copy(), UnitQuaternion()
    moved[:, :3] += shifts[:, :3]
    for row, turn in enumerate(shifts[:, 3:]):
        frame = rotation.frame(points[row, 3:7])
        moved[row, 3:7] = rotation.exp(points[row, 3:7], rotation.from_frame(frame, 0.5 * turn))
    return moved


def _shift(offset: np.ndarray, pushes: Sequence[Push], progress: np.ndarray) -> np.ndarray:
    """Shift of the path: as measured while a push lasts, with smooth ways in and out."""
    size, edges = np.linalg.norm(offset, axis=1), []
    for push in pushes:
        held = (progress >= push.begin) & (progress <= push.end) & (size >= HELD * push.largest)
        edges.append(np.flatnonzero(held)[[0, -1]])
    result = np.zeros_like(offset)
    for number, (push, (first, last)) in enumerate(zip(pushes, edges)):
        own = np.zeros_like(offset)
        own[first:last + 1] = offset[first:last + 1]
        room_before = progress[first] - (progress[edges[number - 1][1]] if number else 0.0)
        room_after = (progress[edges[number + 1][0]] if number + 1 < len(edges) else 1.0
                      ) - progress[last]
        before, after = progress[:first], progress[last + 1:]
        into = minimum_jerk(np.clip(
            1.0 - (progress[first] - before) / min(push.way, room_before), 0.0, 1.0))
        own[:first] = into[:, None] * offset[first]
        # The start stays, and a goal that was not pushed.
        if push.begin < push.way:
            own *= minimum_jerk(np.clip(progress / push.way, 0.0, 1.0))[:, None]
        if push.end >= AT_GOAL:
            own[last + 1:] = offset[last]
            result += own
            continue
        out = minimum_jerk(np.clip(
            1.0 - (after - progress[last]) / min(push.way, room_after), 0.0, 1.0))
        own[last + 1:] = out[:, None] * offset[last]
        if push.end > 1.0 - push.way:
            own *= minimum_jerk(np.clip((1.0 - progress) / push.way, 0.0, 1.0))[:, None]
        result += own
    return result


def _fitted(primitive: Skill, target: np.ndarray, progress: np.ndarray) -> Skill:
    """The primitive with weights that make it pass where it should."""
    manifold = primitive.manifold
    base = Development(manifold, _path(primitive, progress), frame_of(primitive, primitive.start))
    goal, changed = base.ways_to(target), primitive
    weights = np.zeros((primitive.n_basis, manifold.tangent_size))
    maps = smoother(primitive.n_basis, primitive.gains, progress, WAVELENGTH)
    for _ in range(1 if manifold.is_flat else REPETITIONS):
        left = goal - base.ways_to(_path(changed, progress))
        weights = maps.weights @ (maps.motion @ weights + left)
        changed = replace(primitive, weights=primitive.weights + weights)
    return changed


def _path(primitive: Skill, progress: np.ndarray) -> np.ndarray:
    points = Rollout(primitive, duration=1.0).sample(progress).points
    return np.ascontiguousarray(points.reshape(len(progress), -1))
