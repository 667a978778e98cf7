"""Names of the limits, and counters of how often and how far they were exceeded."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Limit(NamedTuple):
    """
    A limit.

    :ivar unit: of the amount by which the request exceeded it
    :ivar smooths: whether it only smooths a reference, as at the beginning of a stream: counted,
        but nothing to act on
    """

    name: str
    unit: str
    smooths: bool = False


#: In the order of ``gdmp_msgs/RobotState.limited``; the indices below follow it.
LIMITS = (
    Limit('torque', 'Nm'), Limit('torque_rate', 'Nm/s'), Limit('joint_position', 'rad'),
    Limit('joint_speed', 'rad/s'), Limit('speed', 'm/s'), Limit('angular_speed', 'rad/s'),
    Limit('acceleration', 'm/s^2', True), Limit('angular_acceleration', 'rad/s^2', True),
    Limit('workspace', 'm'), Limit('stiffness', 'log of the ratio'),
    Limit('stiffness_rate', '1/s', True), Limit('position_error', 'm'),
    Limit('rotation_error', 'rad'), Limit('singularity', 'fraction of the speed'),
    Limit('energy', 'J'), Limit('wrench', 'fraction of the wrench'), Limit('tool_speed', 'm/s'),
    Limit('jerk', 'm/s^3', True), Limit('angular_jerk', 'rad/s^3', True))
(TORQUE, TORQUE_RATE, JOINT_POSITION, JOINT_SPEED, SPEED, ANGULAR_SPEED, ACCELERATION_LIMIT,
 ANGULAR_ACCELERATION, WORKSPACE, STIFFNESS_BOUNDS, STIFFNESS_RATE, POSITION_ERROR, ROTATION_ERROR,
 SINGULARITY, ENERGY, WRENCH_LIMIT, TOOL_SPEED, JERK, ANGULAR_JERK) = range(len(LIMITS))
#: A limit that was active in no more ticks between two reports is counted, but not reported: as at
#: the beginning of a motion.
BRIEF = 5
_SMOOTHS = np.array([limit.smooths for limit in LIMITS])


def described(violation: np.ndarray) -> list[str]:
    """The limits that were exceeded, with by how much; shape ``(len(LIMITS),)``."""
    return [f'{limit.name} by {value:.3g} {limit.unit}'
            for limit, value in zip(LIMITS, violation) if value > 0.0]


class LimitCounters:
    """
    How often each limit was active, and the largest violation.

    :ivar largest: in the unit of each limit
    """

    def __init__(self, counts: np.ndarray, recent: np.ndarray):
        """
        Begin.

        :param counts: ticks in which each limit was exceeded, counted by the controller
        :param recent: largest violations since the last call of `recent`
        """
        self.largest = np.zeros(len(LIMITS))
        self._counts, self._recent = counts, recent
        self._reported = self.ticks

    @property
    def ticks(self) -> np.ndarray:
        """Ticks in which each limit was active, shape ``(len(LIMITS),)``."""
        return self._counts.astype(np.int64)

    def recent(self) -> str:
        """
        Describe the limits that were active since the last call.

        Not those that smooth, and those that were active in `BRIEF` ticks or less, by a finite
        amount.
        """
        brief = (self.ticks - self._reported <= BRIEF) & np.isfinite(self._recent)
        words = described(np.where(_SMOOTHS | brief, 0.0, self._recent))
        self._reported = self.ticks
        np.maximum(self.largest, self._recent, out=self.largest)
        self._recent[:] = 0.0
        return ', '.join(words)
