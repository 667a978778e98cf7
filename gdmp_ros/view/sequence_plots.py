"""Figures of sequences."""
from __future__ import annotations

from matplotlib.figure import Figure
import numpy as np

from gdmp_ros.dmp.sequence import HoldStep, MotionStep, SkillSequence
from gdmp_ros.dmp.sequence_rollout import SequenceRollout
from gdmp_ros.errors import DataError
from gdmp_ros.view.skill_plots import draw_motion

#: Spacing of the samples [s], and most of them.
_STEP_S, _MOST = 0.01, 100_000
#: A step that waits for a signal gets it after so many cycles or seconds.
SIGNAL_AFTER = 2.0


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
