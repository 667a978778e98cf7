"""The controller of an arm: guard, limits, energy tank and impedance law, one tick at a time."""
from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from gdmp_ros.control.governor import limit_numbers, moved
from gdmp_ros.control.impedance import (
    ACCELERATION,
    DAMPING_RATIO,
    felt_wrench,
    impedance_torque,
    ImpedanceGains,
    POSE,
    STIFFNESS,
    TARGET_SIZE,
    TWIST,
)
from gdmp_ros.control.limits import (
    Bites,
    ENERGY,
    LIMITS,
    LimitSettings,
    STIFFNESS_RATE,
    TORQUE,
    TorqueLimiter,
)
from gdmp_ros.control.measurement import JointLimits, Measurement
from gdmp_ros.control.tank import (
    admit,
    EnergyTank,
    potential,
    stiffness_bounds,
    TankSettings,
)
from gdmp_ros.control.guard import GuardSettings, ReferenceGuard

#: Stiffness while nothing has been asked for [N/m, Nm/rad].
HOLD_STIFFNESS = np.diag([400.0, 400.0, 400.0, 30.0, 30.0, 30.0])


@dataclass(frozen=True)
class ControllerSettings:
    """
    Everything that is set about a controller.

    :ivar damping_ratio: while holding without a reference; 1 is critical
    """

    gains: ImpedanceGains = field(default_factory=ImpedanceGains)
    guard: GuardSettings = field(default_factory=GuardSettings)
    limits: LimitSettings = field(default_factory=LimitSettings)
    tank: TankSettings = field(default_factory=TankSettings)
    damping_ratio: float = 0.7


class Tick(NamedTuple):
    """
    What happened in one tick, measured before it.

    :ivar twist: of the tool [m/s, rad/s]
    :ivar wrench: external, at the tool [N, Nm]
    :ivar stiffness: applied, 36 numbers row-major
    :ivar requested: stiffness that was asked for
    :ivar torque: commanded [Nm]
    :ivar spring: energy stored in the stiffness [J]
    :ivar tank: energy left to be given away [J]
    :ivar excess: by how much each limit has bitten, shape ``(len(LIMITS),)``
    """

    measurement: Measurement
    twist: np.ndarray
    wrench: np.ndarray
    stiffness: np.ndarray
    requested: np.ndarray
    torque: np.ndarray
    spring: float
    tank: float
    excess: np.ndarray


