"""What demonstrations say about how to learn from them, and how to execute what was learned."""
from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from gdmp_ros.dmp import Demonstration, Rollout, Skill
from gdmp_ros.dmp.evaluation import deviation, mean_distance, reproduction_error
from gdmp_ros.errors import DataError
from gdmp_ros.learning.variance_stiffness import evenly, Mixture

#: Numbers of basis functions that are tried, and gains of a moving goal.
COUNTS = (8, 12, 16, 24, 32, 48, 64, 96, 128)
GOAL_GAINS = (2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0)
#: Details count down to this part of what demonstrations differ by …
DETAIL = 0.05
#: … and to this part of the span.
SMALL = 1e-3
#: A goal is switched half-way, by this part of the span; what acceleration it brings may be such
#: a part of what the motion has without it.
SWITCH_AT, SWITCH_BY, CALM = 0.5, 0.25, 0.5
#: The new goal counts as reached within this part of the switch.
REACHED = 0.05
#: Bounds of any stiffness that is suggested [N/m].
SOFTEST, STIFFEST = 20.0, 3000.0
#: A position that moves less than this stands still [m].
LEAST_SPAN = 1e-3
_DT = 0.005
#: Samples of a demonstration whose variance is looked at.
_PATH = 200


class BasisError(NamedTuple):
    """
    Mean distances / span with a number of basis functions.

    :ivar detail: from the motion that the most functions of `COUNTS` make
    :ivar shown: from what was learned from
    :ivar unseen: from a demonstration that was left out; NaN where there is only one
    """

    functions: int
    detail: float
    shown: float
    unseen: float


class GoalSwitch(NamedTuple):
    """
    What a goal switch does with a gain of the moving goal.

    :ivar acceleration: largest that the switch adds, as a part of the motion's own
    :ivar reached: time from the switch until the new goal's share of the motion is nearly all
        there, in durations
    """

    gain: float
    acceleration: float
    reached: float


class Speeds(NamedTuple):
    """Largest [m/s, rad/s, m/s²]."""

    speed: float
    turn_speed: float
    acceleration: float


def basis_errors(demonstrations: Sequence[Demonstration],
                 step: Callable[[], object] = lambda: None) -> list[BasisError]:
    """
    Try numbers of basis functions: on what was shown, and on each demonstration left out.

    :param step: called after each of `COUNTS`
    """
    result, several = [], len(demonstrations) > 1
    finest = Skill.learn(demonstrations, COUNTS[-1]).reproduce(_DT)
    manifold = demonstrations[0].manifold
    motion = Demonstration(finest.times, finest.points, manifold)
    for count in COUNTS:
        skill = Skill.learn(demonstrations, count)
        shown = reproduction_error(skill, demonstrations, _DT).mean()
        detail = mean_distance(deviation(skill, motion, finest.times)) / motion.span()
        unseen = np.nan
        if several:
            unseen = np.mean([reproduction_error(
                Skill.learn([*demonstrations[:i], *demonstrations[i + 1:]], count), one, _DT)
                for i, one in enumerate(demonstrations)])
        result.append(BasisError(count, detail, float(shown), float(unseen)))
        step()
    return result


def enough(errors: Sequence[BasisError]) -> int:
    """Fewest basis functions after which more add nothing but what differs anyway."""
    limit = max(SMALL, DETAIL * min(one.shown for one in errors))
    return next(one.functions for one in errors if one.detail <= limit)


def goal_switches(skill: Skill, span: float) -> list[GoalSwitch]:
    """
    Switch the goal of a pose skill half-way with different gains, along each axis both ways.

    :param span: of the position [m]
    :raises DataError: if the position hardly moves
    """
    if span < LEAST_SPAN:
        raise DataError(f'the position moves by {1e3 * span:.2g} mm, goals are switched from '
                        f'{1e3 * LEAST_SPAN:g} mm on')
    times = np.arange(0.0, 3.0 * skill.duration, _DT)
    usual = _peak(_positions(Rollout(skill), times))
    result = []
    for gain in GOAL_GAINS:
        changed = replace(skill, gains=replace(skill.gains, alpha_g=gain))
        worst, latest = 0.0, 0.0
        for direction in np.vstack([np.eye(3), -np.eye(3)]):
            goal = skill.goal.copy()
            goal[:3] += SWITCH_BY * span * direction
            before = times[times < SWITCH_AT * skill.duration]
            plain = _positions(Rollout(changed), times)
            rollout = Rollout(changed)
            first = _positions(rollout, before)
            rollout.retarget(goal)
            path = np.vstack([first, _positions(rollout, times[len(before):])])
            worst = max(worst, _peak(path - plain) / usual)
            left = np.linalg.norm(path - plain - (goal[:3] - skill.goal[:3]), axis=1)
            far = np.flatnonzero(left > REACHED * SWITCH_BY * span)
            end = times[far[-1]] if len(far) else 0.0
            latest = max(latest, (end - times[len(before)]) / skill.duration)
        result.append(GoalSwitch(gain, float(worst), float(latest)))
    return result


def calm_gain(switches: Sequence[GoalSwitch]) -> float:
    """Largest gain that is calm; the smallest if none is."""
    return max((one.gain for one in switches if one.acceleration <= CALM),
               default=switches[0].gain)


def speeds(demonstrations: Sequence[Demonstration], skill: Skill) -> Speeds:
    """Speeds of the skill's smooth path, at the tempo of the fastest demonstration."""
    fastest = skill.duration / min(one.duration for one in demonstrations)
    path = skill.reproduce(_DT)
    straight, turning = (np.linalg.norm(path.velocities[:, part], axis=1).max()
                         for part in (slice(0, 3), slice(3, 6)))
    times = np.arange(0.0, skill.duration, _DT)
    # Turns are half-angles on S³.
    return Speeds(float(fastest * straight), float(2.0 * fastest * turning),
                  float(fastest ** 2 * _peak(_positions(Rollout(skill), times))))


def stiffness_bounds(demonstrations: Sequence[Demonstration], force: float) -> tuple[float, float]:
    """
    Stiffness with which a deviation of two standard deviations costs ``force`` everywhere.

    Where demonstrations agree a small deviation is two of them, where they vary a large one.

    :param force: [N]
    :returns: softest and stiffest [N/m]
    :raises DataError: with fewer than two demonstrations
    """
    paths = [evenly(one.points[:, :3], one.times, _PATH) for one in demonstrations]
    covariances = Mixture(paths).covariances(np.linspace(0.0, 1.0, 100))
    away = 2.0 * np.sqrt(np.linalg.eigvalsh(covariances))
    low, high = force / away.max(), force / away.min()
    if not low < high:
        raise DataError('the demonstrations are equal: they say nothing about stiffness')
    return (float(np.clip(low, SOFTEST, 0.5 * STIFFEST)),
            float(np.clip(high, 2.0 * SOFTEST, STIFFEST)))


def _positions(rollout: Rollout, times: np.ndarray) -> np.ndarray:
    return np.asarray(rollout.sample(times).points[:, :3])


def _peak(path: np.ndarray) -> float:
    """Largest acceleration of a sampled path."""
    return float(np.linalg.norm(np.diff(path, 2, axis=0), axis=1).max() / _DT ** 2)
