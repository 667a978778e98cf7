"""A hand that guides the tool of an arm: a spring and a damper of bounded force."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gdmp_ros.control.measurement import Measurement
from gdmp_ros.manifolds.linalg import limit_norm
from gdmp_ros.manifolds.quaternion import rotation_between
from gdmp_ros.util.settings import setting

#: Damping at the default stiffness [N s/m].
_DAMPING, _STIFFNESS = 110.0, 800.0


@dataclass(frozen=True)
class HandSettings:
    """
    How the hand holds the tool.

    :ivar rotational_stiffness: [Nm/rad]
    :ivar rotational_damping: [Nm s/rad]
    :ivar torque: largest [Nm]
    """

    stiffness: float = setting(
        _STIFFNESS, 'stiffness with which a guiding hand pulls the tool to ~/hand_pose', 'N/m',
        1.0, 5000.0)
    force: float = setting(40.0, 'largest force of that hand', 'N', 0.1, 200.0)
    rotational_stiffness: float = 40.0
    rotational_damping: float = 4.0
    torque: float = 6.0

    @property
    def damping(self) -> float:
        """Damping that keeps the damping ratio at every stiffness [N s/m]."""
        return float(_DAMPING * (self.stiffness / _STIFFNESS) ** 0.5)


class Hand:
    """Pulls the tool towards the pose of the hand."""

    def __init__(self, pose: np.ndarray, settings: HandSettings | None = None):
        """:param pose: of the hand (x, y, z, qw, qx, qy, qz)"""
        self.settings = settings or HandSettings()
        self.pose = np.asarray(pose, dtype=float)
        self._rotation = np.empty(3)

    def wrench(self, measured: Measurement) -> np.ndarray:
        """Wrench on the tool in the base frame [N, Nm]."""
        s, twist = self.settings, measured.jacobian @ measured.velocity
        rotation_between(measured.pose[3:7], self.pose[3:7], self._rotation)
        result = np.concatenate([
            s.stiffness * (self.pose[:3] - measured.pose[:3]) - s.damping * twist[:3],
            s.rotational_stiffness * self._rotation - s.rotational_damping * twist[3:]])
        limit_norm(3, result[:3], s.force)
        limit_norm(3, result[3:], s.torque)
        return result
