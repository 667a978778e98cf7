"""The posture that the null space of the tool's motion keeps."""
from __future__ import annotations

import numpy as np

from gdmp_ros.control.measurement import JointLimits
from gdmp_ros.control.memory import ArmMemory
from gdmp_ros.control.settings import ControllerSettings

#: Setting without a posture.
NONE = ControllerSettings.posture


class Posture:
    """A posture that changes slowly, in the memory of a controller."""

    def __init__(self, joints: JointLimits, arm: ArmMemory):
        self._joints, self._arm = joints, arm

    @property
    def position(self) -> np.ndarray:
        """Of the joints, now [rad]."""
        return np.array(self._arm.posture)

    def check(self, setting: tuple[float, ...]) -> None:
        """:raises ParameterError: if a setting is not a posture of the arm"""
        if setting != NONE:
            self._joints.check(np.array(setting))

    def use(self, setting: tuple[float, ...]) -> None:
        """Approach a setting from now on; without a posture nothing changes."""
        if setting != NONE:
            self._arm.wanted_posture[:] = setting

    def approach(self, position: np.ndarray) -> None:
        """
        Approach another posture from now on.

        :param position: of the joints [rad]
        :raises ParameterError: if it is not one of the arm
        """
        self._joints.check(position)
        self._arm.wanted_posture[:] = position

    def hold(self, position: np.ndarray) -> None:
        """Keep the present position of the joints [rad]."""
        self._arm.posture[:] = self._arm.wanted_posture[:] = position
