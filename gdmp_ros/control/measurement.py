"""What a robot reports to its controller."""
from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np


class Measurement(NamedTuple):
    """
    Measurements of one tick.

    :ivar position: of the joints [rad], shape ``(n,)``
    :ivar velocity: of the joints [rad/s], shape ``(n,)``
    :ivar pose: of the tool in the base frame, (x, y, z, qw, qx, qy, qz)
    :ivar jacobian: of the tool in the base frame, linear over angular, shape ``(6, n)``
    :ivar inertia: joint-space inertia, shape ``(n, n)``
    :ivar bias: gravity and Coriolis torque [Nm], shape ``(n,)``
    :ivar external: torque of contacts and external forces [Nm], shape ``(n,)``
    :ivar jdot_qdot: J̇ q̇, acceleration of the tool at constant joint velocity [m/s², rad/s²]
    :ivar potential: potential energy of gravity, up to a constant [J]
    """

    position: np.ndarray
    velocity: np.ndarray
    pose: np.ndarray
    jacobian: np.ndarray
    inertia: np.ndarray
    bias: np.ndarray
    external: np.ndarray
    jdot_qdot: np.ndarray
    potential: float


@dataclass(frozen=True)
class JointLimits:
    """Limits of the joints, each of shape ``(n,)``: position [rad] (or inf), torque [Nm]."""

    lower: np.ndarray
    upper: np.ndarray
    torque: np.ndarray
