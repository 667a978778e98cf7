"""What happened in one tick of an arm's controller."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gdmp_ros.control.measurement import Measurement
from gdmp_ros.control.modes import ArmMode


class Tick(NamedTuple):
    """
    What happened in one tick.

    :ivar measurement: at the beginning of the tick
    :ivar twist: of the tool [m/s, rad/s]
    :ivar wrench: external, at the tool [N, Nm]
    :ivar stiffness: applied, 36 numbers row by row
    :ivar requested: stiffness of the reference
    :ivar torque: commanded [Nm]
    :ivar commanded: wrench of the impedance law [N, Nm]
    :ivar mode: what the arm does
    :ivar spring: energy in the spring [J]
    :ivar tank: energy in the tank [J]
    :ivar violation: by how much each limit was exceeded, shape ``(len(LIMITS),)``
    :ivar joints: reference of the joints (`gdmp_ros.control.joint_target`), valid until the next
        tick; None while there is none
    """

    measurement: Measurement
    twist: np.ndarray
    wrench: np.ndarray
    stiffness: np.ndarray
    requested: np.ndarray
    torque: np.ndarray
    commanded: np.ndarray
    mode: ArmMode
    spring: float
    tank: float
    violation: np.ndarray
    joints: np.ndarray | None = None
