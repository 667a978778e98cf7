"""Figures of demonstrations, skills, corrections and sequences."""
from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, TYPE_CHECKING

from matplotlib.figure import Figure
import numpy as np

from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.primitive import Trajectory
from gdmp_ros.dmp.sequence import HoldStep, MotionStep, SequenceRollout, SkillSequence
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import DataError
from gdmp_ros.learning.correction import Correction
from gdmp_ros.learning.report import cycle_takes
from gdmp_ros.learning.tuning import BasisError, GoalSwitch
from gdmp_ros.manifolds import Manifold
from gdmp_ros.view import plots
from gdmp_ros.view.style import stiffness_of

if TYPE_CHECKING:
    from gdmp_ros.sim.path_check import PathCheck


#: Skills that are drawn for a band.
SAMPLES = 60
_UNITS = {'position': ' [m]', 'stiffness': ' [N/m, Nm/rad]', 'wrench': ' [N, Nm]'}
_PUSHED = '#f2c14e'
#: Spacing of the samples [s], and most of them.
_STEP_S, _MOST = 0.01, 100_000
#: A step that waits for a signal gets it after so many cycles or seconds.
SIGNAL_AFTER = 2.0


def takes_figure(demos: Sequence[Demonstration], names: Sequence[str],
                 outliers: Sequence[bool]) -> Figure:
    """Draw takes of one motion from above, from the side and over time; outliers are dashed."""
    figure, axes = plots.panels(1, 3, (4.2, 3.6))
    above, side, timed = axes[0]
    for i, (take, name, outlier) in enumerate(zip(demos, names, outliers)):
        style = {'color': plots.INK[i % len(plots.INK)], 'ls': '--' if outlier else '-',
                 'lw': 1.3, 'label': name}
        x, y, z = take.points[:, :3].T
        above.plot(x, y, **style)
        side.plot(x, z, **style)
        timed.plot(take.times, np.linalg.norm(take.points[:, :3] - take.points[0, :3], axis=1),
                   **style)
    above.set(xlabel='x [m]', ylabel='y [m]', title='from above')
    side.set(xlabel='x [m]', ylabel='z [m]', title='from the side')
    timed.set(xlabel='time [s]', ylabel='distance from the start [m]', title='over time')
    for each in (above, side):
        each.set_aspect('equal', 'datalim')
    timed.legend(fontsize=7)
    return figure


def tuning_figure(errors: Sequence[BasisError], count: int, switches: Sequence[GoalSwitch],
                  gain: float) -> Figure:
    """Draw errors by number of basis functions, and goal switches by gain."""
    figure, axes = plots.panels(1, 2, (4.6, 3.4))
    left, right = axes[0]
    counts = [error.functions for error in errors]
    left.loglog(counts[:-1], [error.detail for error in errors[:-1]], '^:', color=plots.INK[2],
                label='difference from the most functions')
    left.loglog(counts, [error.training for error in errors], 'o-', color=plots.INK[0],
                label='error on the demonstrations')
    left.loglog(counts, [error.unseen for error in errors], 's--', color=plots.INK[1],
                label='error on one left out')
    left.axvline(count, color='0.5', lw=0.8, label=f'suggested: {count}')
    left.set(xlabel='basis functions [1]', ylabel='mean distance / span [1]')
    left.legend()
    gains = [switch.gain for switch in switches]
    right.plot(gains, [switche.acceleration for switche in switches], 'o-', color=plots.INK[0],
               label='added / own acceleration [1]')
    right.plot(gains, [switche.reached for switche in switches], 's--', color=plots.INK[1],
               label='new goal reached after [durations]')
    right.axvline(gain, color='0.5', lw=0.8, label=f'suggested: {gain:g}')
    right.set(xlabel='goal gain alpha_g [1]', ylim=(0.0, None))
    right.legend()
    return figure


def check_figure(result: PathCheck, positions: np.ndarray) -> Figure:
    """
    Draw where an arm can follow a path, and how near it comes to its limits.

    :param positions: of the path [m], shape ``(T, 3)``
    """
    figure, axes = plots.panels(2, 3, (4.0, 3.0))
    for panel, (first, second) in zip(axes[0], ((0, 1), (0, 2), (1, 2))):
        panel.plot(positions[:, first], positions[:, second], color=plots.INK[0], lw=1.3,
                   label='path')
        wrong = np.where(result.wrong[:, None], positions, np.nan)
        panel.plot(wrong[:, first], wrong[:, second], '.', color='#d01010', label='not followed')
        panel.set(xlabel=f'{"xyz"[first]} [m]', ylabel=f'{"xyz"[second]} [m]')
        panel.set_aspect('equal', 'datalim')
    axes[0, 0].legend(fontsize=7)
    for panel, margin in zip(axes[1], result.margins):
        panel.plot(result.times, margin.values, color=plots.INK[0], lw=1.3)
        panel.axhline(margin.least, color='#d01010', lw=0.8, ls='--', label='limit')
        panel.set(xlabel='time [s]', ylabel=margin.label)
        panel.legend(fontsize=7)
    return figure


