"""The posture that the null space of the tool's motion keeps."""
from __future__ import annotations

import numpy as np

from gdmp_ros.control.measurement import JointLimits
from gdmp_ros.control.settings import ControllerSettings

#: A new posture is approached with this speed [rad/s].
RATE = 0.3
#: Setting without a posture.
NONE = ControllerSettings.posture


class Posture:
    """
    A posture that changes slowly.

    :ivar position: of the joints, now [rad]
    :ivar changes: whether another one is approached
    """

    def __init__(self, joints: JointLimits):
        self._joints = joints
        self.position = self._target = np.zeros_like(joints.torque)
        self.changes = False

    def check(self, setting: tuple[float, ...]) -> None:
        """:raises ParameterError: if a setting is not a posture of the arm"""
        if setting != NONE:
            self._joints.check(np.array(setting))

    def use(self, setting: tuple[float, ...]) -> None:
        """Approach a setting from now on; without a posture nothing changes."""
        if setting != NONE:
            self._target, self.changes = np.array(setting), True

    def approach(self, position: np.ndarray) -> None:
        """
        Approach another posture from now on.

        :param position: of the joints [rad]
        :raises ParameterError: if it is not one of the arm
        """
        self._joints.check(position)
        self._target, self.changes = position.copy(), True

    def hold(self, position: np.ndarray) -> None:
        """Keep the present position of the joints [rad]."""
        self.position, self._target, self.changes = position.copy(), position.copy(), False

    def advance(self, dt: float) -> np.ndarray:
        """Let ``dt`` pass; returns the position [rad]."""
        if self.changes:
            target, step = self._target, RATE * dt
            self.position = self.position + np.clip(target - self.position, -step, step)
            self.changes = not np.array_equal(self.position, target)
        return self.position
