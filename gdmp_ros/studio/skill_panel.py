"""The panels of the skill: numbers, start, goal, via points, files; and its corrections."""
from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import viser

from gdmp_ros.data import foreign
from gdmp_ros.dmp.frames import BASE
from gdmp_ros.dmp.options import SHORTEST_DURATION
from gdmp_ros.errors import DataError
from gdmp_ros.learning.correction import Push
from gdmp_ros.playback.streamed_skill import is_of_joints
from gdmp_ros.studio.app import Studio
from gdmp_ros.studio.commands import Changes
from gdmp_ros.studio.robot import RobotView
from gdmp_ros.studio.run_panel import RunPanel
from gdmp_ros.studio.scene import BEFORE
from gdmp_ros.studio.workbench import check_free, Opened

NONE, CHOOSE = 'none yet', 'choose one'
#: Spacing of an exported motion [s].
EXPORT_STEP_S = 0.01
PUSH, GOAL = 'push', 'goal'
_MOVING = ('moving', 'paused')


class _Target(NamedTuple):
    """
    What a handle can move.

    :ivar pose: where it is
    :ivar moved: see `gdmp_ros.studio.scene.Scene.handle`
    :ivar turns: whether it can be turned too
    """

    pose: np.ndarray
    moved: Callable[[np.ndarray, bool], None]
    turns: bool = True


