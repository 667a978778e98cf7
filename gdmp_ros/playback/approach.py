"""From a reference that rests elsewhere to the robot, before a motion begins there."""
from __future__ import annotations

import numpy as np

from gdmp_ros.control.target import ACCELERATION, POSE, STIFFNESS, TWIST
from gdmp_ros.manifolds.quaternion import rotate_by_vector, rotation_between

#: Largest speed [m/s, rad/s]: less than 0.5 mm in a tick of 1 ms.
SPEED, ANGULAR_SPEED = 0.4, 0.8


class Approach:
    """A straight motion from rest to rest."""

    def __init__(self, start: np.ndarray, end: np.ndarray):
        """:param start: pose (x, y, z, qw, qx, qy, qz)"""
        self._start, self._time = start.copy(), 0.0
        self._way = np.empty(6)
        self._way[:3] = end[:3] - start[:3]
        rotation_between(start[3:7], end[3:7], self._way[3:])
        # A cubic has 1.5 times its mean speed in the middle.
        self._seconds = max(1.5 * max(float(np.linalg.norm(self._way[:3])) / SPEED,
                                      float(np.linalg.norm(self._way[3:])) / ANGULAR_SPEED), 1e-3)

    def advance(self, dt: float, target: np.ndarray) -> bool:
        """Let ``dt`` seconds pass and write the target; whether the end is reached."""
        self._time += dt
        x = min(self._time / self._seconds, 1.0)
        done = x * x * (3.0 - 2.0 * x)
        target[POSE:POSE + 3] = self._start[:3] + done * self._way[:3]
        rotate_by_vector(self._start[3:], done * self._way[3:], target[POSE + 3:POSE + 7])
        target[TWIST:TWIST + 6] = 6.0 * x * (1.0 - x) / self._seconds * self._way
        target[ACCELERATION:STIFFNESS] = (6.0 - 12.0 * x) / self._seconds ** 2 * self._way
        if x < 1.0:
            return False
        target[TWIST:STIFFNESS] = 0.0
        return True
