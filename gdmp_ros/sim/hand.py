"""A hand that holds the tool of an arm: a spring and a damper of bounded force."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gdmp_ros.control.impedance import clip_norm, rotation_error
from gdmp_ros.control.measurement import Measurement


@dataclass(frozen=True)
class GripSettings:
    """
    How a hand holds.

    :ivar stiffness: [N/m]
    :ivar damping: [N s/m]
    :ivar turning: stiffness of the rotation [Nm/rad]
    :ivar turning_damping: [Nm s/rad]
    :ivar force: largest [N]
    :ivar torque: largest [Nm]
    """

    stiffness: float = 800.0
    damping: float = 110.0
    turning: float = 40.0
    turning_damping: float = 4.0
    force: float = 40.0
    torque: float = 6.0


class Grip:
    """Pulls the tool towards where the hand is."""

    def __init__(self, pose: np.ndarray, settings: GripSettings | None = None):
        """:param pose: of the hand (x, y, z, qw, qx, qy, qz)"""
        self.settings = settings or GripSettings()
        self.pose = np.asarray(pose, dtype=float)
        self._error = np.empty(3)

    def wrench(self, measured: Measurement) -> np.ndarray:
        """Wrench on the tool, base frame [N, Nm]."""
        s, twist = self.settings, measured.jacobian @ measured.velocity
        rotation_error(measured.pose[3:7], self.pose[3:7], self._error)
        result = np.concatenate([
            s.stiffness * (self.pose[:3] - measured.pose[:3]) - s.damping * twist[:3],
            s.turning * self._error - s.turning_damping * twist[3:]])
        clip_norm(result[:3], s.force)
        clip_norm(result[3:], s.torque)
        return result