def _band(skill: Skill, trajectory: Trajectory) -> np.ndarray | None:
    """Lower and upper limits of 95 % of drawn skills, flat points, shape ``(2, T, size)``."""
    distribution = skill.distribution
    if distribution is None:
        return None
    rng, drawn = np.random.default_rng(0), []
    for _ in range(SAMPLES):
        result = distribution.sample(rng).rollout(duration=skill.duration).sample(trajectory.times)
        drawn.append([skill.manifold.align(point, near).reshape(-1)
                      for point, near in zip(result.points, trajectory.points)])
    return np.asarray(np.percentile(drawn, [2.5, 97.5], axis=0))


class DrawnMotion(NamedTuple):
    """
    A motion that has been drawn.

    :ivar factors: axes of each factor over time, and the columns of flat points that they show
    :ivar space: axes of the path; None unless the first factor is a position
    """

    figure: Figure
    factors: list[tuple[Any, list[int]]]
    space: Any


def draw_motion(manifold: Manifold, times: np.ndarray, points: np.ndarray) -> DrawnMotion:
    """
    Draw every factor over time, and the path with its stiffness if the first one is a position.

    :param points: shape ``(T, *point_shape)``
    """
    flat, count = points.reshape(len(points), -1), len(manifold.factors)
    spatial = manifold.factors[0].is_flat and manifold.factors[0].size == 3
    figure = Figure(figsize=(11 if spatial else 7, 2.4 * count + 0.6), layout='constrained')
    grid, panels = figure.add_gridspec(count, 2 if spatial else 1), []
    for i, (name, factor) in enumerate(zip(manifold.names, manifold.factors)):
        labels, columns = zip(*factor.components)
        first = int(manifold.factor_table[i]['point'])
        places = [first + column for column in columns]
        axes = figure.add_subplot(grid[i, 0])
        plots.series(axes, times, flat[:, places], list(labels), f'{name}{_UNITS.get(name, "")}')
        panels.append((axes, places))
    space = None
    if spatial:
        space = figure.add_subplot(grid[:, 1], projection='3d')
        plots.path_with_ellipsoids(space, flat[:, :3], stiffness_of(manifold, points))
    return DrawnMotion(figure, panels, space)


def skill_figure(skill: Skill, demos: Sequence[Demonstration] = ()) -> Figure:
    """
    Draw a roll-out: every factor over time, and the path if the first factor is a position.

    For a skill of several takes, bands that contain 95 % of `SAMPLES` skills like the takes. Of a
    skill with task frames, how much each frame matters.

    :param demos: demonstrations to draw below it, stretched to its duration; of a rhythmic skill
        all samples by their phase, on the skill's manifold
    :raises DataError: if one is on another manifold
    """
    manifold = skill.manifold
    for demo in demos:
        if demo.manifold.factors[0] != manifold.factors[0]:
            raise DataError(f'the skill is on {skill.manifold!r}, a demonstration on '
                            f'{demo.manifold!r}')
    trajectory = skill.reproduce(skill.duration / 500)
    same = [demo for demo in demos if demo.manifold == manifold] if skill.rhythmic else []
    takes = cycle_takes(skill, same) if same else []
    drawn = draw_motion(manifold, trajectory.times, trajectory.points)
    band = _band(skill, trajectory)
    for axes, places in drawn.factors:
        for take in takes:
            axes.plot(take.progress % 1.0 * skill.duration, take.points[:, places], '.',
                      color='0.7', ms=1.0, zorder=1.0)
        for item in demos if not takes else ():
            if max(places) < item.manifold.point_size:  # a take may have no stiffness
                times = (item.times - item.times[0]) * skill.duration / item.duration
                axes.plot(times, item.flat_points[:, places], color='0.7', lw=0.7, zorder=1.0)
        if band is not None:
            plots.bands(axes, trajectory.times, band[:, :, places])
    if skill.views:
        _draw_shares(skill, [axes for axes, _ in drawn.factors])
    if drawn.space is not None:
        for take in takes:
            drawn.space.plot(*take.points[:, :3].T, '.', color='0.7', ms=1.0, zorder=1.0)
        for item in demos if not takes else ():
            drawn.space.plot(*item.flat_points[:, :3].T, color='0.7', lw=0.7, zorder=1.0)
    return drawn.figure


