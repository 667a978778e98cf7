"""A take that is being recorded in this process, and written as a rosbag2 recording."""
from __future__ import annotations

from pathlib import Path

import numpy as np

from gdmp_ros.data import recordings, takes
from gdmp_ros.data.tool import tool_manifold
from gdmp_ros.dmp.demonstration import Demonstration, MIN_SAMPLES
from gdmp_ros.errors import DataError

#: Longest take [s].
LONGEST_S = 600.0


class RecordedTake:
    """Poses of the tool; one thread adds, and afterwards another one writes."""

    def __init__(self, folder: Path, start_ns: int):
        """
        Begin.

        :param folder: for the bag; it is made here, so that it fails before the work
        :param start_ns: time of day [ns since 1970]
        :raises DataError: if the folder cannot be written
        """
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self.path = folder / takes.next_name(folder)
            self.path.mkdir()
            self.path.rmdir()
        except OSError as error:
            raise DataError(f'{folder}: cannot write takes: {error.strerror}') from None
        self._start_ns = start_ns
        self._times: list[float] = []
        self._poses: list[np.ndarray] = []

    @property
    def duration(self) -> float:
        """[s]."""
        return self._times[-1] - self._times[0] if self._times else 0.0

    def add(self, time_s: float, pose: np.ndarray) -> None:
        """Add a sample; later than `LONGEST_S` nothing is added."""
        if self.duration < LONGEST_S:
            self._poses.append(pose)
            self._times.append(time_s)

    def write(self) -> Path:
        """
        Write the bag.

        :raises DataError: without samples, or if it cannot be written
        """
        count = min(len(self._times), len(self._poses))
        if count < MIN_SAMPLES:
            raise DataError('the take is not kept: it has no samples')
        times = np.array(self._times[:count])
        shown = Demonstration(times - times[0], np.array(self._poses[:count]),
                              tool_manifold(None))
        recordings.write(self.path, shown, recordings.FRAME, self._start_ns)
        return self.path
