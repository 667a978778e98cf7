"""The panel of sequences: start one at any step, and send the signals that its steps wait for."""
from __future__ import annotations

from gdmp_ros.dmp.sequence import GripperStep, HoldStep, MotionStep, SkillSequence, Step
from gdmp_ros.errors import DataError
from gdmp_ros.studio.app import Studio
from gdmp_ros.studio.robot import RobotView


class SequencePanel:
    """Executes a sequence file on the robot."""

    def __init__(self, studio: Studio):
        self._studio, gui = studio, studio.server.gui
        names = tuple(studio.bench.sequences)
        self._choice = gui.add_dropdown('sequence', names)
        self._choice.on_update(studio.later(self._list))
        self._first = gui.add_slider('first step', 1, 2, 1, 1)
        gui.add_button('start the sequence', color='green').on_click(studio.later(self._start))
        self._signal = gui.add_text('signal', _first_signal(self._sequence))
        gui.add_button('send the signal').on_click(studio.later(
            lambda: studio.robot.signal(self._signal.value)))
        self._steps = gui.add_markdown('')
        self._shown: int | None = None
        studio.on_view.append(self._show)
        self._list()

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
        self._show(self._studio.view)

    def _show(self, view: RobotView | None) -> None:
        """List the steps; the present one is bold."""
        number = 0 if view is None or view.sequence is None else view.sequence[0]
        if number == self._shown:
            return
        self._shown = number
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
