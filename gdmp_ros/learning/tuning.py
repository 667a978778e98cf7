"""Settings suggested by demonstrations: basis functions, goal gain, speeds, stiffness."""
from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple
import warnings

import numpy as np

from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.evaluation import mean_distance, reproduction_error
from gdmp_ros.dmp.primitive import Gains
from gdmp_ros.dmp.rollout import Rollout
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import DataError, GdmpWarning
from gdmp_ros.learning.alignment import aligned
from gdmp_ros.learning.output_fit import OutputFit
from gdmp_ros.learning.preparation import FitSettings, prepared
from gdmp_ros.learning.stiffness import AGREEMENT, covariances_of_takes

#: Numbers of basis functions that are tried.
COUNTS = (8, 12, 16, 24, 32, 48, 64, 96, 128)
#: Gains of a moving goal that are tried.
GOAL_GAINS = (2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0)
#: Details matter down to this fraction of the difference between demonstrations …
DETAIL = 0.05
#: … and to this fraction of the span.
SMALL_DETAIL = 1e-3
#: A goal switch is tried at this fraction of the duration, by this fraction of the span.
SWITCH_AT, SWITCH_BY = 0.5, 0.25
#: Largest acceleration that a goal switch may add, relative to that of the motion.
SMOOTH_SWITCH = 0.5
#: The new goal counts as reached when this fraction of the switch is left.
REACHED = 0.05
#: Bounds of a suggested stiffness [N/m].
SMALLEST_STIFFNESS, LARGEST_STIFFNESS = 20.0, 3000.0
#: A position with a smaller span does not move [m].
SMALLEST_SPAN = 1e-3
_DT = 0.005


class BasisError(NamedTuple):
    """
    Mean distances / span with a number of basis functions.

    :ivar detail: from the motion with the most functions of `COUNTS`
    :ivar training: from the demonstrations that were learned from
    :ivar unseen: from a demonstration that was left out; NaN if there is only one
    """

    functions: int
    detail: float
    training: float
    unseen: float


class GoalSwitch(NamedTuple):
    """
    Effect of a goal switch with one gain of the moving goal.

    :ivar acceleration: largest that the switch adds, relative to that of the motion
    :ivar reached: time until the new goal is reached, in durations
    """

    gain: float
    acceleration: float
    reached: float


class Speeds(NamedTuple):
    """Largest speeds and acceleration of a motion [m/s, rad/s, m/s²]."""

    speed: float
    angular_speed: float
    acceleration: float


def basis_errors(demonstrations: Sequence[Demonstration],
                 step: Callable[[], object] = lambda: None) -> list[BasisError]:
    """
    Try numbers of basis functions, on the demonstrations and on each one left out.

    :param step: called after each of `COUNTS`
    """
    result = []
    # Aligned once, and as demonstrated up to the end.
    demonstrations = aligned(demonstrations)
    fit, left_out = _fit(demonstrations), []
    if len(demonstrations) > 1:
        left_out = [(demo, _fit([*demonstrations[:i], *demonstrations[i + 1:]]))
                    for i, demo in enumerate(demonstrations)]
    finest = fit(COUNTS[-1]).reproduce(_DT)
    manifold = demonstrations[0].manifold
    motion = Demonstration(finest.times, finest.points, manifold)
    for count in COUNTS:
        skill = fit(count)
        training = reproduction_error(skill, demonstrations, _DT).mean()
        path = skill.reproduce(_DT).points.reshape(len(finest.times), -1)
        detail = mean_distance(manifold.factor_distances(motion.flat_points, path)) / motion.span()
        unseen = [reproduction_error(other(count), item, _DT)[0] for item, other in left_out]
        result.append(BasisError(count, detail, float(training),
                                 float(np.mean(unseen)) if unseen else float('nan')))
        step()
    return result


def _fit(demos: Sequence[Demonstration]) -> Callable[[int], Skill]:
    fit = OutputFit(prepared(demos, None), FitSettings(Gains(), 'parallel', end='moving'))

    def make(count: int) -> Skill:
        # What each number of functions loses is the result itself.
        with warnings.catch_warnings():
            warnings.simplefilter('ignore', GdmpWarning)
            return fit.primitive(count)
    return make


def sufficient_basis(errors: Sequence[BasisError]) -> int:
    """Fewest basis functions whose missing detail is small against the demonstrations' spread."""
    limit = max(SMALL_DETAIL, DETAIL * min(error.training for error in errors))
    return next(error.functions for error in errors if error.detail <= limit)


