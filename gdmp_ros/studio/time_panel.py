"""The panel of time: a slider that moves the transparent arm, and curves with a line there."""
from __future__ import annotations

import numpy as np
import viser

from gdmp_ros.errors import DataError
from gdmp_ros.studio.app import Studio
from gdmp_ros.studio.motion import Curve
from gdmp_ros.view.style import INK

#: Height of the curves [pixels], and share of it that is free above and below.
HEIGHT, SPACE = 200, 0.05
_CURSOR = '#888888'


class TimePanel:
    """Shows the arm at one time of the shown motion, plays it, and draws it over time."""

    def __init__(self, studio: Studio):
        self._studio, gui = studio, studio.server.gui
        self._slider = gui.add_slider('time [%]', 0.0, 100.0, 0.5, 0.0)
        self._text = gui.add_markdown('')
        self._play = gui.add_checkbox('play', False)
        self._speed = gui.add_slider('playback speed', 0.1, 4.0, 0.1, 1.0)
        self._folder = gui.add_folder('curves', expand_by_default=False)
        with self._folder:
            self._choice = gui.add_dropdown('curve', ('position',))
        self._plot: viser.GuiUplotHandle | None = None
        self._curves: dict[str, Curve] = {}
        self._drawn: tuple[str, ...] = ()
        self._choice.on_update(studio.later(self._draw, 'curve'))
        self._slider.on_update(studio.later(self._show, 'time'))
        self._last = studio.now()
        studio.on_view.append(lambda _: self._advance())
        studio.on_motion.append(self._renew)

    def _advance(self) -> None:
        now = self._studio.now()
        passed, self._last = now - self._last, now
        motion = self._studio.motion
        if not self._play.value:
            return
        if motion is None:
            self._play.value = False
            raise DataError('there is no motion to play: open or learn a skill')
        share = self._slider.value + 100.0 * passed * self._speed.value / motion.duration
        self._slider.value = float(share % 100.0)
        self._show()

    def _show(self) -> None:
        """Show the arm, and the line in the curves, at the time of the slider."""
        studio, motion = self._studio, self._studio.motion
        if motion is None:
            return
        at = motion.index(0.01 * self._slider.value * motion.duration)
        pose = motion.poses[at]
        studio.scene.tool(pose)
        studio.scene.ghost.show(studio.posture_at(motion.times[at]))
        lines = [f'{motion.times[at]:.2f} s: {pose[0]:.3f}, {pose[1]:.3f}, {pose[2]:.3f} m']
        curve = self._curves.get(self._choice.value)
        if curve is not None:
            lines.append(f'{self._choice.value}: ' + ', '.join(
                f'{label.partition(" [")[0]} {value:.4g} {label.partition("[")[2][:-1]}'
                for label, value in zip(curve.labels, curve.values[at]) if np.isfinite(value)))
        self._text.content = '  \n'.join(lines)
        self._draw()

    def _renew(self) -> None:
        """Draw another motion; its arm is shown when the slider moves."""
        motion = self._studio.motion
        self._studio.scene.ghost.show(None)
        self._studio.scene.tool(None)
        self._text.content = ''
        self._curves = {} if motion is None else motion.curves()
        names = tuple(self._curves) or ('position',)
        if self._choice.options != names:
            chosen = self._choice.value
            self._choice.options = names
            self._choice.value = chosen if chosen in names else names[0]
        self._draw()

    def _draw(self) -> None:
        """Draw the chosen curve, with a line at the time of the slider."""
        motion, curve = self._studio.motion, self._curves.get(self._choice.value)
        if motion is None or curve is None:
            return
        finite = curve.values[np.isfinite(curve.values)]
        ends = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 1.0)
        # A vertical line is two points at one time, of a series of its own.
        now = 0.01 * self._slider.value * motion.duration
        at = int(np.searchsorted(motion.times, now))
        times = np.insert(motion.times, [at, at], now)
        shown = min(at, len(motion.times) - 1)
        columns = [np.insert(column, [at, at], column[shown]) for column in curve.values.T]
        line = np.full(len(times), np.nan)
        line[at:at + 2] = ends
        data = (times, *columns, line)
        # uPlot finds no range if a number is missing.
        space = SPACE * (ends[1] - ends[0]) or 1.0
        scales = {'x': viser.uplot.Scale(time=False), 'y': viser.uplot.Scale(
            auto=False, range=(ends[0] - space, ends[1] + space))}
        if self._plot is not None and curve.labels == self._drawn:
            self._plot.scales, self._plot.data = scales, data
            return
        if self._plot is not None:
            self._plot.remove()
        series = [viser.uplot.Series(label='time [s]')] + [
            viser.uplot.Series(label=label, stroke=INK[k % len(INK)], width=2)
            for k, label in enumerate(curve.labels)] + [
            viser.uplot.Series(label='now', stroke=_CURSOR, width=1)]
        with self._folder:
            self._plot = self._studio.server.gui.add_uplot(
                data, tuple(series), scales=scales, height=HEIGHT)
        self._drawn = curve.labels
