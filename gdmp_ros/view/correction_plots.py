"""Figure of a correction: the path before and after."""
from __future__ import annotations

from matplotlib.figure import Figure

from gdmp_ros.dmp.skill import Skill
from gdmp_ros.learning.correction import Correction
from gdmp_ros.view import plots

_PUSHED = '#f2c14e'


def correction_figure(skill: Skill, found: Correction) -> Figure:
    """
    Draw position over time and the path from three sides; where the tool was pushed is shaded.

    :param skill: before the correction
    """
    figure, axes = plots.panels(2, 3, (4.0, 3.0))
    times = found.progress * skill.duration
    for panel, column in zip(axes[0], range(3)):
        for push in found.pushes:
            panel.axvspan(push.begin * skill.duration, push.end * skill.duration,
                          color=_PUSHED, alpha=0.3, lw=0.0)
        panel.plot(times, found.before[:, column], color='0.5', lw=1.3, label='before')
        panel.plot(times, found.after[:, column], color=plots.INK[0], lw=1.3, label='after')
        panel.set(xlabel='time [s]', ylabel=f'{"xyz"[column]} [m]')
    for panel, (first, second) in zip(axes[1], ((0, 1), (0, 2), (1, 2))):
        panel.plot(found.before[:, first], found.before[:, second], color='0.5', lw=1.3)
        panel.plot(found.after[:, first], found.after[:, second], color=plots.INK[0], lw=1.3)
        for push in found.pushes:
            inside = (found.progress >= push.begin) & (found.progress <= push.end)
            panel.plot(found.after[inside, first], found.after[inside, second], color=_PUSHED,
                       lw=5.0, alpha=0.5, zorder=1.0, label='pushed')
        panel.set(xlabel=f'{"xyz"[first]} [m]', ylabel=f'{"xyz"[second]} [m]')
        panel.set_aspect('equal', 'datalim')
    axes[0, 0].legend(fontsize=7)
    return figure
