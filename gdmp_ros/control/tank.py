"""
Energy tank: keeps the controller passive while the stiffness varies.

The spring stores the energy V (`gdmp_ros.control.spring`). Everything else that changes the energy
of robot and spring (a growing stiffness, a moving reference, Coriolis compensation, friction
compensation, the null space, the limits) is measured at the motors as ``τ·Δq - ΔU + ΔV``, with the
torque that was sent, and drawn from a tank of bounded content. Robot, spring and tank together
never give more energy than they received and than flows into the tank. What the law dissipates
refills it, and friction of the joints as far as it is there for certain.

Sources: Ferraguti, Secchi, Fantuzzi, ICRA 2013; Ferraguti, Preda, Manurung, Bonfè, Lambercy,
Gassert, Muradore, Fiorini, Secchi, IEEE T-RO 2015.
"""
from __future__ import annotations

import math

import numpy as np

from gdmp_ros.control.friction import Credit
from gdmp_ros.control.measurement import Measurement
from gdmp_ros.control.settings import TankSettings
from gdmp_ros.manifolds.linalg import is_finite

#: A tick may draw at most the share dt / SPENDING_S of the content: the tank empties smoothly [s].
SPENDING_S = 0.05
#: Time constant with which the power of the Coriolis forces is smoothed [s].
CORIOLIS_S = 0.02
#: Below this share of the energy at the start the tank is low.
LOW_SHARE = 0.2


class EnergyTank:
    """
    Energy that the controller may add to robot and spring.

    :ivar energy: content [J]
    """

    def __init__(self, settings: TankSettings, credit: Credit):
        self.settings = settings
        self.credit = credit
        self.energy = min(settings.energy, settings.capacity)
        # Velocity, bias, potential and spring energy when the last torque was sent.
        self._before: tuple[np.ndarray, np.ndarray, float, float] | None = None
        # Those that may act now, the last one first.
        self._torques = np.zeros((1, len(credit.dry)))
        self._coriolis = 0.0

    def configure(self, settings: TankSettings) -> None:
        """
        Use other settings from now on.

        Content beyond the new capacity is lost. What was drawn while the controller was not
        passive is forgiven as soon as it is.
        """
        if settings.passive and not self.settings.passive:
            self.energy = max(self.energy, 0.0)
        self.settings = settings
        self.energy = min(self.energy, settings.capacity)

    def fill(self) -> None:
        """Fill it as at the start."""
        self.energy = min(self.settings.energy, self.settings.capacity)

    @property
    def is_low(self) -> bool:
        """Whether little is left: motions will be slowed down and springs softened."""
        return self.settings.passive and self.energy < LOW_SHARE * self.settings.energy

    def spendable(self, dt: float) -> float:
        """Energy that may be drawn in a tick [J]."""
        if not self.settings.passive:
            return math.inf
        return max(self.energy, 0.0) * min(1.0, dt / SPENDING_S)

    def measure(self, measured: Measurement, stored: float, dt: float) -> None:
        """
        Draw the work of the last torque between the last tick and this one.

        :param stored: energy in the spring now, with the reference of the last tick [J]
        """
        if not (math.isfinite(stored + measured.potential) and is_finite(measured.velocity)):
            self._before = None
        if self._before is not None:
            velocity, bias, potential, spring = self._before
            # With the mean velocity the work equals the change of kinetic energy, to rounding.
            # Which of the last torques acted is not known: the one that draws most counts.
            work = 0.5 * dt * max((self._torques @ (velocity + measured.velocity)).tolist())
            gain = measured.potential - potential
            change = dt * float(velocity @ bias) - gain - self._coriolis
            if math.isfinite(change):
                self._coriolis += min(dt / CORIOLIS_S, 1.0) * change
            lost = 0.5 * dt * (self.credit.power(velocity) + self.credit.power(measured.velocity))
            self.draw(work - gain + stored - spring - lost)
        self.energy = min(self.energy + dt * self.settings.recharge_power, self.settings.capacity)

    def draw(self, energy: float) -> None:
        """Take energy from the tank [J]; a negative amount refills it, up to the capacity."""
        if not math.isfinite(energy):
            self.empty()
            return
        self.energy = min(self.energy - energy, self.settings.capacity)

    def missing(self, measured: Measurement, torque: np.ndarray, spring_power: float,
                dt: float) -> float:
        """
        Energy that a torque would draw in this tick beyond what may be drawn [J].

        :param spring_power: rate of the energy in the spring at the measured motion [W]
        """
        # The weight does the power of the bias but for that of the Coriolis forces, which is
        # filtered: the change of the potential in one tick is mostly noise of the positions.
        drawn = dt * (float(measured.velocity @ (torque - measured.bias)) + spring_power
                      - self.credit.power(measured.velocity)) + self._coriolis
        return drawn - self.spendable(dt)

    def empty(self) -> None:
        """Start again with no energy: what was drawn is not known."""
        self._before = None
        self.energy = 0.0

    def remember(self, measured: Measurement, torque: np.ndarray, stored: float, dt: float
                 ) -> None:
        """Keep the torque that is sent and the state it acts on, for the next `measure`."""
        self._before = (measured.velocity.copy(), measured.bias.copy(), measured.potential, stored)
        late = math.ceil(self.settings.delay / dt - 1e-6)
        if len(self._torques) != late + 1:
            self._torques = np.repeat(torque[None], late + 1, axis=0)
        else:
            self._torques[1:] = self._torques[:-1]
            self._torques[0] = torque
