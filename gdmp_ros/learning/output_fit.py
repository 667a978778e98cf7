"""
Fit of the motion: weights whose roll-out is nearest to the demonstrations.

The forcing term needs second derivatives, which amplify noise. Here the positions are fitted.
Along a demonstration the system is a critically damped filter of the way to its target; it is
linear in start velocity and weights (`gdmp_ros.dmp.response`). A penalty on the third
derivative keeps the motion smooth; generalised cross-validation chooses its strength for each
factor. Gauss-Newton steps with the real roll-out remove what the curvature of the space leaves.
"""
from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
import math
from typing import NamedTuple

import numpy as np

from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.development import Development
from gdmp_ros.dmp.primitive import frame_of
from gdmp_ros.dmp.response import response_to, responses
from gdmp_ros.dmp.rollout import Rollout
from gdmp_ros.dmp.segments import targets
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import CutLocusError, ParameterError
from gdmp_ros.learning.forcing_fit import with_published
from gdmp_ros.learning.lost_detail import Reproduced, warn_of_lost_detail
from gdmp_ros.learning.preparation import (
    averaged,
    blank_primitive,
    check_curvature,
    check_tolerance,
    common_segments,
    Endpoint,
    FitSettings,
    goal_of,
    own_segments,
    Samples,
    start_of,
    warn_tolerance,
)
from gdmp_ros.learning.regression import regression, Ridge, Rows, solve
from gdmp_ros.manifolds.euclidean import Euclidean

#: The motion begins with a velocity if it is this many times its standard error.
MOVING = 4.0
#: Gauss-Newton steps; a step that improves the error by less than this share is the last one.
STEPS, IMPROVEMENT = 4, 0.01
#: Grid of the roll-outs for these steps: 1 / COARSE of a duration.
COARSE = 1000
#: Largest number of basis functions.
MOST = 1000
#: Numbers of basis functions that are tried, and the score / best score that is good enough.
COUNTS, GOOD_ENOUGH = (10, 14, 20, 28, 40, 60, 85, 120, 170, 240), 1.05


class _Shape(NamedTuple):
    """
    A demonstration as the regression sees it.

    :ivar start: point
    :ivar goal: point
    :ivar frame: at the start
    :ivar progress: of the rows
    :ivar points: flat; after the end the goal
    :ivar targets: flat
    :ivar curve: the points, unrolled from the start
    :ivar to_target: from each point to its target, in the frame there
    """

    start: np.ndarray
    goal: np.ndarray
    frame: np.ndarray
    progress: np.ndarray
    points: np.ndarray
    targets: np.ndarray
    curve: np.ndarray
    to_target: np.ndarray


