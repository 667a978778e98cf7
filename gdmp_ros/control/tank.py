"""
Energy tank: keeps the controller passive while the stiffness varies.

The spring stores ``V = ½ eᵀ K e`` of the clipped error. Everything else that changes the energy of
robot and spring (a growing stiffness, a moving reference, the clip, Coriolis compensation, the
null space, the limits) is measured at the motors as ``τ·Δq - ΔU + ΔV`` and drawn from a tank of
bounded content. Robot, spring and tank together never give more energy than they received. What
the law dissipates, and the friction of the joints, refills the tank.

Sources: Ferraguti, Secchi, Fantuzzi, ICRA 2013; Ferraguti, Preda, Manurung, Bonfè, Lambercy,
Gassert, Muradore, Fiorini, Secchi, IEEE T-RO 2015.
"""
from __future__ import annotations

import math

import numpy as np

from gdmp_ros.control.measurement import Measurement
from gdmp_ros.control.settings import TankSettings

#: A tick may draw at most the share dt / SPENDING_S of the content: the tank empties smoothly [s].
SPENDING_S = 0.01
#: The feed-forward is reduced below this share of the energy at the start.
FEEDFORWARD_SHARE = 0.1
#: Largest injected damping [Nm s/rad].
LARGEST_DAMPING = 20.0


class EnergyTank:
    """
    Energy that the controller may add to robot and spring.

    :ivar energy: content [J]
    """

    def __init__(self, settings: TankSettings, friction: np.ndarray):
        """:param friction: lower bound of the viscous joint friction [Nm s/rad]"""
        self.settings = settings
        self._friction = friction
        self.energy = min(settings.energy, settings.capacity)
        # Velocity, potential and spring energy when the last torque was sent.
        self._before: tuple[np.ndarray, float, float] | None = None
        self._torque = np.zeros_like(friction)
        self._potential_gain = 0.0

    def configure(self, settings: TankSettings) -> None:
        """Use other settings from now on; content beyond the new capacity is lost."""
        self.settings = settings
        self.energy = min(self.energy, settings.capacity)

    def spendable(self, dt: float) -> float:
        """Energy that may be drawn in a tick [J]."""
        if not self.settings.passive:
            return math.inf
        return max(self.energy, 0.0) * min(1.0, dt / SPENDING_S)

    def feedforward_scale(self) -> float:
        """Factor of the feed-forward: decreases to 0 with the last tenth of the energy."""
        if not self.settings.passive:
            return 1.0
        least = FEEDFORWARD_SHARE * max(self.settings.energy, 1e-9)
        return min(max(self.energy, 0.0) / least, 1.0)

    def measure(self, measured: Measurement, stored: float, dt: float) -> None:
        """
        Draw the work of the last torque between the last tick and this one.

        :param stored: energy in the spring now, with the reference of the last tick [J]
        """
        if not math.isfinite(stored + measured.potential + float(measured.velocity.sum())):
            self._before = None
        if self._before is not None:
            velocity, potential, spring = self._before
            # With the mean velocity the work equals the change of kinetic energy, to rounding.
            work = 0.5 * dt * float(self._torque @ (velocity + measured.velocity))
            self._potential_gain = measured.potential - potential
            lost = 0.5 * dt * float(self._friction @ (velocity ** 2 + measured.velocity ** 2))
            self.draw(work - self._potential_gain + stored - spring - lost)
        self.energy = min(self.energy + dt * self.settings.refill, self.settings.capacity)

    def draw(self, energy: float) -> None:
        """Take energy from the tank [J]; a negative amount refills it, up to the capacity."""
        if not math.isfinite(energy):
            self.empty()
            return
        self.energy = min(self.energy - energy, self.settings.capacity)

    def damping_injection(self, measured: Measurement, torque: np.ndarray, spring_power: float,
                          dt: float) -> tuple[np.ndarray, float]:
        """
        Add joint damping for the energy that a torque would draw beyond the content.

        This covers what reference and stiffness do not explain: Coriolis compensation, null space,
        feed-forward, clip.

        :param spring_power: rate of the energy in the spring at the measured motion [W]
        :returns: torque [Nm], and energy that was missing in this tick [J]
        """
        velocity = measured.velocity
        drawn = dt * (float(velocity @ torque) + spring_power
                      - float(self._friction @ velocity ** 2)) - self._potential_gain
        missing = drawn - self.spendable(dt)
        square = float(velocity @ velocity)
        if missing <= 0.0 or square < 1e-12:
            return torque, 0.0
        return torque - min(missing / (dt * square), LARGEST_DAMPING) * velocity, missing

    def empty(self) -> None:
        """Start again with no energy: what was drawn is not known."""
        self._before = None
        self.energy = 0.0

    def remember(self, measured: Measurement, torque: np.ndarray, stored: float) -> None:
        """Keep the torque that is sent and the state it acts on, for the next `measure`."""
        self._before = (measured.velocity.copy(), measured.potential, stored)
        self._torque = torque.copy()