class SkillPanel:
    """Shows the chosen skill and changes it."""

    def __init__(self, studio: Studio):
        self._studio, gui = studio, studio.server.gui
        self._choice = gui.add_dropdown('skill', (NONE,))
        self._choice.on_update(studio.entered(self._choose))
        self._numbers = gui.add_markdown('')
        self._verdict = gui.add_markdown('')
        self._handle = gui.add_dropdown('move with the handle', (GOAL,), hint='what the handle in '
                                        'space moves; or click at its point in space')
        self._handle.on_update(studio.entered(self._select))
        with gui.add_folder('start and goal'):
            self._goal = gui.add_vector3('goal [m]', (0.0, 0.0, 0.0), step=0.001)
            self._start = gui.add_vector3('start [m]', (0.0, 0.0, 0.0), step=0.001)
            self._duration = gui.add_number('duration [s]', 1.0, min=SHORTEST_DURATION, step=0.05)
            gui.add_button('undo').on_click(studio.later(self._back(studio.bench.undo)))
            gui.add_button('redo').on_click(studio.later(self._back(studio.bench.redo)))
            gui.add_button('undo all changes').on_click(studio.later(self._undo))
        with gui.add_folder('via points', expand_by_default=False):
            self._at = gui.add_slider('at [% of the motion]', 1, 99, 1, 50)
            gui.add_button('add a via point').on_click(studio.later(self._add_via))
            gui.add_button('remove the via points').on_click(studio.later(self._remove_via))
        with gui.add_folder('files'):
            self._opened = gui.add_text('open', '', hint='skill, sequence, scene, take, folder of '
                                        'takes, or recorded run; counted from the folder where '
                                        'the studio was started')
            gui.add_button('open the file').on_click(
                studio.later(lambda: self._open(self._opened.value.strip())))
            self._recent = gui.add_dropdown('recent', self._remembered(),
                                             hint='files and folders that were opened last')
            self._recent.on_update(studio.entered(self._open))
            upload = gui.add_upload_button('send a file from this browser',
                                           hint='skill, scene, or recording in one file; it is '
                                                'kept in the folder of the studio')
            upload.on_upload(self._uploaded)
            self._file = gui.add_text('file', 'skill.json',
                                      hint='counted from the folder where the studio was started')
            self._replace = gui.add_checkbox('replace an existing file', False)
            gui.add_button('save the skill').on_click(studio.later(self._save))
            gui.add_button('export the motion as CSV').on_click(studio.later(self._export))
        self._compared = gui.add_folder('compare', visible=False)
        self._boxes: dict[str, viser.GuiCheckboxHandle] = {}
        self._named, self._selected = '', GOAL
        for handle, change in ((self._goal, self._type_goal), (self._start, self._type_start),
                               (self._duration, self._type_duration)):
            handle.on_update(studio.entered(change, change.__name__))
        studio.on_motion.append(self._show)
        studio.on_quiet.append(self._show_verdict)

    # What the user does

    async def _uploaded(self, event: Any) -> None:
        sent = event.target.value
        self._studio.jobs.put(lambda: self._receive(sent.name, sent.content))

    def _choose(self, name: str) -> None:
        if name in self._studio.bench.skills:
            self._studio.bench.choose(name)
            self._studio.redraw()

    def _type_goal(self, position: tuple[float, float, float]) -> None:
        self._studio.change(lambda: self._move('goal', np.array(position)))
        self._studio.goal_moved()

    def _type_start(self, position: tuple[float, float, float]) -> None:
        self._studio.change(lambda: self._move('start', np.array(position)))

    def _type_duration(self, seconds: float) -> None:
        def change() -> None:
            self._studio.bench.changes.duration = float(seconds)
        self._studio.change(change)

    def _move(self, which: str, numbers: np.ndarray) -> None:
        """Move the start or the goal to a pose, or to a position."""
        studio, bench = self._studio, self._studio.bench
        skill = bench.edited()
        point = getattr(skill, which)
        pose = studio.pose_of(skill, point)
        pose[:len(numbers)] = numbers
        setattr(bench.changes, which, studio.place_at(skill, pose, point))

    def _drag(self, which: str, pose: np.ndarray, released: bool) -> None:
        studio = self._studio

        def move() -> None:
            studio.change(lambda: self._move(which, pose), not released)
            if which == 'goal':
                studio.goal_moved()
        studio.jobs.put(move, None if released else f'drag {which}')

    def _drag_via(self, progress: float, pose: np.ndarray, released: bool) -> None:
        studio, via = self._studio, self._studio.bench.changes.via

        def move() -> None:
            if progress not in via:
                return  # removed meanwhile
            if is_of_joints(studio.bench.skill):
                via[progress] = studio.place_at(studio.bench.skill, pose, via[progress])
            else:
                via[progress] = pose[:3].copy()
        studio.jobs.put(lambda: studio.change(move, not released),
                        None if released else f'via {progress}')

    def _drag_object(self, name: str, pose: np.ndarray, released: bool) -> None:
        studio, objects = self._studio, self._studio.bench.changes.objects

        def change() -> None:
            objects[name] = pose.copy()

        def move() -> None:
            studio.change(change, not released)
            for tell in studio.on_object:
                tell(name, pose)
        studio.jobs.put(move, None if released else f'object {name}')

    def _undo(self) -> None:
        def nothing() -> None:
            self._studio.bench.changes = Changes()
        self._studio.change(nothing)

    def _back(self, work: Callable[[], None]) -> Callable[[], None]:
        """Take a change back, or make it again, and show the skill."""
        def back() -> None:
            work()
            self._studio.redraw()
        return back

    def _open(self, name: str) -> None:
        studio = self._studio
        if name == CHOOSE:
            return
        if not name:
            raise DataError('open: expected the name of a file or folder')
        self._show_opened(name, studio.bench.open(Path(name)))

    def _receive(self, name: str, content: bytes) -> None:
        """Keep and open a file that a browser has sent."""
        self._show_opened(name, self._studio.bench.receive(name, content, self._replace.value))

    def _show_opened(self, name: str, opened: Opened) -> None:
        studio = self._studio
        if opened.skill and not studio.bench.unsaved:
            studio.bench.choose(opened.skill)
        self._recent.options, self._recent.value = self._remembered(), CHOOSE
        for tell in studio.on_opened:
            tell()
        studio.redraw()
        studio.notify('opened', f'{name}: {opened.kind}', 'green')

    def _remembered(self) -> tuple[str, ...]:
        return (CHOOSE, *map(str, self._studio.bench.recent.paths()))

    def _add_via(self) -> None:
        studio, progress = self._studio, 0.01 * self._at.value
        skill = studio.bench.edited()
        point = skill.rollout(duration=1.0).advance(progress).point.reshape(-1)
        position = (point if is_of_joints(skill) else point[:3]).copy()
        studio.change(lambda: studio.bench.add_via(progress, position))

    def _remove_via(self) -> None:
        studio = self._studio
        studio.change(studio.bench.changes.via.clear)

    def _save(self) -> None:
        self._studio.bench.skill  # noqa: B018  refused without one, whatever the file is called
        path = self._path('.json')
        self._studio.bench.save(path)
        self._studio.redraw()
        self._studio.notify('saved', str(path.absolute()), 'green')

    def _export(self) -> None:
        path = self._path('.csv')
        try:
            foreign.write_csv(path, foreign.motion(self._studio.bench.edited(), EXPORT_STEP_S))
        except OSError as error:
            raise DataError(f'{path}: cannot write: {error.strerror}') from None
        self._studio.notify('exported', str(path.absolute()), 'green')

    def _path(self, suffix: str) -> Path:
        """
        The file that the user has named, with another suffix.

        :raises DataError: if the name does not end in .json, or there is another file already
        """
        name = self._file.value.strip()
        if not name or Path(name).suffix != '.json':
            raise DataError(f'file {name!r}: expected the name of a file that ends in .json')
        path = Path(name).with_suffix(suffix)
        check_free(path, self._replace.value)
        return path

    def _compare(self, name: str, visible: bool) -> None:
        compared = self._studio.compared
        (compared.add if visible else compared.discard)(name)
        self._studio.redraw()

    # What the page shows

    def _show(self) -> None:
        studio, bench = self._studio, self._studio.bench
        # A recorded run is seen without a skill.
        names = tuple(bench.skills) or tuple(f'run {name}' for name in bench.runs) or (NONE,)
        if self._choice.options != names:
            self._choice.options = names
            self._add_boxes()
        self._choice.value = bench.chosen or names[0]
        if bench.chosen != self._named:
            self._named = bench.chosen
            self._file.value = f'{bench.chosen.replace(" ", "_")}_changed.json'
        self._verdict.content = ''
        motion = studio.motion
        if motion is None:
            self._numbers.content = ('No skill yet. Open one below (*files*), or teach one: tab '
                                     '*teach*, guide the arm, record takes, learn.')
            return
        first, last = motion.poses[0], motion.poses[-1]
        seconds = motion.duration
        skill = studio.skill
        if skill is not None:
            first, last = (studio.pose_of(skill, end) for end in (skill.start, skill.goal))
            seconds = skill.duration
        via = len(bench.changes.via)
        self._numbers.content = (
            f'path {motion.length:.3f} m in {seconds:.2f} s, at most '
            f'{motion.speed:.2f} m/s; ends at {last[0]:.3f}, {last[1]:.3f}, {last[2]:.3f} m'
            + (f'; {bench.skill.n_basis} functions' if bench.chosen else '')
            + (f'; {via} via point{"s" if via > 1 else ""}' if via else '')
            + (' (changed, not saved)' if bench.unsaved else ''))
        self._goal.value, self._start.value = tuple(last[:3]), tuple(first[:3])
        self._duration.value = float(seconds)
        self._show_handles(first, last)

    def _select(self, name: str) -> None:
        """Let the handle move something else."""
        self._selected = name
        self._show()

    def _targets(self, first: np.ndarray, last: np.ndarray) -> dict[str, _Target]:
        """What a handle can move."""
        studio, bench = self._studio, self._studio.bench
        if not bench.chosen or studio.motion is None or studio.guided:
            return {}
        views = () if studio.skill is None else studio.skill.views
        found = dict[str, _Target]()
        # Among objects these are dragged, and start and goal go with them.
        for view in views:
            if view.name != BASE:
                found[f'object {view.name}'] = _Target(view.pose, partial(
                    self._drag_object, view.name))
        if not views:
            found[GOAL] = _Target(last, partial(self._drag, GOAL))
            if not bench.skill.rhythmic:
                found['start'] = _Target(first, partial(self._drag, 'start'))
        for progress, position in bench.changes.via.items():
            of_joints = is_of_joints(bench.skill)
            found[f'via {100 * progress:.0f} %'] = _Target(
                studio.pose_of(bench.skill, position) if of_joints
                else np.array([*position, 1.0, 0.0, 0.0, 0.0]),
                partial(self._drag_via, progress), of_joints)
        return found

    def _show_handles(self, first: np.ndarray, last: np.ndarray) -> None:
        """Mark what can be moved; what is selected has a handle."""
        scene, targets = self._studio.scene, self._targets(first, last)
        if targets and self._selected not in targets:
            self._selected = next(iter(targets))
        names = tuple(targets) or (GOAL,)
        if self._handle.options != names:
            self._handle.options = names
        if self._selected in names:
            self._handle.value = self._selected
        for name in scene.marks():
            if name not in targets:
                scene.mark(name, None)
                scene.handle(name, None)
        for name, target in targets.items():
            selected = name == self._selected
            scene.mark(name, target.pose, self._studio.later(partial(self._select, name)))
            scene.handle(name, target.pose if selected else None, target.moved,
                         turns=target.turns)

    def _show_verdict(self) -> None:
        verdict = self._studio.verdict
        self._verdict.content = ('**' + verdict.text + '**' if verdict.wrong.any()
                                 else verdict.text)

    def _add_boxes(self) -> None:
        names = list(self._studio.bench.skills)
        self._compared.visible = len(names) > 1
        with self._compared:
            for name in names:
                if name not in self._boxes:
                    box = self._studio.server.gui.add_checkbox(name, False)
                    box.on_update(self._studio.entered(partial(self._compare, name)))
                    self._boxes[name] = box


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
        followed, pushes = studio.robot.followed(), list[Push]()
        studio.change(lambda: pushes.extend(bench.correct(followed)))
        self._text.content = '  \n'.join(
            f'{push.quantity} at {100 * push.at:.0f} %: '
            + (f'{1e3 * push.largest:.0f} mm' if push.quantity == 'position'
               else f'{push.largest:.2f} rad') for push in pushes)

    def _undo(self) -> None:
        self._studio.change(self._studio.bench.undo_correction)
        self._text.content = ''

    def _show_before(self) -> None:
        """Draw the path before the corrections."""
        bench, scene = self._studio.bench, self._studio.scene
        corrected = bool(bench.chosen and bench.changes.corrections)
        before = self._studio.motion_of(bench.skill).poses[:, :3] if corrected else None
        scene.line('before', before, BEFORE)
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
