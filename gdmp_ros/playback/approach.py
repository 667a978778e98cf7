"""From a reference that rests elsewhere to the robot, before a motion begins there."""
from __future__ import annotations

import math

import numpy as np

from gdmp_ros.control.target import ACCELERATION, POSE, TWIST
from gdmp_ros.kernels import kernel, local_numbers
from gdmp_ros.manifolds.quaternion import rotate_by_vector
from gdmp_ros.playback.channels import COUNT, FIRST, KIND, OF_JOINTS, TARGET

#: Share of the acceleration that is planned with, and time constant at the end [s].
_PLANNED, _END_S = 0.9, 0.02
#: Part of the way that is left at the end.
_ARRIVED = 1e-5
# Numbers of an approach.
_PROGRESS, _RATE, _FASTEST, _LARGEST, _STOPS = range(5)


class Approach:
    """
    A straight way from rest to rest, of all channels with one tempo.

    Speed and acceleration are bounded also when it is stopped on the way.
    """

    def __init__(self, start: np.ndarray, way: np.ndarray, table: np.ndarray, fastest: float,
                 largest: float):
        """
        Plan.

        :param start: targets at rest
        :param way: of all channels, one number for each velocity
        :param table: of the channels (`gdmp_ros.playback.channels.KIND`)
        :param fastest: largest rate of the progress [1/s]
        :param largest: its largest acceleration [1/s²]
        """
        self._start, self._way, self._table = start.copy(), way, table
        self._numbers = np.array([0.0, 0.0, fastest, largest, 0.0])

    def stop(self) -> None:
        """Come to rest on the way."""
        self._numbers[_STOPS] = 1.0

    def advance(self, dt: float, targets: np.ndarray) -> bool:
        """Let ``dt`` seconds pass and write the targets; whether they rest, there or stopped."""
        return bool(_approach(self._numbers, self._start, self._way, self._table, dt, targets))


@kernel
def _approach(numbers, start, way, table, dt, targets):
    """Write targets on the way, and the numbers of the approach; whether they rest."""
    left = 1.0 - numbers[_PROGRESS]
    rate, largest = numbers[_RATE], numbers[_LARGEST]
    desired = 0.0
    if numbers[_STOPS] == 0.0:
        desired = min(numbers[_FASTEST], math.sqrt(2.0 * _PLANNED * largest * left),
                      left / _END_S)
    change = min(max(desired - rate, -largest * dt), largest * dt)
    numbers[_RATE] = rate + change
    numbers[_PROGRESS] += dt * (rate + 0.5 * change)
    acceleration = change / dt if dt > 0.0 else 0.0
    rests = False
    if numbers[_STOPS] == 0.0 and 1.0 - numbers[_PROGRESS] < _ARRIVED:
        numbers[_PROGRESS], numbers[_RATE], acceleration, rests = 1.0, 0.0, 0.0, True
    elif numbers[_STOPS] == 1.0 and numbers[_RATE] == 0.0:
        acceleration, rests = 0.0, True
    progress, rate = numbers[_PROGRESS], numbers[_RATE]
    rotation = local_numbers(3)
    for row in table:
        at, n, first = row[TARGET], row[COUNT], row[FIRST]
        if row[KIND] == OF_JOINTS:
            for i in range(n):
                targets[at + i] = start[at + i] + progress * way[first + i]
                targets[at + n + i] = rate * way[first + i]
                targets[at + 3 * n + 1 + i] = acceleration * way[first + i]
            continue
        for i in range(3):
            targets[at + POSE + i] = start[at + POSE + i] + progress * way[first + i]
            rotation[i] = progress * way[first + 3 + i]
        pose = at + POSE + 3
        rotate_by_vector(start[pose:pose + 4], rotation, targets[pose:pose + 4])
        for i in range(6):
            targets[at + TWIST + i] = rate * way[first + i]
            targets[at + ACCELERATION + i] = acceleration * way[first + i]
    return rests
