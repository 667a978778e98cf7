"""What a robot tells its controller."""
from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np


class Measurement(NamedTuple):
    """
    What a robot tells its controller at a tick.

    :ivar position: of the joints [rad], shape ``(n,)``
    :ivar velocity: of the joints [rad/s], shape ``(n,)``
    :ivar pose: of the tool in the base frame, (x, y, z, qw, qx, qy, qz)
    :ivar jacobian: of the tool in the base frame, linear over angular, shape ``(6, n)``
    :ivar inertia: joint-space inertia, shape ``(n, n)``
    :ivar bias: gravity and Coriolis torque [Nm], shape ``(n,)``
    :ivar external: torque of contacts and applied forces [Nm], shape ``(n,)``
    :ivar drift: J̇ q̇, acceleration of the tool that the joints' velocity alone brings [m/s²,
        rad/s²]
    :ivar potential: energy of gravity, up to a constant [J]
    """

    position: np.ndarray
    velocity: np.ndarray
    pose: np.ndarray
    jacobian: np.ndarray
    inertia: np.ndarray
    bias: np.ndarray
    external: np.ndarray
    drift: np.ndarray
    potential: float


@dataclass(frozen=True)
class JointLimits:
    """Limits of the joints, each of shape ``(n,)``: position [rad] (or inf), torque [Nm]."""

    lower: np.ndarray
    upper: np.ndarray
    torque: np.ndarray
