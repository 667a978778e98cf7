"""Where the robot is, as it was measured last."""
from __future__ import annotations

from collections.abc import Callable
import threading
from typing import NamedTuple, TypeAlias

import numpy as np

from gdmp_ros.errors import ParameterError
from gdmp_ros.playback.streamed_skill import Kind
from gdmp_ros.realtime.loop import Clock, NS

#: Reads a measurement: the place and its age [s]; None if there is no new one.
PlaceSource: TypeAlias = Callable[[], tuple[np.ndarray, float] | None]


class Measured(NamedTuple):
    """
    A measurement.

    :ivar place: pose (x, y, z, qw, qx, qy, qz), positions of the joints, or poses of two tools
    :ivar arrived: when it arrived, steady time [s]
    """

    place: np.ndarray
    arrived: float


class MeasuredInput:
    """
    The newest measurement of one kind; any thread may read it.

    :ivar clock: of its age
    :ivar source: where it comes from, for messages
    """

    def __init__(self, clock: Clock, read: PlaceSource, source: str, what: str = 'measured pose'):
        """
        Prepare.

        :param read: called when the measurement is needed, by any thread
        :param source: where it comes from, for messages
        :param what: it is, for messages
        """
        self.clock, self.source = clock, source
        self._read, self._what = read, what
        self._lock = threading.Lock()
        self._newest: Measured | None = None

    def forget(self) -> None:
        """Forget what has been measured."""
        self._newest = None

    def newest(self) -> Measured | None:
        """Read the newest measurement."""
        with self._lock:
            read = self._read()
            if read is not None:
                self._newest = Measured(read[0], self.clock.now() / NS - read[1])
            return self._newest

    def age(self, measured: Measured) -> float:
        """Time since a measurement arrived [s]."""
        return self.clock.now() / NS - measured.arrived

    def recent(self, oldest: float) -> np.ndarray:
        """
        Where the robot is.

        :param oldest: largest age [s]
        :raises ParameterError: if it is not known
        """
        measured = self.newest()
        if measured is None:
            raise ParameterError(f'no {self._what} has arrived on {self.source} (with '
                                 'start_from: skill none is needed)')
        age = self.age(measured)
        if age > oldest:
            raise ParameterError(f'the last {self._what} on {self.source} is {age:.2f} s old, '
                                 f'expected at most {oldest:g} s')
        return measured.place


def pair_of(first: MeasuredInput, second: MeasuredInput) -> MeasuredInput:
    """Poses of two tools, as old as the older one."""
    used: tuple[Measured | None, Measured | None] = None, None

    def read() -> tuple[np.ndarray, float] | None:
        nonlocal used
        newest = first.newest(), second.newest()
        if newest[0] is None or newest[1] is None or all(
                item is before for item, before in zip(newest, used)):
            return None
        used = newest
        return (np.concatenate([newest[0].place, newest[1].place]),
                max(first.age(newest[0]), second.age(newest[1])))
    return MeasuredInput(first.clock, read, f'{first.source} and {second.source}',
                         'measured pose of both arms')


class MeasuredInputs:
    """
    Where the robot is, for every kind of skill.

    :ivar clock: of all of them
    """

    def __init__(self, tool: MeasuredInput, joints: MeasuredInput | None = None,
                 second_tool: MeasuredInput | None = None):
        """
        Prepare.

        :param joints: for skills of the joints
        :param second_tool: for skills of two arms
        """
        self.clock = tool.clock
        self._inputs = {Kind.TOOL: tool, Kind.JOINTS: joints or MeasuredInput(
            tool.clock, lambda: None, 'no topic', 'positions of the joints')}
        if second_tool is not None:
            self._inputs[Kind.TWO_TOOLS] = pair_of(tool, second_tool)
        self._second = second_tool

    def of(self, kind: Kind) -> MeasuredInput:
        """:raises ParameterError: if it is one of two arms, and there is no second one"""
        if kind not in self._inputs:
            raise ParameterError('the skill is one of two arms, and there is no second arm '
                                 '(second_frame_id)')
        return self._inputs[kind]

    def forget(self) -> None:
        """Forget what has been measured."""
        for item in (*self._inputs.values(), self._second):
            if item is not None:
                item.forget()
