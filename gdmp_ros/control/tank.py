"""
Energy tank: keeps the controller passive while the stiffness varies.

The spring stores the energy V (`gdmp_ros.control.spring`). Everything else that changes the energy
of robot and spring (a growing stiffness, a moving reference, Coriolis compensation, friction
compensation, the null space, the limits) is measured at the motors as ``τ·Δq - ΔU + ΔV``, with the
torque that was sent, and drawn from a tank of bounded content. Robot, spring and tank together
never give more energy than they received and than flows into the tank. What the law dissipates
refills it, and so does the part of the joint friction that is certain.

Sources: Ferraguti, Secchi, Fantuzzi, ICRA 2013; Ferraguti, Preda, Manurung, Bonfè, Lambercy,
Gassert, Muradore, Fiorini, Secchi, IEEE T-RO 2015.
"""
from __future__ import annotations

import math

from gdmp_ros.control.memory import ArmMemory, MOST_TORQUES
from gdmp_ros.control.settings import TankSettings
from gdmp_ros.kernels import kernel
from gdmp_ros.util.settings import numbers

#: A tick may draw at most the share dt / SPENDING_S of the content: the tank empties smoothly [s].
SPENDING_S = 0.05
#: What a tick and a delay leave open is kept back [J]; what is missing of it has to come back
#: within this time [s].
RESERVE, DEBT_S = 0.01, 0.005
#: Time constant with which the power of the Coriolis forces is smoothed [s].
CORIOLIS_S = 0.02
#: Below this share of the energy at the start the tank is low.
LOW_SHARE = 0.2


@kernel
def draw(scalars, tank, energy):
    """Take energy from the tank [J]; a negative amount refills it, up to the capacity."""
    if not math.isfinite(energy):
        # What was drawn is not known.
        scalars.known, scalars.energy = 0.0, 0.0
    else:
        scalars.energy = min(scalars.energy - energy, tank.capacity)


@kernel
def spendable(scalars, tank):
    """Energy that may be drawn in a tick; negative if some has to come back [J]."""
    if tank.passive == 0.0:
        return math.inf
    left = scalars.energy - RESERVE
    return left * min(1.0, scalars.dt / (SPENDING_S if left > 0.0 else DEBT_S))


@kernel
def _credited(credit, velocity, wanted):
    """
    What the friction that is there for certain dissipates [W].

    That of which a share is certain counts at the speed that reference and joint have in common:
    a motion that a hand causes refills nothing with it.

    :param wanted: velocities of the reference
    """
    power = 0.0
    for i in range(velocity.size):
        speed, common = abs(velocity[i]), 0.0
        if velocity[i] * wanted[i] > 0.0:
            common = min(speed, abs(wanted[i]))
        power += max((credit[0, i] * speed + credit[1, i]) * speed,
                     (credit[2, i] * common + credit[3, i]) * common)
    return power


@kernel
def measure_energy(scalars, tank, sent, credit, velocity, velocity_before, wanted, bias_before,
                   stored):
    """
    Draw the work of the last torque between the last tick and this one.

    :param scalars: those of `gdmp_ros.control.memory`
    :param tank: `TankSettings` as numbers
    :param sent: torques that may act, the last one first [Nm]
    :param credit: friction that is there for certain, shape (4, n)
    :param wanted: velocities of the reference of the last tick
    :param stored: energy in the spring now, with the reference of the last tick [J]
    """
    n, dt = velocity.size, scalars.dt
    total = stored + scalars.potential
    for i in range(n):
        total += velocity[i]
    if not math.isfinite(total):
        scalars.known = 0.0
    if scalars.known != 0.0:
        # With the mean velocity the work equals the change of kinetic energy, to rounding.
        # Which of the last torques acted is not known: the one that draws most counts.
        most, free = -math.inf, 0.0
        for k in range(int(scalars.torques)):
            power = 0.0
            for i in range(n):
                power += sent[k, i] * (velocity_before[i] + velocity[i])
            most = max(most, power)
        for i in range(n):
            free += velocity_before[i] * bias_before[i]
        work, gain = 0.5 * dt * most, scalars.potential - scalars.potential_before
        change = dt * free - gain - scalars.coriolis
        if math.isfinite(change):
            scalars.coriolis += min(dt / CORIOLIS_S, 1.0) * change
        lost = 0.5 * dt * (_credited(credit, velocity_before, wanted)
                           + _credited(credit, velocity, wanted))
        draw(scalars, tank, work - gain + stored - scalars.stored_before - lost)
    scalars.energy = min(scalars.energy + dt * tank.recharge_power, tank.capacity)


@kernel
def missing_energy(scalars, tank, credit, velocity, wanted, bias, torque, spring_power):
    """
    Energy that a torque would draw in this tick beyond what may be drawn [J].

    :param spring_power: rate of the energy in the spring at the measured motion [W]
    """
    # The weight does the power of the bias but for that of the Coriolis forces, which is
    # filtered: the change of the potential in one tick is mostly noise of the positions.
    power = 0.0
    for i in range(velocity.size):
        power += velocity[i] * (torque[i] - bias[i])
    lost = _credited(credit, velocity, wanted)
    drawn = scalars.dt * (power + spring_power - lost) + scalars.coriolis
    return drawn - spendable(scalars, tank)


@kernel
def remember(scalars, tank, sent, velocity, bias, velocity_before, bias_before, torque, stored):
    """Keep the torque that is sent and the state it acts on, for the next `measure_energy`."""
    n, late = velocity.size, math.ceil(tank.delay / scalars.dt - 1e-6)
    rows = min(int(late) + 1, MOST_TORQUES)
    for i in range(n):
        velocity_before[i], bias_before[i] = velocity[i], bias[i]
        for k in range(rows - 1, 0, -1):
            sent[k, i] = sent[k - 1, i] if scalars.torques == rows else torque[i]
        sent[0, i] = torque[i]
    scalars.torques = rows
    scalars.known, scalars.potential_before = 1.0, scalars.potential
    scalars.stored_before = stored


class EnergyTank:
    """Energy that the controller may add to robot and spring: a view of its memory."""

    def __init__(self, arm: ArmMemory, settings: TankSettings):
        self._arm = arm
        self.settings = settings

    @property
    def settings(self) -> TankSettings:
        """Settings of the tank."""
        return self._settings

    @settings.setter
    def settings(self, settings: TankSettings) -> None:
        self._settings = settings
        self._arm.tank.numbers[:] = numbers(settings)

    @property
    def energy(self) -> float:
        """Content [J]."""
        return float(self._arm.scalars.energy)

    @energy.setter
    def energy(self, energy: float) -> None:
        self._arm.scalars.energy = energy

    def reset(self) -> None:
        """Content as at the start, and no past."""
        scalars = self._arm.scalars
        scalars.known, scalars.torques, scalars.coriolis = 0.0, 0.0, 0.0
        self.fill()

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

    def empty(self) -> None:
        """Start again with no energy: what was drawn is not known."""
        self._arm.scalars.known = 0.0
        self.energy = 0.0

    @property
    def is_low(self) -> bool:
        """Whether little is left: motions will be slowed down and springs softened."""
        return self.settings.passive and self.energy < LOW_SHARE * self.settings.energy
