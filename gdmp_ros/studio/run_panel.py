"""The panels of the robot and of sequences: start, stop, tempo, goal switches, signals, state."""
from __future__ import annotations

from functools import partial

import numpy as np

from gdmp_ros.dmp.sequence import GripperStep, HoldStep, MotionStep, SkillSequence, Step
from gdmp_ros.errors import DataError
from gdmp_ros.studio.app import Studio
from gdmp_ros.studio.robot import RobotView
from gdmp_ros.studio.scene import HIDDEN_AT_FIRST, LAYERS

#: Interval of the text [s].
_TEXT_S = 0.2
_MOVING = ('moving', 'paused')
#: Colours of the paths of a sequence, and of the step that runs.
_STEP, _RUNS = (170, 140, 90), (200, 60, 20)


class RunPanel:
    """
    Executes the changed skill on the robot.

    :ivar executed: name of the skill that was started last; empty before
    """

    def __init__(self, studio: Studio):
        self._studio, gui = studio, studio.server.gui
        self._state = gui.add_markdown('waiting for the robot')
        self._progress = gui.add_progress_bar(0.0)
        gui.add_button('start', color='green').on_click(studio.later(self._start))
        gui.add_button('stop', color='red').on_click(studio.later(studio.robot.stop))
        self._paused = gui.add_checkbox('paused', False)
        self._paused.on_update(studio.entered(studio.robot.pause))
        self._tempo = gui.add_slider('tempo', 0.0, 2.0, 0.05, 1.0)
        self._tempo.on_update(studio.entered(studio.robot.set_tempo, 'tempo'))
        self._amplitude = gui.add_slider('amplitude', 0.0, 2.0, 0.05, 1.0,
                                         hint='of a rhythmic skill; 0 ends it at its centre')
        self._amplitude.on_update(studio.entered(self._set_amplitude, 'amplitude'))
        self._switch = gui.add_checkbox(
            'switch the goal while it moves', True,
            hint='a goal that you drag or type is sent to a robot that moves')
        gui.add_button('move to the home posture').on_click(studio.later(studio.robot.home))
        self._text_due = 0.0
        self.executed = ''
        studio.on_view.append(self._show)
        studio.on_goal.append(self._switch_goal)
        studio.on_object.append(self._move_object)

    def _set_amplitude(self, amplitude: float) -> None:
        """Send an amplitude that the user has moved to a rhythmic motion."""
        view = self._studio.view
        if view is not None and view.cycle is not None:
            self._studio.robot.set_amplitude(amplitude)

    def _start(self) -> None:
        studio = self._studio
        studio.robot.use(studio.bench.edited(), studio.bench.chosen)
        studio.robot.set_tempo(self._tempo.value)
        self._paused.value, self._amplitude.value = False, 1.0
        studio.robot.start()
        self.executed = studio.bench.chosen

    def _switch_goal(self, goal: np.ndarray) -> None:
        """Send a goal that the user has moved to a robot in motion, not to one at rest."""
        if self._goes_on():
            self._studio.robot.switch_goal(goal)

    def _move_object(self, name: str, pose: np.ndarray) -> None:
        """Tell a robot in motion where the user has moved an object."""
        if self._goes_on():
            self._studio.robot.move_object(name, pose)

    def _goes_on(self) -> bool:
        """Whether the chosen skill is executed, and what is dragged counts for it."""
        studio, view = self._studio, self._studio.view
        return (self._switch.value and view is not None and view.status in _MOVING
                and studio.bench.chosen == self.executed)

    def _show(self, view: RobotView | None) -> None:
        if self._studio.now() < self._text_due:
            return
        self._text_due = self._studio.now() + _TEXT_S
        if view is None:
            self._state.content = f'{self._studio.robot.name}: silent'
            return
        done = view.progress if view.cycle is None else view.progress % 1.0
        self._progress.value = float(np.clip(100.0 * done, 0.0, 100.0))
        p = view.pose
        lines = [f'step {view.step}'] if view.step else []
        if view.cycle is not None:
            lines.append(f'cycle {int(view.progress) + 1}, {view.cycle[0]:.2f} Hz, amplitude '
                         f'{view.cycle[1]:.2f}')
        lines += [f'**{view.status}**, arm: {view.mode}, tempo {view.tempo:.2f}',
                 f'tool at {p[0]:.3f}, {p[1]:.3f}, {p[2]:.3f} m']
        if view.goal is not None:
            lines.append(f'{1e3 * view.distance[0]:.1f} mm and {view.distance[1]:.3f} rad from '
                         'the goal')
        lines.append(f'energy tank {view.tank:.1f} J; limits: '
                     + (', '.join(view.limited) or 'none acts'))
        if view.rate < 0.95:
            lines.append(f'time passes at {view.rate:.2f} of real time')
        if view.problem:
            lines.append(f'**{view.problem}**')
        self._state.content = '\n\n'.join(lines)


