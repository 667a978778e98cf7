"""The panel for teaching: guide the arm by hand, record takes, drop bad ones, learn."""
from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from gdmp_ros.choices import STIFFNESSES
from gdmp_ros.control.gripper import GripperCommand
from gdmp_ros.data import takes
from gdmp_ros.data.skills import LearningSettings
from gdmp_ros.errors import DataError
from gdmp_ros.studio.app import Studio
from gdmp_ros.studio.robot import RobotView
from gdmp_ros.studio.workbench import Take

HAND, NONE = 'hand', 'none yet'
#: Width of an open gripper [m].
OPEN_M = 0.08
#: Time in which an arm does what it was asked for [s].
ASKED_S = 2.0


class TeachPanel:
    """Records takes, and learns from those that are used."""

    def __init__(self, studio: Studio):
        self._studio, gui = studio, studio.server.gui
        gui.add_markdown('Guide the arm: drag the handle *hand*. Record several takes of one '
                         'motion; drop bad ones; learn.')
        self._guided = gui.add_checkbox('guide the arm by hand', False)
        self._guided.on_update(studio.entered(self._guide))
        gui.add_button('record a take', color='red').on_click(studio.later(self._record))
        gui.add_button('keep the take').on_click(studio.later(self._keep))
        gui.add_button('discard the take').on_click(studio.later(studio.robot.discard))
        with gui.add_folder('gripper', expand_by_default=False):
            self._width = gui.add_slider('close to [mm]', 0, 80, 1, 0)
            self._force = gui.add_slider('hold with [N]', 0, 70, 1, 20,
                                         hint='0: only move to the width')
            gui.add_button('close the gripper').on_click(studio.later(lambda: studio.robot.grip(
                GripperCommand(1e-3 * self._width.value, float(self._force.value)))))
            gui.add_button('open the gripper').on_click(studio.later(
                lambda: studio.robot.grip(GripperCommand(OPEN_M))))
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
            self._joints = gui.add_checkbox(
                'of the joints', False, hint='learn the motion of the joints, not of the tool')
            self._rhythmic = gui.add_checkbox(
                'rhythmic', False, hint='the takes repeat a cycle, such as wiping')
            self._stiffness = gui.add_dropdown('stiffness', STIFFNESSES, initial_value='auto')
            self._objects = gui.add_text(
                'objects', '', hint='frames that /tf of the takes knows, that of the start first '
                                    'and that of the goal last: box hole')
            self._moving = gui.add_text('of them moving', '',
                                        hint='those that move while they are shown')
            gui.add_button('learn', color='green').on_click(studio.later(self._learn))
        self._rows: list[Any] = []
        self._pulled, self._asked = False, 0.0
        studio.on_view.append(self._show)
        studio.on_opened.append(self._show_takes)
        self._show_takes()

    def _guide(self, guided: bool) -> None:
        studio = self._studio
        self._guided.value = guided
        self._asked = studio.now()
        self._pulled = False
        studio.robot.pull(None)
        studio.robot.guide(guided)

    def _drag(self, pose: np.ndarray, released: bool) -> None:
        self._pulled = not released
        robot = self._studio.robot
        self._studio.jobs.put(lambda: robot.pull(None if released else pose),
                              None if released else HAND)

    def _record(self) -> None:
        studio = self._studio
        if not studio.guided:
            raise DataError('nothing guides the arm: tick "guide the arm by hand" first')
        studio.robot.record(studio.takes_folder)

    def _keep(self) -> None:
        studio = self._studio
        path = studio.robot.keep()
        try:
            take = studio.bench.open_take(path)
        except DataError:
            takes.drop(path.parent, path.name)  # nothing could be learned with it in the folder
            raise
        studio.notify('kept', f'{path}: {take.recording.demonstration.duration:.1f} s', 'green')
        self._show_takes()
        studio.redraw()

    def _use(self, take: Take, used: bool) -> None:
        take.used = used
        self._studio.redraw()

    def _drop(self) -> None:
        bench = self._studio.bench
        chosen = [take for take in bench.takes if bench.label(take) == self._dropped.value]
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
            smoothing=float(self._smoothing.value) or None, stiffness=self._stiffness.value,
            joint_topic='' if self._joints.value else None,
            rhythmic=self._rhythmic.value, objects=tuple(self._objects.value.split()),
            moving=tuple(self._moving.value.split()))
        bench = studio.bench

        def learned(result: Any) -> None:
            name = bench.take_in(result)
            if studio.guided:
                self._guide(False)
            studio.redraw()
            studio.notify('learned', f'{name}: {result.skill.n_basis} functions', 'green')
        studio.background('learning', bench.learning(settings), learned)

    def _show(self, view: RobotView | None) -> None:
        if view is None:
            return
        self._follow(view)
        self._state.content = ('no take is being recorded' if view.recording is None
                               else f'**recording, {view.recording:.1f} s**')

    def _follow(self, view: RobotView) -> None:
        """Show what the arm really does: it may end hand guiding, or refuse it."""
        studio, guided = self._studio, view.mode == 'guided'
        if guided != self._guided.value and studio.now() - self._asked > ASKED_S:
            self._guided.value = guided
        if guided != studio.guided:
            studio.guided = guided
            studio.redraw()
        if not guided:
            studio.scene.handle(HAND, None)
        elif not self._pulled:
            studio.scene.handle(HAND, view.pose, self._drag, scale=0.2)

    def release(self) -> None:
        """Let go of the arm, as when a browser is closed while the mouse pulls it."""
        self._pulled = False
        self._studio.robot.pull(None)

    def _show_takes(self) -> None:
        studio, bench = self._studio, self._studio.bench
        gui = studio.server.gui
        for part in self._rows:
            part.remove()
        self._rows.clear()
        outliers = [item.outlier for item in bench.comparison()] or [''] * len(bench.takes)
        with self._list:
            self._dropped.options = tuple(bench.label(take) for take in bench.takes) or (NONE,)
            for take, outlier in zip(bench.takes, outliers):
                demo = take.recording.demonstration
                box = gui.add_checkbox(bench.label(take), take.used,
                                       hint=outlier or f'{demo.duration:.1f} s')
                box.on_update(studio.entered(partial(self._use, take)))
                self._rows.append(box)
                if outlier:
                    self._rows.append(gui.add_markdown(f'*outlier: {outlier}*'))