def _draw_shares(skill: Skill, panels: Sequence[Any]) -> None:
    """Draw how much each task frame matters along the motion, over every factor."""
    for factor, axes in enumerate(panels):
        beside = axes.twinx()
        for number, view in enumerate(skill.views):
            times = np.linspace(0.0, skill.duration, len(view.shares))
            beside.plot(times, view.shares[:, factor], ls=(0, (2 + 2 * number, 1)), lw=0.9,
                        color='0.3', label=f'share of {view.name}')
        beside.set(ylim=(-0.02, 1.5), yticks=[0.0, 0.5, 1.0])
        beside.legend(fontsize=6, loc='upper left')


def correction_figure(skill: Skill, result: Correction) -> Figure:
    """
    Draw position over time and the path from three sides; where the tool was pushed is shaded.

    :param skill: before the correction
    """
    figure, axes = plots.panels(2, 3, (4.0, 3.0))
    times = result.progress * skill.duration
    for panel, column in zip(axes[0], range(3)):
        for push in result.pushes:
            panel.axvspan(push.begin * skill.duration, push.end * skill.duration,
                          color=_PUSHED, alpha=0.3, lw=0.0)
        panel.plot(times, result.before[:, column], color='0.5', lw=1.3, label='before')
        panel.plot(times, result.after[:, column], color=plots.INK[0], lw=1.3, label='after')
        panel.set(xlabel='time [s]', ylabel=f'{"xyz"[column]} [m]')
    for panel, (first, second) in zip(axes[1], ((0, 1), (0, 2), (1, 2))):
        panel.plot(result.before[:, first], result.before[:, second], color='0.5', lw=1.3)
        panel.plot(result.after[:, first], result.after[:, second], color=plots.INK[0], lw=1.3)
        for push in result.pushes:
            inside = (result.progress >= push.begin) & (result.progress <= push.end)
            panel.plot(result.after[inside, first], result.after[inside, second], color=_PUSHED,
                       lw=5.0, alpha=0.5, zorder=1.0, label='pushed')
        panel.set(xlabel=f'{"xyz"[first]} [m]', ylabel=f'{"xyz"[second]} [m]')
        panel.set_aspect('equal', 'datalim')
    axes[0, 0].legend(fontsize=7)
    return figure


def sequence_figure(sequence: SkillSequence) -> Figure:
    """
    Draw a roll-out of a sequence: every factor over time, step by step, and the path.

    A step that waits for a signal gets it after `SIGNAL_AFTER` cycles or seconds.

    :raises DataError: if the skills are on different manifolds, or it lasts too long
    """
    rollout = SequenceRollout(sequence)
    times: list[float] = []
    points: list[np.ndarray] = []
    marks: list[tuple[float, str]] = []
    began = -1
    while not rollout.finished:
        state, step = rollout.advance(_STEP_S), rollout.course.step
        times.append(state.time)
        points.append(state.point.copy())
        if step is not None and rollout.course.index != began:
            began = rollout.course.index
            marks.append((state.time, step.name))
        if isinstance(step, (MotionStep, HoldStep)) and step.until and _waited(
                rollout, step, state.time - marks[-1][0]):
            rollout.signal(step.until)
        if len(times) >= _MOST:
            raise DataError(f'{sequence.name}: it lasts more than {_MOST * _STEP_S:g} s, too long '
                            'to be drawn')
    drawn = draw_motion(rollout.manifold, np.array(times), np.array(points))
    for number, (axes, _) in enumerate(drawn.factors):
        for time, name in marks:
            axes.axvline(time, color='0.6', lw=0.7)
            if number == 0:
                axes.text(time, 0.02, name, fontsize=7, rotation=90, va='bottom',
                          transform=axes.get_xaxis_transform())
    return drawn.figure


def _waited(rollout: SequenceRollout, step: MotionStep | HoldStep, seconds: float) -> bool:
    """Whether a step has waited long enough for its signal."""
    if isinstance(step, MotionStep) and rollout.rollout is not None:
        return rollout.rollout.progress >= SIGNAL_AFTER
    return seconds >= SIGNAL_AFTER