class ViewPanel:
    """Chooses what is drawn, says what it is, and looks at the motion again."""

    def __init__(self, studio: Studio):
        self._studio, gui = studio, studio.server.gui
        gui.add_button('look at the motion').on_click(studio.later(studio.look))
        for name, (paint, meaning) in LAYERS.items():
            box = gui.add_checkbox(f'show {name}', name not in HIDDEN_AT_FIRST)
            box.on_update(studio.entered(partial(studio.scene.show, name)))
            swatch = '' if paint is None else (
                f'<span style="color:rgb{paint}">■</span> ')
            gui.add_markdown(f'{swatch}{meaning}')


class SequencePanel:
    """Executes a sequence file on the robot."""

    def __init__(self, studio: Studio):
        self._studio, gui = studio, studio.server.gui
        self._choice = gui.add_dropdown('sequence', tuple(studio.bench.sequences))
        self._choice.on_update(studio.later(self._list))
        self._first = gui.add_slider('first step', 1, 2, 1, 1)
        gui.add_button('start the sequence', color='green').on_click(studio.later(self._start))
        gui.add_button('stop the sequence', color='red').on_click(studio.later(studio.robot.stop))
        self._signal = gui.add_text('signal', _first_signal(self._sequence))
        gui.add_button('send the signal').on_click(studio.later(
            lambda: studio.robot.signal(self._signal.value)))
        self._steps = gui.add_markdown('')
        self._shown: int | None = None
        self._paths: dict[int, np.ndarray] = {}
        studio.on_view.append(self._show)
        self._list()

    def update(self) -> None:
        """Offer the sequences that have been opened meanwhile."""
        names = tuple(self._studio.bench.sequences)
        if names != self._choice.options:
            self._choice.options = names

    @property
    def _sequence(self) -> SkillSequence:
        return self._studio.bench.sequences[self._choice.value]

    def _start(self) -> None:
        first = int(self._first.value)
        if first > len(self._sequence):
            raise DataError(f'first step is {first}, the sequence has {len(self._sequence)} steps')
        self._studio.robot.start_sequence(self._sequence, first - 1)

    def _list(self) -> None:
        self._first.max = max(len(self._sequence), 2)
        self._signal.value = _first_signal(self._sequence)
        self._shown = None
        scene = self._studio.scene
        for name in scene.lines('step '):
            scene.line(name, None, _STEP)
        self._paths = {
            at: self._studio.motion_of(step.skill if step.goal is None
                                       else step.skill.between(goal=step.goal)).poses[:, :3]
            for at, step in enumerate(self._sequence.steps, 1) if isinstance(step, MotionStep)}
        self._show(self._studio.view)

    def _show(self, view: RobotView | None) -> None:
        """List the steps, and draw their paths; the present one is bold, and of another colour."""
        number = 0 if view is None or view.sequence is None else view.sequence[0]
        if number == self._shown:
            return
        self._shown = number
        for at, path in self._paths.items():
            self._studio.scene.line(f'step {at}', path, _RUNS if at == number else _STEP)
        self._steps.content = '\n'.join(
            f'{at}. **{_described(step)}**' if at == number else f'{at}. {_described(step)}'
            for at, step in enumerate(self._sequence.steps, 1))


def _first_signal(sequence: SkillSequence) -> str:
    """The first signal that a step waits for."""
    return next((step.until for step in sequence.steps
                 if isinstance(step, (MotionStep, HoldStep)) and step.until), '')


def _described(step: Step) -> str:
    if isinstance(step, HoldStep):
        return f'{step.name}: until {step.until}' if step.until else (
            f'{step.name}: {step.seconds:g} s')
    if isinstance(step, GripperStep):
        return f'{step.name}: to {1e3 * step.command.width:.0f} mm'
    if not isinstance(step, MotionStep) or not step.skill.rhythmic:
        return step.name
    until = f'until {step.until}' if step.until else ''
    cycles = '' if step.cycles is None else f'{step.cycles:g} cycles'
    return f'{step.name}: {" or ".join(part for part in (cycles, until) if part)}'