class OutputFit:
    """A prepared fit: makes primitives with any number of basis functions."""

    def __init__(self, demos: list[Demonstration], settings: FitSettings):
        """:param demos: see `gdmp_ros.learning.preparation.prepared`"""
        self._starts, self._goals = [start_of(d) for d in demos], [goal_of(d) for d in demos]
        starts, goals = self._starts, self._goals
        samples = [averaged(d) for d in demos]
        self._shown, self._settings = demos, settings
        self._manifold = manifold = demos[0].manifold
        segments = common_segments([sample.demonstration for sample in samples], settings)
        self._blank = replace(blank_primitive(
            demos, [start.point for start in starts], [goal.point for goal in goals], segments,
            settings), connection='parallel')
        self._weights = settings.weights(len(demos))
        self._rows = Rows(tuple(tuple(sample.progress.tolist()) for sample in samples),
                          tuple(self._weights), settings.rests)
        self._moving = self._which_move(starts)
        self._shapes = [self._shape(k, samples[k], starts[k].point, goals[k].point)
                        for k in range(len(samples))]
        self._first = [manifold.log_in_frame(shape.frame, shape.targets[0].reshape(
            manifold.point_shape))[0] for shape in self._shapes]
        self._goal = np.average(self._first, axis=0, weights=self._weights)
        self._wanted = np.vstack([self._rows.scale(k)[:, None] * self._linearised(k)
                                  for k in range(len(samples))])

    def primitive(self, count: int) -> Skill:
        """
        The primitive with ``count`` basis functions.

        :raises ParameterError: if it is less than 2 or more than `MOST`
        :raises DataError: if the space is curved too much for the motion
        """
        if not 2 <= count <= MOST:
            raise ParameterError(f"n_basis is {count}, expected 2 to {MOST} with fit='output'")
        fitted = self._fitted(count, self._wanted)
        residuals = self._wanted - self._predicted(fitted)
        if all(isinstance(factor, Euclidean) for factor in self._manifold.factors):
            # The responses are exact, and the connections are the same.
            self._warn(count, residuals)
            return replace(fitted, connection=self._settings.connection)
        predicted = _size(residuals)
        fitted, residuals = self._refined(fitted)
        rows = math.sqrt(len(self._wanted))
        if self._settings.split:
            check_curvature(_size(residuals) / rows, predicted / rows,
                            max(float(np.linalg.norm(shape.curve, axis=1).max())
                                for shape in self._shapes))
        self._warn(count, residuals)
        if self._settings.connection == 'parallel':
            return fitted
        return with_published(fitted, [(shape.start, shape.goal) for shape in self._shapes])

    def best_count(self, tolerance: float) -> int:
        """
        The smallest number of basis functions that cross-validation finds as good as any.

        Only the demonstrations count: a sudden stop after their end is nothing they show.

        :param tolerance: an error of this part of the span is good enough for a factor
        :raises ParameterError: unless it is between 0 and 1
        """
        check_tolerance(tolerance)
        spans = np.max([[np.abs(shape.curve[:, columns]).max() for columns in self._columns]
                        for shape in self._shapes], axis=0)
        most = max(len(self._wanted) // 3, COUNTS[0])
        scores = {count: self._scores(count) for count in COUNTS if count <= most}
        best = np.min(list(scores.values()), axis=0)
        limit = np.maximum(GOOD_ENOUGH * best, (tolerance * spans) ** 2) + np.finfo(float).tiny
        excess = {count: float(np.max(score / limit)) for count, score in scores.items()}
        # Good for every factor, or else the number that is nearest to it.
        chosen = next((count for count in excess if excess[count] <= 1.0),
                      min(excess, key=lambda count: excess[count]))
        error = float(np.max(np.sqrt(scores[chosen]) / np.maximum(spans, np.finfo(float).tiny)))
        if error > tolerance:
            warn_tolerance(chosen, error, tolerance)
        return chosen

    def _warn(self, count: int, residuals: np.ndarray) -> None:
        """Warn of detail that is lost."""
        if not np.isfinite(residuals).all():
            return
        demo, row = [], 0
        for number, shape in enumerate(self._shapes):
            scale, samples = self._rows.scale(number), len(self._rows.progress[number])
            own = residuals[row:row + samples] / scale[:samples, None]
            demo.append(Reproduced(shape.curve[:samples], own, self._noise(number, samples)))
            row += len(scale)
        warn_of_lost_detail(self._manifold, count, demo, self._settings.contexts is not None)

    def _noise(self, number: int, samples: int) -> tuple[float, ...]:
        """Noise of a demonstration at its ends, by factor, after the average of samples."""
        averaged_by = len(self._shown[number].times) // samples
        return tuple(max(pair) / math.sqrt(averaged_by) for pair in zip(
            self._starts[number].noise, self._goals[number].noise))

    # Preparation

    @property
    def _columns(self) -> list[slice]:
        return self._manifold.tangent_slices

    def _which_move(self, starts: list[Endpoint]) -> tuple[bool, ...]:
        """For each factor, whether the demonstrations begin with a velocity."""
        manifold, velocities = self._manifold, []
        for demonstration, start in zip(self._shown, starts):
            first = demonstration.points[0]
            tangent = manifold.from_frame(manifold.frame(first), start.velocity)
            velocities.append(manifold.to_frame(frame_of(self._blank, first), tangent))
        shares = self._weights / len(starts)
        velocity = shares @ np.array(velocities)
        error = np.sqrt(shares ** 2 @ np.array([start.velocity_error ** 2 for start in starts]))
        return tuple(bool(np.linalg.norm(velocity[columns])
                          > MOVING * np.linalg.norm(error[columns]))
                     for columns in self._columns)

    def _shape(self, number: int, samples: Samples, start: np.ndarray, goal: np.ndarray) -> _Shape:
        manifold, demo = self._manifold, samples.demonstration
        progress = self._rows.of(number)
        flat_goal = manifold.flat(goal)
        held = np.broadcast_to(flat_goal, (self._rows.holds(number), flat_goal.size))
        points = np.vstack([demo.flat_points, held])
        attracting = targets(manifold, own_segments(self._blank, demo), flat_goal, progress)
        frame = frame_of(self._blank, start)
        offset, _ = manifold.log_in_frame(frame, demo.points[0])
        development = Development(manifold, points, manifold.transport_frame(frame, offset),
                                  targets=attracting)
        return _Shape(start, goal, frame, progress, points, attracting,
                      development.unrolled + offset, development.to_target)

    def _linearised(self, number: int) -> np.ndarray:
        """What the responses add up to: the curve without the free motion to its target."""
        shape, gains = self._shapes[number], self._settings.gains
        first, response = self._first[number], responses(2, gains)
        # On a flat space the target does not move in these coordinates.
        moved = shape.curve + shape.to_target - first
        at_nodes = np.column_stack([np.interp(response.progress, shape.progress, column)
                                    for column in moved.T])
        followed = response_to(at_nodes, gains)
        free = np.column_stack([np.interp(shape.progress, response.progress, column)
                                for column in followed.T])
        to_goal = response.at(shape.progress)[0][:, None] * first
        return np.asarray(shape.curve - to_goal - free)

    # Regression

    def _scores(self, count: int) -> np.ndarray:
        demo = np.concatenate([np.arange(len(self._rows.of(k))) < len(self._rows.progress[k])
                               for k in range(len(self._shapes))])
        rows = replace(self._rows, rests=False)
        return np.array([item.score for item in self._solve(count, self._wanted[demo], rows)])

    def _solve(self, count: int, target: np.ndarray, rows: Rows) -> list[Ridge]:
        """The regression of each factor."""
        return [solve(regression(count, self._settings.gains, rows, moving), target[:, columns],
                      self._goal[columns])
                for columns, moving in zip(self._columns, self._moving)]

    def _fitted(self, count: int, target: np.ndarray) -> Skill:
        velocity = np.zeros(self._manifold.tangent_size)
        weights = np.zeros((count, self._manifold.tangent_size))
        for columns, moving, result in zip(self._columns, self._moving,
                                           self._solve(count, target, self._rows)):
            if moving:
                velocity[columns] = result.solution[0]
            weights[:, columns] = result.solution[-count:]
        return replace(self._blank, velocity=velocity, weights=weights)

    def _predicted(self, primitive: Skill) -> np.ndarray:
        """What the responses of a primitive add up to."""
        matrix = regression(primitive.n_basis, self._settings.gains, self._rows, True).matrix
        return np.asarray(matrix @ np.vstack([primitive.velocity, primitive.weights]))

    def _refined(self, primitive: Skill) -> tuple[Skill, np.ndarray]:
        """Gauss-Newton steps with the real roll-out, while they improve it; its residuals."""
        best, residuals = primitive, self._residuals(primitive)
        for _ in range(STEPS):
            before = _size(residuals)
            if before == math.inf:
                break
            step = self._fitted(best.n_basis, self._predicted(best) + residuals)
            after = self._residuals(step)
            if not _size(after) < (1.0 - IMPROVEMENT) * before:
                break
            best, residuals = step, after
        return best, residuals

    def _residuals(self, primitive: Skill) -> np.ndarray:
        """
        From the roll-out to the demonstrations, in its frame; scaled rows.

        Infinite if the roll-out jumps or is held.
        """
        try:
            return np.vstack([scale[:, None] * offset
                              for scale, offset in self._deviations(primitive)])
        except CutLocusError:
            return np.full(self._wanted.shape, np.inf)

    def _deviations(self, primitive: Skill) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        manifold = self._manifold
        primitive = replace(primitive, steps=COARSE)
        for number, shape in enumerate(self._shapes):
            rollout = Rollout(primitive, start=shape.start, goal=shape.goal, duration=1.0)
            path = rollout.sample(shape.progress).points.reshape(len(shape.progress), -1)
            offset, _ = manifold.log_in_frame(shape.frame, path[0].reshape(manifold.point_shape))
            deviation = Development(manifold, path, manifold.transport_frame(
                shape.frame, offset)).ways_to(shape.points)
            if 'held' in rollout.flags:
                deviation[:] = np.inf
            yield self._rows.scale(number), deviation


def _size(residuals: np.ndarray) -> float:
    """Root of the sum of squares; infinite if a roll-out was not."""
    size = float(np.linalg.norm(residuals))
    return size if math.isfinite(size) else math.inf
