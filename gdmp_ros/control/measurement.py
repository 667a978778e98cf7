"""What a robot reports to its controller, and what happens in a tick."""
from __future__ import annotations

from dataclasses import dataclass
import math
from typing import NamedTuple

import numpy as np

from gdmp_ros.control.modes import ArmMode
from gdmp_ros.errors import ParameterError


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
    """
    Limits of the joints, each of shape ``(n,)``: position [rad] (or inf), torque [Nm].

    :ivar speed: [rad/s]; None if it is not known
    :ivar slowing: near a limit of its position, a distance d away, the robot allows a joint the
        speed √(2 a d) - b: offsets b [rad/s] over decelerations a [rad/s²], shape (2, n), 0 for
        none; None if there is no such limit
    :ivar cycle: the robot compares a torque with the one before as if they were no further apart
        than this, even if cycles were lost [s]
    """

    lower: np.ndarray
    upper: np.ndarray
    torque: np.ndarray
    speed: np.ndarray | None = None
    slowing: np.ndarray | None = None
    cycle: float = math.inf

    def check(self, position: np.ndarray) -> None:
        """:raises ParameterError: if this is not a position of the joints within the limits"""
        if position.shape != self.lower.shape or not np.isfinite(position).all():
            raise ParameterError(f'posture is {position}, expected {len(self.lower)} finite '
                                 'numbers, one for each joint')
        for joint, (q, low, high) in enumerate(zip(position, self.lower, self.upper), start=1):
            if not low <= q <= high:
                raise ParameterError(f'posture of joint {joint} is {q:.4g} rad, expected '
                                     f'{low:.4g} to {high:.4g}')

    def fastest(self, largest: float) -> np.ndarray:
        """Speed limit of each joint, at most ``largest`` [rad/s]."""
        known = np.full(len(self.torque), np.inf) if self.speed is None else self.speed
        return np.minimum(known, largest)


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
