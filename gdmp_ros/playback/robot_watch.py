"""Compares the robot with its references: far behind, blocked, at the goal and at rest."""
from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gdmp_ros.manifolds.quaternion import pose_distance
from gdmp_ros.playback.distance import Distance
from gdmp_ros.playback.streamed_skill import Kind
from gdmp_ros.util.settings import setting

#: A robot that moves less than this within `BLOCKED_S` or `REST_S` does not move [m, rad].
STILL_M, STILL_RAD = 0.001, 0.005
#: Time over which a robot must be still to be at rest [s].
REST_S = 0.2


@dataclass(frozen=True)
class RobotSettings:
    """How far the robot may be from goal and path."""

    robot_position_tolerance: float = setting(
        0.003, 'largest distance of the robot from the goal when a motion has ended', 'm', 1e-5,
        1.0)
    robot_rotation_tolerance: float = setting(0.02, 'the same for the rotation', 'rad', 1e-4, 3.0)
    settling_time: float = setting(
        2.0, 'time in which the robot must come to rest at the goal after the reference has', 's',
        0.0, 60.0)
    path_position_tolerance: float = setting(
        0.0, 'distance of the robot from the reference at which a motion is ended; 0: never', 'm',
        0.0, 10.0)
    path_rotation_tolerance: float = setting(
        0.0, 'the same for the rotation; 0: never', 'rad', 0.0, 3.0)
    lag_position: float = setting(
        0.02, 'distance of the robot from the reference at which it counts as lagging', 'm', 1e-4,
        1.0)
    lag_rotation: float = setting(0.1, 'the same for the rotation', 'rad', 1e-3, 3.0)
    blocked_time: float = setting(
        3.0, 'a robot that lags and does not move for this long is blocked: the motion is ended',
        's', 0.1, 60.0)


def distance(first: np.ndarray, second: np.ndarray) -> Distance:
    """Distance between two poses (x, y, z, qw, qx, qy, qz)."""
    return Distance(*pose_distance(first, second))


class RobotWatch:
    """
    What is known of the robot during a motion; one thread calls `update`, any thread reads.

    Where the robot is are poses, or positions of the joints.

    :ivar flags: ``lagging`` and ``blocked``
    :ivar lag: from the reference; None if the robot is not known
    :ivar largest_lag: since the beginning of the motion
    :ivar place: where the robot was last; None if it is not known
    :ivar seen: whether it was known since the beginning of the motion
    """

    def __init__(self, settings: RobotSettings):
        self.settings = settings
        self.reset()

    def reset(self) -> None:
        """Begin anew."""
        self.flags: frozenset[str] = frozenset()
        self.lag: Distance | None = None
        self.largest_lag = Distance(0.0, 0.0)
        self.place: np.ndarray | None = None
        self._distance: Callable[[np.ndarray, np.ndarray], Distance] = distance
        self._kind = Kind.TOOL
        self.seen = False
        self._recent: deque[tuple[float, np.ndarray]] = deque()
        self._still: tuple[float, np.ndarray] | None = None

    def measure_by(self, kind: Kind, between: Callable[[np.ndarray, np.ndarray], Distance]
                   ) -> None:
        """Places are of this kind from now on, with this distance between two of them."""
        if kind is self._kind:
            return
        self._kind = kind
        self.place, self.lag, self._distance = None, None, between
        self._still, self.flags = None, frozenset()
        self._recent.clear()

    def begin(self) -> None:
        """A motion begins."""
        self.largest_lag, self._still, self.flags = Distance(0.0, 0.0), None, frozenset()
        self.seen = False

    def update(self, now: float, place: np.ndarray | None, reference: np.ndarray, moving: bool
               ) -> None:
        """
        Use a measurement.

        :param now: [s]
        :param place: where the robot is; None if it is not known
        :param reference: where the reference is
        :param moving: whether the robot is to move
        """
        self.place = place
        if place is None:
            self.lag, self._still, self.flags = None, None, frozenset()
            self._recent.clear()
            return
        self.seen = True
        self._recent.append((now, place))
        # The oldest one is REST_S old or older, whatever the time between two of them.
        while len(self._recent) > 1 and self._recent[1][0] <= now - REST_S + 1e-9:
            self._recent.popleft()
        lag = self.lag = self._distance(place, reference)
        self.largest_lag = Distance(*map(max, self.largest_lag, lag))
        lagging = moving and not lag.within(self.settings.lag_position, self.settings.lag_rotation)
        if not lagging:
            self._still, self.flags = None, frozenset()
            return
        if self._still is None or not self._distance(place, self._still[1]).within(STILL_M,
                                                                                   STILL_RAD):
            self._still = now, place
        blocked = now - self._still[0] >= self.settings.blocked_time
        self.flags = frozenset({'lagging', 'blocked'} if blocked else {'lagging'})

    def rests(self) -> bool:
        """Whether the robot has been still for `REST_S`."""
        recent = tuple(self._recent)
        return (len(recent) > 1 and recent[-1][0] - recent[0][0] >= REST_S - 1e-9
                and all(self._distance(place, recent[-1][1]).within(STILL_M, STILL_RAD)
                        for _, place in recent))
