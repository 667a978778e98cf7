"""The switched stiffness over time: its error to both goals and its elements."""
from __future__ import annotations

from typing import Any

import numpy as np

from experiments.paper import fig9
from experiments.paper.experiment import Data, Settings, Verdict
from gdmp_ros.view import plots

CLAIM = ('The error between the stiffness and its new goal converges to zero; without a switch, '
         'the error to the demonstrated goal does.')
SOURCE = '[GDMP] Fig. 10, section 5.5'


def run(settings: Settings) -> Data:
    """The runs of Fig. 9."""
    return fig9.run(settings)


def verdict(data: Data) -> Verdict:
    """Errors at the end; before it, that to the new goal grows by at most 10 %."""
    old = data['shown'][-1, 2:].reshape(2, 2)
    to_new = fig9.goal_distances(data['switched_wanted'][::10], fig9.NEW_GOAL)
    to_old = fig9.goal_distances(data['straight_wanted'][::10], old)
    at = round(fig9.SWITCH * fig9.DURATION / fig9.PERIOD / 10)
    measured = {'error_to_new_goal_at_switch': to_new[at], 'error_to_new_goal_at_end': to_new[-1],
                'error_to_goal_at_end_without_switch': to_old[-1],
                'largest_error_to_new_goal_after_switch': to_new[at:].max()}
    holds = to_new[-1] < 0.0025 and to_old[-1] < 0.0025 and to_new[at:].max() < 1.1 * to_new[at]
    return Verdict(bool(holds), measured)


def draw(data: Data) -> dict[str, Any]:
    """Errors above, elements below."""
    figure, axes = plots.panels(2, 1, (7.5, 3.2))
    times, old = data['times'][::10], data['shown'][-1, 2:].reshape(2, 2)
    curves = np.column_stack([
        fig9.goal_distances(data['switched_wanted'][::10], fig9.NEW_GOAL),
        fig9.goal_distances(data['switched_wanted'][::10], old),
        fig9.goal_distances(data['straight_wanted'][::10], old)])
    plots.series(axes[0, 0], times, curves, ['switched, to the new goal', 'switched, to the old '
                                             'goal', 'not switched, to its goal'],
                 'stiffness error [1]')
    # Rows of a point: x, y, K11, K12, K21, K22.
    keep = [2, 3, 5]
    elements = np.column_stack([data['switched_wanted'][::10][:, keep],
                                data['straight_wanted'][::10][:, keep]])
    plots.series(axes[1, 0], times, elements, ['K11', 'K12', 'K22', 'K11, not switched',
                                               'K12, not switched', 'K22, not switched'],
                 'stiffness [N/m]')
    axes[1, 0].plot(data['shown_times'], data['shown'][:, keep], color='0.5', lw=0.6)
    axes[1, 0].plot([], [], color='0.5', lw=0.6, label='demonstration')
    for panel in axes[:, 0]:
        panel.axvline(fig9.SWITCH * fig9.DURATION, color='0.4', lw=0.8, label='goal switched')
        panel.legend(fontsize=7, ncols=2)
    return {'fig10': figure}