class ImpedanceController:
    """Follows references with an arm; knows neither ROS nor a simulator."""

    guard: ReferenceGuard
    tank: EnergyTank
    _limiter: TorqueLimiter

    def __init__(self, joints: JointLimits, friction: np.ndarray,
                 settings: ControllerSettings | None = None):
        """:param friction: viscous, of the joints [Nm s/rad], shape (n,)"""
        self.bites = Bites()
        self._joints, self._friction = joints, friction
        self._next: ControllerSettings | None = None
        self._adopt(settings or ControllerSettings())
        self._error = np.empty(6)
        self._ahead, self._moved = np.zeros(TWIST + 6), np.empty(7)

    def configure(self, settings: ControllerSettings) -> None:
        """Use other settings from the next tick on; torque, stiffness and energy carry over."""
        self._next = settings

    def _adopt(self, settings: ControllerSettings) -> None:
        self.settings = settings
        gains, limits = settings.gains, settings.limits
        self._gains = gains.array()
        self._limits = limit_numbers(limits)
        self._bounds = stiffness_bounds(limits)
        self._clips = np.array([gains.position_clip, gains.rotation_clip])

    def _take_settings(self) -> None:
        settings, self._next = self._next, None
        if settings is None:
            return
        self._adopt(settings)
        last = self._limiter.last
        self._limiter = TorqueLimiter(self._joints, settings.limits)
        self._limiter.reset(last)
        self.guard.configure(settings.guard, settings.damping_ratio)
        self.tank.configure(settings.tank)

    def reset(self, measured: Measurement) -> None:
        """Hold the measured pose, with the tank as at the start."""
        self._rest = measured.position.copy()
        self._limiter = TorqueLimiter(self._joints, self.settings.limits)
        self._limiter.reset(measured.bias)
        self.guard = ReferenceGuard(self.settings.guard, measured.pose.copy(), HOLD_STIFFNESS,
                                    self.settings.damping_ratio)
        self.tank = EnergyTank(self.settings.tank, self._friction)
        self._last_pose = measured.pose.copy()
        self._followed, self._stiffness = np.zeros(TARGET_SIZE), np.empty(36)
        self._stand(measured.pose)

    def tick(self, measured: Measurement, dt: float) -> Tick:
        """Torque for the next ``dt`` seconds."""
        self._take_settings()
        excess = np.zeros(len(LIMITS))
        tank, clips = self.tank, self._clips
        tank.meter(measured, self._stored(measured.pose), dt)
        wanted = self.guard.target(dt).copy()
        requested = wanted[STIFFNESS:STIFFNESS + 36].copy()
        change = dt * self.settings.limits.stiffness_rate
        drawn, spring = admit(self._followed, self._stiffness, wanted, measured.pose,
                              measured.jacobian, measured.inertia, self._limits, self._bounds,
                              clips, change, tank.spendable(dt), dt, self._error, excess)
        tank.draw(drawn)
        twist = measured.jacobian @ measured.velocity
        torque, wrench = self._torque(measured, wanted[DAMPING_RATIO])
        filling = self._spring_power(measured, twist, spring, dt)
        torque, short = tank.hold_back(measured, torque, filling, dt)
        excess[ENERGY] += short
        if not np.isfinite(torque).all():
            torque, spring = self._recover(measured), 0.0
            excess[TORQUE] = np.inf
        torque = self._limiter.apply(measured.position, measured.velocity, measured.bias, torque,
                                     excess)
        excess[STIFFNESS_RATE] /= dt
        tank.sent(measured, torque, spring)
        if np.isfinite(measured.pose).all():
            self._last_pose = measured.pose.copy()
        self.bites.add(excess)
        return Tick(measured, twist, wrench, self._stiffness.copy(), requested, torque, spring,
                    tank.energy, excess)

    def lead(self, measured: Measurement, dt: float) -> Tick:
        """
        Torque for the next ``dt`` seconds of an arm that somebody leads by hand.

        It carries its own weight and keeps its limits, and nothing holds it: no stiffness, no
        reference. Where it is left it is held from the next `tick` on.
        """
        self._take_settings()
        excess = np.zeros(len(LIMITS))
        self.tank.meter(measured, 0.0, dt)
        self._rest = measured.position.copy()
        self.guard.hold(measured.pose)
        self._stand(measured.pose)
        torque = self._limiter.apply(measured.position, measured.velocity, measured.bias,
                                     measured.bias, excess)
        self.tank.sent(measured, torque, 0.0)
        self.bites.add(excess)
        wrench = felt_wrench(measured.jacobian, measured.inertia, measured.external,
                             self.settings.gains.singularity)
        return Tick(measured, measured.jacobian @ measured.velocity, wrench, np.zeros(36),
                    np.zeros(36), torque, 0.0, self.tank.energy, excess)

    def _stand(self, pose: np.ndarray) -> None:
        """Hold a pose from now on, as stiff as while nothing has been asked for."""
        self._followed[:] = 0.0
        self._followed[POSE:POSE + 7] = pose
        self._stiffness[:] = HOLD_STIFFNESS.reshape(-1)

    def _recover(self, measured: Measurement) -> np.ndarray:
        """Hold the measured pose, weightless: no torque could be computed."""
        self._stand(np.where(np.isfinite(measured.pose), measured.pose, self._last_pose))
        self.tank.forget()
        return self._limiter.last if not np.isfinite(measured.bias).all() else measured.bias.copy()

    def _torque(self, measured: Measurement, damping_ratio: float
                ) -> tuple[np.ndarray, np.ndarray]:
        target = self._followed.copy()
        target[STIFFNESS:STIFFNESS + 36] = self._stiffness
        target[DAMPING_RATIO] = damping_ratio
        # An empty tank pays for a spring and a damper, and for nothing that drives.
        target[TWIST:ACCELERATION + 6] *= self.tank.valve()
        # What the joints' velocity brings by itself need not be pushed for.
        target[ACCELERATION:ACCELERATION + 6] -= measured.drift
        torque, wrench = np.empty(len(self._rest)), np.empty(6)
        impedance_torque(measured.position, measured.velocity, measured.pose, measured.jacobian,
                         measured.inertia, measured.bias, self._friction, target, self._rest,
                         self._gains, measured.external, torque, wrench)
        return torque, wrench

    def _stored(self, pose: np.ndarray) -> float:
        return float(potential(pose, self._followed, self._stiffness, self._clips[0],
                               self._clips[1], self._error))

    def _spring_power(self, measured: Measurement, twist: np.ndarray, spring: float,
                      dt: float) -> float:
        """Rate at which the measured motion fills the spring [W]."""
        self._ahead[:POSE + 7] = measured.pose
        self._ahead[TWIST:TWIST + 6] = twist
        moved(self._ahead, dt, self._moved)
        return (self._stored(self._moved) - spring) / dt
