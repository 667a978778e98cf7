"""Where the robot is, as it was measured last."""
from __future__ import annotations

from collections.abc import Callable
import threading
import time
from typing import NamedTuple, TypeAlias

import numpy as np

from gdmp_ros.errors import ParameterError

#: Reads a measurement: the place and its age [s]; None if there is no new one.
PlaceSource: TypeAlias = Callable[[], tuple[np.ndarray, float] | None]


class Measured(NamedTuple):
    """
    A measurement.

    :ivar place: pose (x, y, z, qw, qx, qy, qz), or positions of the joints
    :ivar arrived: when it arrived (`time.monotonic`) [s]
    """

    place: np.ndarray
    arrived: float

    @property
    def age(self) -> float:
        """Time since it arrived [s]."""
        return time.monotonic() - self.arrived


class MeasuredInput:
    """The newest measurement of one kind; any thread may read it."""

    def __init__(self, read: PlaceSource, source: str, what: str = 'measured pose'):
        """
        Prepare.

        :param read: called when the measurement is needed, by any thread
        :param source: where it comes from, for messages
        :param what: it is, for messages
        """
        self._read, self._source, self._what = read, source, what
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
                self._newest = Measured(read[0], time.monotonic() - read[1])
            return self._newest

    def recent(self, oldest: float) -> np.ndarray:
        """
        Where the robot is.

        :param oldest: largest age [s]
        :raises ParameterError: if it is not known
        """
        measured = self.newest()
        if measured is None:
            raise ParameterError(f'no {self._what} has arrived on {self._source} (with '
                                 'start_from: skill none is needed)')
        if measured.age > oldest:
            raise ParameterError(f'the last {self._what} on {self._source} is {measured.age:.2f} '
                                 f's old, expected at most {oldest:g} s')
        return measured.place
