"""The panel for teaching: guide the arm by hand, record takes, drop bad ones, learn."""
from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from gdmp_ros.choices import STIFFNESSES
from gdmp_ros.data.skill_from_bags import LearningSettings
from gdmp_ros.errors import DataError
from gdmp_ros.studio.app import Studio
from gdmp_ros.studio.robot import RobotView
from gdmp_ros.studio.workbench import Take

HAND, NONE = 'hand', 'none yet'


class TeachPanel:
    """Records takes, and learns from those that are used."""

    def __init__(self, studio: Studio):
        self._studio, gui = studio, studio.server.gui
        gui.add_markdown('Guide the arm: drag the handle *hand*. Record several takes of one '
                         'motion; drop bad ones; learn.')
        self._guided = gui.add_checkbox('guide the arm by hand', False)
        self._guided.on_update(studio.later(self._guide))
        gui.add_button('record a take', color='red').on_click(studio.later(self._record))
        gui.add_button('keep the take').on_click(studio.later(self._keep))
        gui.add_button('discard the take').on_click(studio.later(studio.robot.discard))
        self._state = gui.add_markdown('')
        self._list = gui.add_folder(f'takes in {studio.takes_folder}')
        with self._list:
            self._dropped = gui.add_dropdown('take', (NONE,))
            gui.add_button('drop the take').on_click(studio.later(self._drop))
            gui.add_markdown('Learn from:')
        with gui.add_folder('learning'):
            self._automatic = gui.add_checkbox(
                'automatic number of functions', True,
                hint='as few as describe the takes as well as any number')
            self._functions = gui.add_slider('functions', 5, 500, 1, 60)
            self._smoothing = gui.add_number(
                'smoothing [Hz]', 0.0, min=0.0, max=100.0, step=0.5,
                hint='cut-off frequency; 0: only what the fit chooses itself')
            self._stiffness = gui.add_dropdown('stiffness', STIFFNESSES, initial_value='auto')
            gui.add_button('learn', color='green').on_click(studio.later(self._learn))
        self._rows: dict[str, tuple[Any, ...]] = {}
        self._pulled = False
        studio.on_view.append(self._show)
        self._show_takes()

    def _guide(self) -> None:
        studio, guided = self._studio, self._guided.value
        studio.robot.guide(guided)
        studio.guided, self._pulled = guided, False
        pose = None if studio.view is None else studio.view.pose
        studio.scene.handle(HAND, pose if guided else None, self._drag, scale=0.2)
        studio.redraw()

    def _drag(self, pose: np.ndarray, released: bool) -> None:
        self._pulled = not released
        robot = self._studio.robot
        self._studio.jobs.put(lambda: robot.pull(None if released else pose),
                              None if released else HAND)

    def _record(self) -> None:
        if not self._guided.value:
            raise DataError('nothing guides the arm: tick "guide the arm by hand" first')
        self._studio.robot.record(self._studio.takes_folder)

    def _keep(self) -> None:
        studio = self._studio
        path = studio.robot.keep()
        take = studio.bench.open_take(path)
        studio.notify('kept', f'{path}: {take.recording.demonstration.duration:.1f} s', 'green')
        self._show_takes()
        studio.redraw()

    def _use(self, take: Take, box: Any) -> None:
        take.used = bool(box.value)
        self._studio.redraw()

    def _drop(self) -> None:
        bench = self._studio.bench
        chosen = [take for take in bench.takes if take.path.name == self._dropped.value]
        if not chosen:
            raise DataError('there is no take to drop')
        moved = bench.drop(chosen[0])
        self._studio.notify('dropped', f'moved to {moved}')
        self._show_takes()
        self._studio.redraw()

    def _learn(self) -> None:
        studio = self._studio
        settings = LearningSettings(
            n_basis='auto' if self._automatic.value else int(self._functions.value),
            smoothing=float(self._smoothing.value) or None, stiffness=self._stiffness.value)
        bench = studio.bench

        def learned(result: Any) -> None:
            name = bench.take_in(result)
            studio.redraw()
            studio.notify('learned', f'{name}: {result.skill.n_basis} functions', 'green')
        studio.background('learning', bench.learning(settings), learned)

    def _show(self, view: RobotView | None) -> None:
        if view is None:
            return
        self._state.content = ('no take is being recorded' if view.recording is None
                               else f'**recording, {view.recording:.1f} s**')
        if self._guided.value and not self._pulled:
            self._studio.scene.handle(HAND, view.pose)

    def _show_takes(self) -> None:
        studio, bench = self._studio, self._studio.bench
        gui = studio.server.gui
        for parts in self._rows.values():
            for part in parts:
                part.remove()
        self._rows.clear()
        outliers = {one.name: one.outlier for one in bench.comparison()}
        with self._list:
            self._dropped.options = tuple(take.path.name for take in bench.takes) or (NONE,)
            for take in bench.takes:
                name, shown = take.path.name, take.recording.demonstration
                outlier = outliers.get(name, '')
                box = gui.add_checkbox(name, take.used,
                                       hint=outlier or f'{shown.duration:.1f} s')
                box.on_update(studio.later(partial(self._use, take, box)))
                note = (gui.add_markdown(f'*outlier: {outlier}*'),) if outlier else ()
                self._rows[name] = (box, *note)