def goal_switches(skill: Skill, span: float) -> list[GoalSwitch]:
    """
    Switch the goal of a pose skill with different gains, along each axis in both directions.

    :param span: of the position [m]
    :raises DataError: if the position hardly moves
    """
    if span < SMALLEST_SPAN:
        raise DataError(f'the position moves by {1e3 * span:.2g} mm, goal switches are tried from '
                        f'{1e3 * SMALLEST_SPAN:g} mm on')
    times = np.arange(0.0, 3.0 * skill.duration, _DT)
    usual = _peak(_positions(Rollout(skill), times))
    result = []
    for gain in GOAL_GAINS:
        changed = replace(skill, gains=replace(skill.gains, alpha_g=gain))
        plain = _positions(Rollout(changed), times)
        tried = [_switched(changed, plain, times, SWITCH_BY * span * direction)
                 for direction in np.vstack([np.eye(3), -np.eye(3)])]
        result.append(GoalSwitch(gain, max(added for added, _ in tried) / usual,
                                 max(reached for _, reached in tried) / skill.duration))
    return result


def _switched(skill: Skill, plain: np.ndarray, times: np.ndarray, offset: np.ndarray
              ) -> tuple[float, float]:
    """
    Switch the goal by ``offset``.

    :param plain: positions without the switch
    :returns: acceleration that the switch adds [m/s²], time until the goal is reached [s]
    """
    goal = skill.goal.copy()
    goal[:3] += offset
    before = int(np.sum(times < SWITCH_AT * skill.duration))
    rollout = Rollout(skill)
    first = _positions(rollout, times[:before])
    rollout.retarget(goal)
    path = np.vstack([first, _positions(rollout, times[before:])])
    left = np.linalg.norm(path - plain - offset, axis=1)
    late = np.flatnonzero(left > REACHED * np.linalg.norm(offset))
    end = times[late[-1]] if len(late) else 0.0
    return _peak(path - plain), float(end - times[before])


def smooth_gain(switches: Sequence[GoalSwitch]) -> float:
    """Largest gain whose goal switch is smooth (`SMOOTH_SWITCH`); the smallest if none is."""
    return max((switch.gain for switch in switches if switch.acceleration <= SMOOTH_SWITCH),
               default=switches[0].gain)


def speeds(demonstrations: Sequence[Demonstration], skill: Skill) -> Speeds:
    """Largest speeds of the skill's path, at the tempo of the fastest demonstration."""
    fastest = skill.duration / min(demo.duration for demo in demonstrations)
    path = skill.reproduce(_DT)
    linear, half_angular = (np.linalg.norm(path.velocities[:, part], axis=1).max()
                            for part in (slice(0, 3), slice(3, 6)))
    times = np.arange(0.0, skill.duration, _DT)
    # Velocities on S³ are half-angles.
    return Speeds(float(fastest * linear), float(2.0 * fastest * half_angular),
                  float(fastest ** 2 * _peak(_positions(Rollout(skill), times))))


def stiffness_bounds(demonstrations: Sequence[Demonstration], force: float) -> tuple[float, float]:
    """
    Stiffness range in which a deviation of two standard deviations costs the same force.

    :param force: [N]
    :returns: smallest and largest stiffness [N/m]
    :raises DataError: with fewer than two demonstrations
    """
    variances = np.linalg.eigvalsh(covariances_of_takes(demonstrations))
    deviations = 2.0 * np.sqrt(np.maximum(variances, 0.0) + AGREEMENT ** 2)
    if variances.max() < AGREEMENT ** 2:
        raise DataError('the demonstrations are equal: they do not determine a stiffness')
    low, high = force / deviations.max(), force / deviations.min()
    return (float(np.clip(low, SMALLEST_STIFFNESS, 0.5 * LARGEST_STIFFNESS)),
            float(np.clip(high, 2.0 * SMALLEST_STIFFNESS, LARGEST_STIFFNESS)))


def _positions(rollout: Rollout, times: np.ndarray) -> np.ndarray:
    return np.asarray(rollout.sample(times).points[:, :3])


def _peak(path: np.ndarray) -> float:
    """Largest acceleration of a sampled path."""
    return float(np.linalg.norm(np.diff(path, 2, axis=0), axis=1).max() / _DT ** 2)
