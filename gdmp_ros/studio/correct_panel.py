"""The panel for corrections: push the arm while it moves, see the new path, keep or undo it."""
from __future__ import annotations

import numpy as np

from gdmp_ros.errors import DataError
from gdmp_ros.studio.app import Studio
from gdmp_ros.studio.robot import RobotView
from gdmp_ros.studio.run_panel import RunPanel
from gdmp_ros.studio.shown_motion import of_skill

PUSH = 'push'
_MOVING = ('moving', 'paused')


class CorrectPanel:
    """Corrects the chosen skill by the pushes of its last motion."""

    def __init__(self, studio: Studio, run: RunPanel):
        self._studio, self._run, gui = studio, run, studio.server.gui
        gui.add_markdown('Start the skill, push the tool to where its path should be (drag the '
                         'handle *push*), and look at the correction. It is a change like others: '
                         'save the skill to keep it.')
        self._pushes = gui.add_checkbox('push the arm while it moves', False)
        self._pushes.on_update(studio.later(self.release))
        gui.add_button('correct by the last motion').on_click(studio.later(self._correct))
        gui.add_button('undo the correction').on_click(studio.later(self._undo))
        self._text = gui.add_markdown('')
        self._pulled = False
        studio.on_view.append(self._show)
        studio.on_motion.append(self._show_before)

    def _drag(self, pose: np.ndarray, released: bool) -> None:
        self._pulled = not released
        robot = self._studio.robot
        self._studio.jobs.put(lambda: robot.pull(None if released else pose),
                              None if released else PUSH)

    def release(self) -> None:
        """Let go of the arm."""
        if self._pulled or not self._studio.guided:
            self._pulled = False
            self._studio.robot.pull(None)

    def _correct(self) -> None:
        studio, bench = self._studio, self._studio.bench
        if not bench.chosen or self._run.executed != bench.chosen:
            raise DataError('the chosen skill has not been executed: start it, and push the arm')
        followed = studio.robot.followed()
        pushes = bench.correct(followed)
        studio.redraw()
        self._text.content = '  \n'.join(
            f'{one.quantity} at {100 * one.at:.0f} %: '
            + (f'{1e3 * one.largest:.0f} mm' if one.quantity == 'position'
               else f'{one.largest:.2f} rad') for one in pushes)

    def _undo(self) -> None:
        self._studio.bench.undo_correction()
        self._text.content = ''
        self._studio.redraw()

    def _show_before(self) -> None:
        """Draw the path before the corrections."""
        bench, scene = self._studio.bench, self._studio.scene
        corrected = bool(bench.chosen and bench.changes.corrections)
        scene.line('before', of_skill(bench.skill).poses[:, :3] if corrected else None,
                   (150, 150, 150))
        if not corrected:
            self._text.content = ''

    def _show(self, view: RobotView | None) -> None:
        if view is None:
            return
        scene = self._studio.scene
        if not self._pushes.value or view.mode == 'guided' or view.status not in _MOVING:
            if self._pulled:
                self.release()
            scene.handle(PUSH, None)
        elif not self._pulled:
            scene.handle(PUSH, view.pose, self._drag, scale=0.2)
